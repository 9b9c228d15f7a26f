"""Relative error of a render, from the exposures of its pilot runs."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.relative_error import relative_error
from plenoptic.rendering.estimation.costs import Costs, interval
from plenoptic.rendering.estimation.decisions import FLAT, STEEP, USUAL
from plenoptic.rendering.estimation.estimated import Estimated
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.schedule.budget import Budget

_FALLS = USUAL, STEEP, FLAT


def render_error(budget: Budget, costs: Costs, ghosts: Costs | None = None) -> Estimated | None:
    """Relative error of a render, from runs with some of its samples; None if it is unknown.

    With `ghosts`, whose runs have the same pixels, their variance is added.
    """
    target = budget.target_error if costs.most_samples.value < budget.max_samples else None
    errors = [_errors(run.exposure, costs.samples, target) for run in costs.runs]
    if ghosts is not None:
        pairs = zip(costs.runs, ghosts.runs, errors, strict=True)
        errors = [_sums(image.exposure, light.exposure, error, ghosts.samples) for image, light, error in pairs]
    if not np.isfinite(errors).all():
        return None
    number, low, high = (interval(list(each)) for each in zip(*errors, strict=True))
    return Estimated(number.value, low.low, high.high)


def _errors(shot: Exposure, samples: Estimated, target: float | None) -> list[float]:
    """Errors of an image of other sample numbers: the value, and its lowest and highest."""
    if shot.relative_error is None:
        return 3 * [math.nan]
    errors = [shot.relative_error * factor for factor in _factors(shot, samples)]
    return errors if target is None else [min(error, target) for error in errors]


def _factors(shot: Exposure, samples: Estimated) -> list[float]:
    """Standard errors with other sample numbers over those of an exposure."""
    assert shot.samples is not None
    ends = samples.value, samples.high, samples.low
    return [(shot.samples / end) ** fall for end, fall in zip(ends, _FALLS, strict=True)]


def _sums(shot: Exposure, light: Exposure, errors: list[float], samples: Estimated) -> list[float]:
    """Errors of the sum of an image of some errors and of ghosts of some samples."""
    own = shot.relative_error
    if shot.standard_error is None or light.standard_error is None or own is None:
        return 3 * [math.nan]
    image = shot.image + light.image
    return [
        relative_error(
            image, np.hypot(shot.standard_error * (error / own if own else 0.0), light.standard_error * factor)
        )
        for error, factor in zip(errors, _factors(light, samples), strict=True)
    ]
