"""From tiles of pilots that end at an error: how many samples those of a render will have."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.schedule.progress import Progress

_STEEP, _USUAL, _FLAT = 0.75, 0.62, 0.5
"""Exponents with which errors fall: a steep one, the usual one, and that of independent samples."""


def mean_samples(pilots: Sequence[Progress], budget: Budget) -> tuple[float, float, float]:
    """How many samples tiles of a render have on average, and between what that is in most cases."""
    low, usual, high = (predicted_samples(pilots, falls) for falls in (_STEEP, _USUAL, _FLAT))
    spread = relative_spread(pilots) * usual.mean()
    # Where light is noisy here and there, the dearest tile may not have been seen: one more of that kind.
    found = usual.mean(), low.mean() - spread, np.append(high, high.max()).mean() + spread
    mean, least, most = (min(max(float(number), budget.enough), budget.max_samples) for number in found)
    return mean, least, most


def relative_spread(pilots: Sequence[Progress]) -> float:
    """How far the mean of tiles is from that of all in most cases, over the mean."""
    samples = predicted_samples(pilots)
    return float(1.5 * samples.std(ddof=1) / math.sqrt(samples.size) / samples.mean())


def predicted_samples(pilots: Sequence[Progress], falls: float = _USUAL) -> Floats:
    """(tiles,): samples with which they will end, where errors fall with an exponent."""
    return np.concatenate([_predicted(progress, falls) for progress in pilots])


def _predicted(progress: Progress, falls: float) -> Floats:
    budget = progress.budget
    assert budget.target_error is not None
    found = np.empty(len(progress.tiles))
    for i, done in enumerate(progress.done):
        at, error = progress.last_decision[i].T
        over = np.where(np.isfinite(error), error, 0.0) / budget.target_error
        goes_on = (over > 1.05) & (at > 0)
        wanted = np.where(goes_on, at * np.maximum(over, 1.0) ** (1 / falls), float(done))
        found[i] = max(float(wanted.max()), float(done))
    return found


def steps_to(budget: Budget, samples: Floats | NDArray[np.int64]) -> float:
    """How often tiles are rendered that end with numbers of samples, on average.

    Errors are predicted from step to step, so that each takes up to four times the samples.
    """
    more = np.log(np.maximum(samples / max(budget.enough, 1), 1.0)) / math.log(4.0)
    return float(np.mean(1.0 + np.ceil(more - 1e-9)))
