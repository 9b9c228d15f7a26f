"""From the lattice of the microlenses to the square pixels of a view."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, value
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice, rows_of

_ROUNDING = 1e-9
"""Weights below it count as 0: a pixel that lies on a microlens depends on no other."""


_NEIGHBOURS = 24
"""Microlenses that make a pixel: more change nothing that was measured."""
_REACH = 3
"""Steps of the lattice from the nearest microlens within which they lie."""
_BLOCK = 4096
"""Pixels whose weights are found together: each takes 12 kB for a moment."""
_DOUBT = 0.5
"""Error of a pixel amid microlenses over that of one foretold from its neighbours: 0.2 to 0.7 where it was measured."""


@value
class Resampling:
    """Microlenses that contribute to each pixel of a view of `rows` x `columns` pixels, with their weights.

    Where all neighbours are known, values are interpolated by cubic radial functions and a linear one; at borders,
    linearly between the corners of the lattice's mesh.
    """

    rows: int
    columns: int
    linear: Weights
    smooth: Weights | None
    """None where every pixel is a microlens."""
    foretold: Weights | None
    """Of each microlens by its neighbours; None where errors are not wanted, or nothing is between microlenses."""
    origin: Floats
    """(2,) x and y of the first pixel, mm."""
    spacing: tuple[float, float]
    """mm."""

    def mixed(self, values: Floats, power: int = 1) -> Floats:
        """(rows, columns, C) from values (n, C) of the microlenses, with their weights to a power; nan where one lacks.

        With power 2, variances become variances: light of different microlenses falls on different pixels, and so
        their errors are independent.
        """
        found = (self.linear if self.smooth is None else self.smooth).mixed(values, power)
        lacking = np.isnan(found)
        if self.smooth is not None and lacking.any():
            found = np.where(lacking, self.linear.mixed(values, power), found)
        return found.reshape(self.rows, self.columns, -1)

    def doubt(self, values: Floats, variance: Floats) -> Floats:
        """Variance (rows, columns, C) of the interpolation's error, from values and variances (n, C).

        Each microlens is predicted from its neighbours: its deviation, beyond its own error, stands for detail that
        the lattice does not resolve, and half of it is taken to be missed amid microlenses, none of it on one.
        """
        if self.smooth is None or self.foretold is None:
            return np.zeros((self.rows, self.columns, values.shape[1]))
        amiss = (values - self.foretold.mixed(values)) ** 2 - variance - self.foretold.mixed(variance, 2)
        found = np.where(np.isfinite(amiss), np.maximum(amiss, 0.0), np.nan)
        spread = self.smooth.shares().mean_of_known(found)
        amid = np.clip(1.0 - (self.smooth.weight**2).sum(axis=1), 0.0, 1.0)
        return np.asarray((_DOUBT**2 * amid[:, None] * spread).reshape(self.rows, self.columns, -1))


class Weights(NamedTuple):
    """Sums of microlenses, k for each of n places."""

    source: NDArray[np.int64]
    """(n, k) rows of the microlenses; -1 where there is none."""
    weight: Floats
    """(n, k); their sum is 1."""

    def mixed(self, values: Floats, power: int = 1) -> Floats:
        """(n, C) from values (m, C), with the weights to a power; nan where one lacks."""
        # A microlens that does not exist is the last row.
        known = np.vstack([values, np.full((1, values.shape[1]), np.nan)])
        total = np.zeros((len(self.source), values.shape[1]))
        for k in range(self.source.shape[1]):
            share = self.weight[:, k, None] ** power
            # No nan times 0: what has no weight may be missing.
            total += np.where(share != 0, share * known[self.source[:, k]], 0.0)
        return total

    def shares(self) -> Weights:
        """The same with shares for weights, all at least 0."""
        share = np.abs(self.weight)
        return Weights(self.source, share / share.sum(axis=1, keepdims=True))

    def mean_of_known(self, values: Floats) -> Floats:
        """Weighted mean over known values alone, as `mixed` of shares; 0 where none is known."""
        known = np.isfinite(values)
        total = self.mixed(np.where(known, values, 0.0))
        part = self._present(known)
        return np.where(part > 0, np.nan_to_num(total) / np.where(part > 0, part, 1.0), 0.0)

    def _present(self, known: NDArray[np.bool_]) -> Floats:
        there = np.vstack([known, np.zeros((1, known.shape[1]), dtype=bool)])
        return np.asarray(np.einsum("nk,nkc->nc", self.weight, there[self.source]))


def resampling(
    array: MicrolensArray,
    index: NDArray[np.int64],
    spacing: float | None,
    *,
    places: Floats | None = None,
    turn: Floats | None = None,
    origin: Floats | None = None,
    errors: bool = True,
) -> Resampling:
    """Resampling of views of the microlenses `index` (n, 2) to a grid of a spacing in mm.

    Without a spacing, lattices whose vectors run along x and y are taken as they are, and others get square pixels of
    the area of a cell. Pixels lie at whole multiples of the spacing from the array's origin, so that views of a part of
    the sensor are parts of the views of all of it, but for its border. `places` (n, 2) are where the microlenses are
    built, by default where the lattice has them, which is turned by `turn` (2, 2) about `origin`. Without `errors`,
    nothing is in doubt.
    """
    start = np.zeros(2) if origin is None else origin
    basis = array.basis if turn is None else array.basis @ turn.T
    design = index @ basis
    built = design if places is None else places - start
    size = np.abs(basis)
    level = min(np.delete(size.ravel(), (0, 3)).max(), np.delete(size.ravel(), (1, 2)).max()) < _ROUNDING * size.max()
    if spacing is not None:
        apart = (spacing, spacing)
    elif level and array.lattice is not Lattice.HEXAGONAL:
        apart = (float(size[:, 0].max()), float(size[:, 1].max()))
    else:
        apart = (math.sqrt(array.cell_area),) * 2
    low, high = design.min(axis=0), design.max(axis=0)
    first = [math.ceil(low[k] / apart[k] - _ROUNDING) for k in range(2)]
    last = [max(math.floor(high[k] / apart[k] + _ROUNDING), first[k]) for k in range(2)]
    # The sensor is read out turned by 180 degrees: columns run towards -x, rows towards +y.
    x = apart[0] * np.arange(last[0], first[0] - 1, -1)
    y = apart[1] * np.arange(first[1], last[1] + 1)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    on_lattice = points @ np.linalg.inv(basis)
    nodes, weight = (_triangle if array.lattice is Lattice.HEXAGONAL else _mesh)(on_lattice)
    at = Lenses(index, built, basis)
    linear = _linear(at, points, nodes, weight)
    smooth = foretold = None
    if linear.weight.max(axis=1).min() < 1.0 - _ROUNDING:
        smooth = _cubic(at, points, on_lattice, own=True)
        foretold = _cubic(at, built, index.astype(np.float64), own=False) if errors else None
    return Resampling(len(y), len(x), linear, smooth, foretold, np.array([x[0], y[0]]) + start, apart)


class Lenses(NamedTuple):
    """Microlenses by lattice index, and where they are built, in mm."""

    lens: NDArray[np.int64]
    built: Floats
    basis: Floats


def _linear(lenses: Lenses, points: Floats, nodes: NDArray[np.int64], weight: Floats) -> Weights:
    """Weights of the corners of a mesh, changed so little that linear functions are right where lenses stand."""
    rows = rows_of(lenses.lens, nodes)
    place = np.where(rows[..., None] >= 0, lenses.built[rows], nodes @ lenses.basis) - points[:, None]
    scale = float(np.abs(lenses.basis).max())
    table = np.concatenate([np.ones((*rows.shape, 1)), place / scale], axis=2)
    amiss = np.array([1.0, 0.0, 0.0]) - np.einsum("nk,nkc->nc", weight, table)
    moved = np.abs(amiss).max(axis=1) > _ROUNDING
    if moved.any():
        bent = table[moved]
        squares = bent.transpose(0, 2, 1) @ bent
        weight = weight.copy()
        weight[moved] += (bent @ np.linalg.solve(squares, amiss[moved][..., None]))[..., 0]
    return Weights(rows, weight)


def _cubic(lenses: Lenses, points: Floats, on_lattice: Floats, *, own: bool) -> Weights:
    """Weights of the nearest microlenses for each point (n, 2): cubic radial functions that reproduce linear ones.

    Without `own`, the microlens at the point itself does not count. G. B. Wright, Radial Basis Function Interpolation,
    PhD thesis, University of Colorado (2003), section 2.
    """
    blocks = range(0, len(points), _BLOCK)
    parts = [_cubic_block(lenses, points[k : k + _BLOCK], on_lattice[k : k + _BLOCK], own) for k in blocks]
    return Weights(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _cubic_block(lenses: Lenses, points: Floats, on_lattice: Floats, own: bool) -> Weights:
    steps = np.stack(np.meshgrid(*[np.arange(-_REACH, _REACH + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    nodes = np.rint(on_lattice).astype(np.int64)[:, None] + steps
    rows = rows_of(lenses.lens, nodes)
    scale = float(np.sqrt(abs(np.linalg.det(lenses.basis))))
    beside = (np.where(rows[..., None] >= 0, lenses.built[rows], nodes @ lenses.basis) - points[:, None]) / scale
    far = (beside**2).sum(axis=2)
    # Distances that are equal but for rounding keep the order of the lattice.
    order = np.argsort(np.round(far, 9), axis=1, kind="stable")[:, slice(int(not own), _NEIGHBOURS + int(not own))]
    rows, beside = np.take_along_axis(rows, order, axis=1), np.take_along_axis(beside, order[..., None], axis=1)
    count, near = rows.shape
    table = np.zeros((count, near + 3, near + 3))
    table[:, :near, :near] = np.linalg.norm(beside[:, :, None] - beside[:, None], axis=3) ** 3
    linear = np.concatenate([np.ones((count, near, 1)), beside], axis=2)
    table[:, :near, near:], table[:, near:, :near] = linear, linear.transpose(0, 2, 1)
    wanted = np.zeros((count, near + 3, 1))
    wanted[:, :near, 0], wanted[:, near, 0] = np.linalg.norm(beside, axis=2) ** 3, 1.0
    weight = np.linalg.solve(table, wanted)[:, :near, 0]
    kept = np.where(np.abs(weight) > _ROUNDING, weight, 0.0)
    return Weights(rows, np.asarray(kept / kept.sum(axis=1, keepdims=True)))


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
