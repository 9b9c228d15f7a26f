"""Stacking of exposures of the same pixels with different random numbers: mean and standard error.

Pixels are independent, so that the bits do not depend on the stacked rows. Pooling over blocks of 8 x 8 is contained in
the errors of the parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.rendering.merging.parts import Arrays


def stack_exposures(shots: Sequence[Arrays]) -> dict[str, NDArray[Any]]:
    """Mean of exposures weighted by their `sample_counts`; each truth channel is that of the first with it."""
    arrays = {name: array for shot in reversed(shots) for name, array in shot.items()}
    if len(shots) == 1:
        return arrays
    weights = [shot["sample_counts"].astype(np.float64)[..., None] for shot in shots]
    total = np.sum(weights, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = sum(weight * shot["image"] for weight, shot in zip(weights, shots, strict=True)) / total
        mean = np.where(total > 0, mean, 0.0)
        error = np.where(total > 0, _error(shots, weights, total, mean), np.inf)
    counts = total[..., 0].astype(np.int32)
    stacked = {"image": mean.astype(np.float32), "standard_error": error.astype(np.float32), "sample_counts": counts}
    return arrays | stacked


def _error(shots: Sequence[Arrays], weights: list[Floats], total: Floats, mean: Floats) -> Floats:
    """Standard error of a weighted mean: from the errors of its parts, or from their differences if one has none."""
    if all("standard_error" in shot for shot in shots):
        squared = np.zeros_like(mean)
        for weight, shot in zip(weights, shots, strict=True):
            squared += np.where(weight > 0, np.square(weight * shot["standard_error"]), 0.0)
        return np.asarray(np.sqrt(squared) / total)
    squares = sum(weight * np.square(shot["image"] - mean) for weight, shot in zip(weights, shots, strict=True))
    freedom = sum((weight > 0).astype(np.float64) for weight in weights) - 1
    return np.asarray(np.where(freedom > 0, np.sqrt(squares / (freedom * total)), np.inf))
