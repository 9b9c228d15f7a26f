"""Types of micro images, which differ in light or size, by their place in the lattice, and the borders of each."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.values import Floats
from plenoptic.optics.microlens.lattice import neighbour_steps

_PERIODS = (1, 2, 3, 4)
"""Periods of patterns of types along each step of the lattice."""
_FEWEST = 10
"""Least number of micro images of each class of a pattern."""
_SIGNIFICANCE, _MIN_DIFFERENCE = 6.0, 0.01
"""Least difference of types, in standard errors and relatively."""
_TREND_STEPS = 4
_MOST, _INNER, _BIN, _TOWARDS_CORNERS = 300, 0.15, 0.5, 0.94
"""Micro images of which borders are measured, radius of full light in pitches, width of rings in pixels, and the cosine
of the least angle of pixels from the direction of a neighbour."""
_QUARTERS, _PIXEL_BORDER = 0.42, 1.45
"""Distance over which light falls from 75 to 25 % over the width of a hexagonal opening that blurs an edge, and the
width that pixels alone give."""
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


def disc_borders(light: Floats, grid: MicroImageGrid) -> Floats:
    """Radius of half of the light, and width of the border, (types, 2), of micro images near the centre of an image.

    Pixels are those towards the corners of cells, which get least light of neighbours. nan where light does not fall
    by half there.
    """
    assert grid.index is not None and grid.centre is not None
    near = np.argsort(np.hypot(*(grid.centre - 0.5 * np.array(grid.shape)).T), kind="stable")[:_MOST]
    centre, types = grid.centre[near], grid.types_of(grid.index[near])
    sides = np.hypot(*np.stack([*grid.basis, grid.basis[0] - grid.basis[1]]).T)
    reach, inner = sides.prod() / (2.0 * np.linalg.det(grid.basis)), _INNER * sides.min()
    steps = np.arange(-math.ceil(reach), math.ceil(reach) + 1)
    square = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    pixel = np.clip(np.rint(centre).astype(np.int64)[:, None] + square, 0, np.subtract(grid.shape, 1))
    offset, values = pixel - centre[:, None], light[pixel[..., 0], pixel[..., 1]]
    radius, directions = np.hypot(offset[..., 0], offset[..., 1]), neighbour_steps(grid.lattice) @ grid.basis
    along = (offset @ (directions.T / np.hypot(*directions.T))).max(axis=-1)
    values = values / np.nanmedian(np.where(radius < inner, values, np.nan), axis=1, keepdims=True)
    rings = np.where((along < _TOWARDS_CORNERS * radius) & (radius > inner), (radius - inner) / _BIN, -1.0).astype(int)
    result = np.full((int(grid.type_pattern.max()) + 1, 2), np.nan)
    for kind in np.unique(types).tolist():
        of_kind = [values[(rings == k) & (types == kind)[:, None]] for k in range(math.floor((reach - inner) / _BIN))]
        profile = np.array([np.median(ring) if len(ring) else 1.0 for ring in of_kind])
        outer, half, rim = (_fall(profile, level) * _BIN + inner for level in (0.75, 0.5, 0.25))
        # Where neighbours touch, light may not fall by three quarters.
        width = 2.0 * (half - outer) if math.isnan(rim) else rim - outer
        result[kind] = half, math.sqrt(max((width / _QUARTERS) ** 2 - _PIXEL_BORDER**2, 0.0))
    return result


def _fall(profile: Floats, level: float) -> float:
    """Place between rings at which a profile first falls to a level, from the inner edge of the first; nan for none."""
    below = np.flatnonzero(profile < level)
    if not len(below) or below[0] == 0:
        return math.nan
    k = int(below[0])
    return k + 0.5 - float((level - profile[k]) / (profile[k - 1] - profile[k]))
