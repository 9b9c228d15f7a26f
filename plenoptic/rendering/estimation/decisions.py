"""Prediction of sample numbers from the decisions of pilot runs with a target error."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.schedule.progress import Progress

STEEP, USUAL, FLAT = 0.75, 0.62, 0.5
"""Exponents of the decrease of errors with samples: a steep one, the usual one, and that of independent samples."""

_STEP = 0.25
"""Largest relative step of the sample numbers at which a tile may end."""


def mean_samples(pilots: Sequence[Progress], budget: Budget, n_tiles: int) -> tuple[float, float, float]:
    """Mean number of samples of the pixels of a render of so many tiles, and its interval."""
    pixels = _pixels(pilots)
    low, usual, high = (predicted_samples(pilots, falls) for falls in (STEEP, USUAL, FLAT))
    mean = float(np.average(usual, weights=pixels))
    unknown = max(1.0 - usual.size / n_tiles, 0.0)  # the fraction of tiles without a pilot
    spread = (relative_spread(pilots) * math.sqrt(unknown) + _STEP / math.sqrt(n_tiles)) * mean
    # Noise may be local, and the pilots may have missed the most expensive tile: count their maximum once more.
    highest = np.append(high, high.max()), np.append(pixels, pixels.mean())
    candidates = mean, np.average(low, weights=pixels) - spread, np.average(highest[0], weights=highest[1]) + spread
    mean, low_, high_ = (min(max(float(number), budget.enough), budget.max_samples) for number in candidates)
    return mean, low_, high_


def relative_spread(pilots: Sequence[Progress]) -> float:
    """Half-width of the interval of the pixels' mean sample number, over the mean."""
    samples, pixels = predicted_samples(pilots), _pixels(pilots)
    mean = np.average(samples, weights=pixels)
    variance = np.average((samples - mean) ** 2, weights=pixels) / (samples.size - 1)
    return float(1.5 * math.sqrt(variance) / mean)


def _pixels(pilots: Sequence[Progress]) -> Floats:
    """(tiles,): pixels of each tile."""
    return np.array([float(tile.pixels) for progress in pilots for tile in progress.tiles])


def predicted_samples(pilots: Sequence[Progress], falls: float = USUAL) -> Floats:
    """(tiles,): predicted final sample numbers for a given exponent."""
    return np.concatenate([_predict(progress, falls) for progress in pilots])


def _predict(progress: Progress, falls: float) -> Floats:
    budget = progress.budget
    assert budget.target_error is not None
    samples = np.empty(len(progress.tiles))
    for i, done in enumerate(progress.done):
        at, error = progress.last_decision[i].T
        over = np.where(np.isfinite(error), error, 0.0) / budget.target_error
        goes_on = (over > 1.05) & (at > 0)
        predicted = np.where(goes_on, at * np.maximum(over, 1.0) ** (1 / falls), float(done))
        samples[i] = max(float(predicted.max()), float(done))
    return samples


def steps_to(budget: Budget, samples: Floats | NDArray[np.int64]) -> float:
    """Average number of renders of a tile that ends with given sample numbers.

    Errors are predicted from step to step, so that each step takes up to four times the samples.
    """
    log4 = np.log(np.maximum(samples / max(budget.enough, 1), 1.0)) / math.log(4.0)
    return float(np.mean(1.0 + np.ceil(log4 - 1e-9)))
