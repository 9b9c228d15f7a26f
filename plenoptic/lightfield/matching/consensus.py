"""Agreement of neighbouring micro images on the disparities of the points that they see."""

from __future__ import annotations

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.lightfield.matching.image_stack import Matches
from plenoptic.lightfield.matching.micro_images import MicroImages

_TOLERANCE = 0.03
"""Relative difference, in addition to four standard errors, up to which microlenses agree."""


def consensus(matches: Matches, micro: MicroImages, shape: tuple[int, ...]) -> Matches:
    """Disparities on the raw image (H, W), from those of its micro images (k, n, n); nan outside of them.

    Neighbouring microlenses see the same points: each pixel collects the estimates that neighbours project onto it, and
    takes the mean of the views that agree with the weighted median. The confidence is multiplied by the fraction that
    agree.
    """
    (lens, y, x), row, column, size = micro.lit, micro.row, micro.column, shape[0] * shape[1]
    value, error, agreement = (plane[lens, y, x] for plane in matches)
    usable = np.isfinite(value) & np.isfinite(error)
    owner = np.full(size, -1)
    owner[row * shape[1] + column] = lens
    slots = np.full((len(micro.steps) + 1, 2, size), np.nan)
    slots[0, :, row * shape[1] + column] = np.where(usable, [value, error], np.nan).T
    for j, other in enumerate(micro.neighbours(lens).T):
        shift = (micro.orthogonal[other] - micro.orthogonal[lens]) * (1.0 - value / micro.stack.pitch)[:, None]
        target = np.rint(np.column_stack([row, column]) + np.nan_to_num(shift, nan=1e9)).astype(np.int64)
        lands = usable & (other >= 0) & ((target >= 0) & (target < shape[:2])).all(axis=1)
        target_index = np.where(lands, target[:, 0] * shape[1] + target[:, 1], 0)
        lands &= owner[target_index] == other
        slots[j + 1][:, target_index[lands]] = value[lands], error[lands]
    result = np.full((3, size), np.nan)
    covered = np.flatnonzero(owner >= 0)
    result[:, covered] = _weighted_consensus(slots[:, 0, covered], slots[:, 1, covered])
    agreed = Matches(*result.reshape(3, *shape[:2]))
    agreed.confidence[row, column] *= np.where(np.isfinite(agreement), agreement, 1.0)
    return agreed


def _weighted_consensus(values: Floats, errors: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean of the estimates (s, n) that agree with their weighted median, its standard error, and their fraction."""
    with np.errstate(divide="ignore", invalid="ignore"):
        order = np.argsort(values, axis=0)
        ordered = np.take_along_axis(values, order, axis=0)
        deviation = np.maximum(np.take_along_axis(errors, order, axis=0), 1e-12)
        valid = np.isfinite(ordered)
        # Errors below a hundredth of the value weigh the same.
        weight = np.where(valid, 1.0 / np.maximum(deviation, 0.01 * np.abs(ordered)), 0.0)
        half = np.cumsum(weight, axis=0) >= 0.5 * weight.sum(axis=0)
        median = np.take_along_axis(ordered, half.argmax(axis=0)[None], axis=0)[0]
        agrees = np.abs(ordered - median) <= _TOLERANCE * np.abs(median) + 4.0 * deviation * (
            deviation < 0.1 * np.abs(median)
        )
        inverse_variance = np.where(agrees, weight**2, 0.0)
        mean = np.where(agrees, inverse_variance * ordered, 0.0).sum(axis=0) / inverse_variance.sum(axis=0)
        # Estimates of neighbours share their pixels: their mean is no better than the best of them. The spread of the
        # estimates that disagree is added, since they may be right.
        smallest = np.where(agrees, deviation, np.inf).min(axis=0)
        doubt = np.where(valid & ~agrees, weight * (ordered - mean) ** 2, 0.0).sum(axis=0) / weight.sum(axis=0)
        fraction = agrees.sum(axis=0) / valid.sum(axis=0)
    return mean, np.where(np.isfinite(mean), np.sqrt(smallest**2 + doubt), np.nan), fraction
