"""Agreement of neighbouring micro images on the disparities of the points that they see."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats
from plenoptic.lightfield.matching.image_stack import Matches
from plenoptic.lightfield.matching.micro_images import MicroImages

_TOLERANCE = 0.03
"""Relative difference, in addition to four standard errors, up to which microlenses agree."""

_BLOCK = 1 << 13
"""Pixels whose consensus is computed together."""
_EDGE = 0.05
"""Relative difference of disparity at the edge of a surface before another."""
CONFIDENCE_AT_EDGES = 0.7
"""Maximum confidence beside such edges, and the least of a `DepthMap` from which views are filled."""
_MIN_ERROR = 0.003
"""Relative error below which the values of a window weigh the same."""
_BIAS_OVER_SCATTER = 2.5
"""Error of disparities over their scatter in a window, beyond that of independent pixels; measured on checkerboards."""


def consensus(matches: Matches, micro: MicroImages, shape: tuple[int, ...], threads: int) -> Matches:
    """Disparities on the raw image (H, W), from those of its micro images (k, n, n); nan outside of them.

    Neighbouring microlenses see the same points: each pixel collects the estimates that neighbours project onto it, and
    takes the mean of the views that agree with the weighted median. The confidence is the mean of theirs times the
    fraction that agree, at most 0.5 for a single one. Scatter within a window adds to the standard error.
    """
    (lens, y, x), row, column, size = micro.lit, micro.row, micro.column, shape[0] * shape[1]
    value, error, agreement = (plane[lens, y, x] for plane in matches)
    usable = np.isfinite(value) & np.isfinite(error)
    owner = np.full(size, -1)
    owner[row * shape[1] + column] = lens
    slots = np.full((len(micro.steps) + 1, 3, size), np.nan)
    slots[0, :, row * shape[1] + column] = np.where(usable, [value, error, agreement], np.nan).T
    fraction = np.where(usable, 1.0 - value / micro.stack.pitch, 0.0)
    for j, neighbour in enumerate(micro.neighbours().T):
        other, baseline = neighbour[lens], micro.orthogonal[neighbour] - micro.orthogonal
        down, right = (
            np.rint(pixel + along[lens] * fraction).astype(np.int64)
            for pixel, along in zip((row, column), baseline.T, strict=True)
        )
        lands = usable & (other >= 0) & (down >= 0) & (down < shape[0]) & (right >= 0) & (right < shape[1])
        target_index = np.where(lands, down * shape[1] + right, 0)
        lands &= owner[target_index] == other
        slots[j + 1][:, target_index[lands]] = value[lands], error[lands], agreement[lands]
    result = np.full((3, size), np.nan)
    covered = np.flatnonzero(owner >= 0)
    blocks = [covered[start : start + _BLOCK] for start in range(0, len(covered), _BLOCK)]

    def consensus_of(pixels: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
        return _weighted_consensus(*(slots[:, k, pixels] for k in range(3)))

    for pixels, agreed in zip(blocks, run_in_order(consensus_of, blocks, threads=threads), strict=True):
        result[:, pixels] = agreed
    value, error, confidence = result.reshape(3, *shape[:2])
    scatter, farthest = window_statistics(value, error, owner.reshape(shape[:2]), micro.stack.window_radius)
    excess = np.fmax(scatter - 2.0 * error**2, 0.0)
    confidence = limit_beside_edges(confidence, farthest > value + _EDGE * np.abs(value))
    return Matches(value, np.sqrt(error**2 + _BIAS_OVER_SCATTER**2 * excess), confidence)


def limit_beside_edges(confidence: Floats, at_edge: NDArray[np.bool_]) -> Floats:
    """Confidence (H, W), at most 0.7 beside a farther surface: surfaces extend beyond their edges by up to a radius."""
    return np.where(at_edge, np.fmin(confidence, CONFIDENCE_AT_EDGES), confidence)


def window_statistics(values: Floats, errors: Floats, owner: NDArray[np.int64], radius: int) -> tuple[Floats, Floats]:
    """Mean squared difference (H, W) of a pixel's value from those in its window, and the largest value near it.

    Both within its micro image. Exact values count most: windows that show a part of an edge yield smooth, wrong values
    beside it; the edge itself has the right ones. The largest value is searched a pixel farther.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = np.nan_to_num(1.0 / np.maximum(errors, _MIN_ERROR * np.abs(values)) ** 2)
        total, squares, largest = np.zeros_like(values), np.zeros_like(values), values.copy()
        for step in product(range(-radius - 1, radius + 2), repeat=2):
            value, weight, lens = (np.roll(plane, step, axis=(0, 1)) for plane in (values, weights, owner))
            in_image = lens == owner
            largest = np.fmax(largest, np.where(in_image, value, np.nan))
            if max(map(abs, step)) <= radius:
                total += np.where(in_image, weight, 0.0)
                squares += np.where(in_image, weight, 0.0) * np.nan_to_num(value - values) ** 2
        return squares / total, largest


def _weighted_consensus(values: Floats, errors: Floats, confidences: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean of the estimates (s, n) that agree with their weighted median, its standard error, and its confidence."""
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
        # A single estimate agrees with nobody.
        confidence = np.where(agrees, np.take_along_axis(confidences, order, axis=0), 0.0).sum(axis=0)
        confidence /= np.maximum(valid.sum(axis=0), 2)
    return mean, np.where(np.isfinite(mean), np.sqrt(smallest**2 + doubt), np.nan), confidence
