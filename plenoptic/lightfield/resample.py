"""From the lattice of the microlenses to the square pixels of a view."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, value
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice

_ROUNDING = 1e-9
"""Weights below it count as 0: a pixel that lies on a microlens depends on no other."""


@value
class Resampling:
    """Which microlenses make each pixel of a view of `rows` x `columns` pixels, and with which weights."""

    rows: int
    columns: int
    source: NDArray[np.int64]
    """(rows columns, k) rows of the microlenses; -1 where there is none."""
    weight: Floats
    """(rows columns, k); their sum is 1."""
    origin: Floats
    """(2,) x and y of the first pixel on the array, mm."""
    spacing: tuple[float, float]
    """mm."""

    def mixed(self, values: Floats, power: int = 1) -> Floats:
        """(rows, columns, C) from values (n, C) of the microlenses, with their weights to a power; nan where one lacks.

        With power 2, variances become variances: light of different microlenses falls on different pixels, and so
        their errors are independent.
        """
        # A microlens that does not exist is the last row.
        known = np.vstack([values, np.full((1, values.shape[1]), np.nan)])
        total = np.zeros((len(self.source), values.shape[1]))
        for k in range(self.source.shape[1]):
            share = self.weight[:, k, None] ** power
            # No nan times 0: what has no weight may be missing.
            total += np.where(share > 0, share * known[self.source[:, k]], 0.0)
        return total.reshape(self.rows, self.columns, -1)


def resampling(array: MicrolensArray, index: NDArray[np.int64], spacing: float | None) -> Resampling:
    """How views of the microlenses `index` (n, 2) are resampled to a grid of a spacing in mm.

    Without a spacing, square and rectangular lattices are taken as they are, and hexagonal ones get square pixels of
    the area of a cell. Pixels lie at whole multiples of the spacing, so that one is on the axis and views of a part
    of the sensor are parts of the views of all of it.
    """
    hexagonal = array.lattice is Lattice.HEXAGONAL
    if spacing is not None:
        apart = (spacing, spacing)
    elif hexagonal:
        apart = (math.sqrt(array.cell_area),) * 2
    else:
        apart = array.pitches
    design = index @ array.basis
    low, high = design.min(axis=0), design.max(axis=0)
    first = [math.ceil(low[k] / apart[k] - _ROUNDING) for k in range(2)]
    last = [max(math.floor(high[k] / apart[k] + _ROUNDING), first[k]) for k in range(2)]
    # The sensor is read out turned by 180 degrees: columns run towards -x, rows towards +y.
    x = apart[0] * np.arange(last[0], first[0] - 1, -1)
    y = apart[1] * np.arange(first[1], last[1] + 1)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    nodes, weight = (_triangle if hexagonal else _mesh)(points @ np.linalg.inv(array.basis))
    source = _rows_of(index, nodes)
    return Resampling(len(y), len(x), source, weight, np.array([x[0], y[0]]), apart)


def _triangle(place: Floats) -> tuple[NDArray[np.int64], Floats]:
    """The triangle of three neighbouring lattice points (n, 3, 2) around each place, and barycentric weights (n, 3).

    Places (n, 2) are in units of the lattice vectors, which enclose 60 degrees; the short diagonal of their mesh, from
    (1, 0) to (0, 1), parts it into two equilateral triangles.
    """
    corner, part = _split(place)
    s = part.sum(axis=1)
    lower = s <= 1.0
    third = np.where(lower[:, None], [0, 0], [1, 1])
    nodes = np.stack([corner + third, corner + np.array([1, 0]), corner + np.array([0, 1])], axis=1)
    beside = np.where(lower[:, None], part, 1.0 - part[:, ::-1])
    weight = np.column_stack([1.0 - beside.sum(axis=1), beside])
    return nodes, _cleaned(weight)


def _mesh(place: Floats) -> tuple[NDArray[np.int64], Floats]:
    """The four corners (n, 4, 2) of the mesh around each place, and bilinear weights (n, 4)."""
    corner, part = _split(place)
    steps = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    shares = np.where(steps[None] == 1, part[:, None], 1.0 - part[:, None])
    return corner[:, None] + steps, _cleaned(shares.prod(axis=2))


def _split(place: Floats) -> tuple[NDArray[np.int64], Floats]:
    corner = np.floor(place + _ROUNDING)
    return corner.astype(np.int64), np.clip(place - corner, 0.0, 1.0)


def _cleaned(weight: Floats) -> Floats:
    kept = np.where(weight > _ROUNDING, weight, 0.0)
    return np.asarray(kept / kept.sum(axis=1, keepdims=True))


def _rows_of(index: NDArray[np.int64], nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows in `index` (n, 2) of lattice points (..., 2); -1 where it has none."""
    low, high = index.min(axis=0), index.max(axis=0)
    table = np.full(tuple(high - low + 1), -1, dtype=np.int64)
    table[tuple((index - low).T)] = np.arange(len(index))
    inside = ((nodes >= low) & (nodes <= high)).all(axis=-1)
    i, j = np.moveaxis(np.clip(nodes, low, high) - low, -1, 0)
    return np.where(inside, table[i, j], -1)
