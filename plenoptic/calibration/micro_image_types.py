"""Types of micro images, which differ in light or size, by their place in the lattice."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

_PERIODS = (1, 2, 3, 4)
"""Periods of patterns of types along each step of the lattice."""
_FEWEST = 10
"""Least number of micro images of each class of a pattern."""
_SIGNIFICANCE, _MIN_DIFFERENCE = 6.0, 0.01
"""Least difference of types, in standard errors and relatively."""
_TREND_STEPS = 4
_NEIGHBOURS = np.array([step for step in product(range(-2, 3), repeat=2) if any(step)])


def neighbour_differences(index: NDArray[np.int64], values: Floats) -> Floats:
    """Differences (n, c) of values from the medians of the neighbours up to two steps away of micro images (n, 2).

    At the border, which has neighbours on one side, a quadratic trend of all values is followed.
    """
    k, l = (index / np.maximum(np.abs(index).max(axis=0), 1)).T
    design = np.column_stack([np.ones(len(k)), k, l, k * k, k * l, l * l])
    normal, trend = np.linalg.pinv(design.T @ design), np.median(values, axis=0) * np.ones_like(values)
    for _ in range(_TREND_STEPS):
        step = values - trend
        limit = 3.0 * np.median(np.abs(step), axis=0)
        trend = trend + design @ (normal @ (design.T @ np.clip(step, -limit, limit)))
    low = index.min(axis=0) - 2
    table = np.full((*(index.max(axis=0) - low + 3), values.shape[1]), np.nan)
    table[tuple((index - low).T)] = values - trend
    row, column = np.moveaxis(index[:, None] - low + _NEIGHBOURS, -1, 0)
    neighbours = table[row, column]
    is_isolated = np.isnan(neighbours).all(axis=1, keepdims=True)
    return np.asarray(values - trend - np.nanmedian(np.where(is_isolated, 0.0, neighbours), axis=1))


def type_pattern(index: NDArray[np.int64], features: Floats) -> NDArray[np.int64]:
    """Pattern (p, q) of types, by positive features (n, c) of micro images (n, 2): light first, squared size last.

    Of all periods it is the pattern of the least Bayesian information criterion. Its classes that differ significantly
    in no feature are one type. Types are ordered by the last feature.
    """
    values = neighbour_differences(index, np.log(np.maximum(features, 1e-300)))
    n, channels = values.shape
    best, pattern = math.inf, np.zeros((1, 1), dtype=np.int64)
    for p, q in product(_PERIODS, repeat=2):
        classes = (index[:, 0] % p) * q + index[:, 1] % q
        counts = np.bincount(classes, minlength=p * q)
        if counts.min() < _FEWEST:
            continue
        medians = np.array([np.median(values[classes == c], axis=0) for c in range(p * q)])
        scatter = np.maximum(np.median(np.abs(values - medians[classes]), axis=0) / 0.6745, 1e-9)
        criterion = 2 * n * float(np.log(scatter).sum()) + channels * p * q * math.log(n)
        if criterion < best:
            best, pattern = criterion, _merge(medians, 1.2533 * scatter / math.sqrt(counts.min())).reshape(p, q)
    return _least_period(_least_period(pattern).T).T


def _least_period(pattern: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows (p, q) of a pattern after which it repeats."""
    n = len(pattern)
    return next(pattern[:p] for p in range(1, n + 1) if n % p == 0 and np.array_equal(pattern, np.roll(pattern, p, 0)))


def _merge(medians: Floats, error: Floats) -> NDArray[np.int64]:
    """Types (n,) of classes with medians (n, c): those that are joined by insignificant differences are one."""
    difference = np.abs(medians[:, None] - medians)
    joined = np.asarray((difference < np.maximum(_SIGNIFICANCE * error, _MIN_DIFFERENCE)).all(axis=-1))
    for _ in range(len(medians).bit_length()):
        joined = np.asarray(joined @ joined)
    first = joined.argmax(axis=1)
    sizes = {f: float(medians[joined[f], -1].mean()) for f in np.unique(first).tolist()}
    rank = {f: k for k, f in enumerate(sorted(sizes, key=sizes.__getitem__))}
    return np.array([rank[f] for f in first.tolist()], dtype=np.int64)
