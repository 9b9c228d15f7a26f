"""Resampling from the lattice of the microlenses to the square pixels of a view."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, value
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice, rows_of

_ROUNDING = 1e-9
"""Weights below it count as 0, so that a pixel at a microlens depends on no other."""
_NEIGHBOURS = 24
"""Microlenses that are interpolated for a pixel; more changed no measured error."""
_REACH = 3
"""Largest distance of these from the nearest microlens, in lattice steps."""
_BLOCK = 4096
"""Pixels whose weights are computed together, at 12 kB each."""
_DOUBT = {3: 1.0, 4: 1.2}
"""Interpolation error halfway between microlenses over the error of predicting a microlens from neighbours, if that is
as large from twice the distance: of meshes of triangles and of squares; measured for 1/f noise.
"""


@value
class Resampling:
    """Weights of the microlenses for each pixel of a view of `rows` x `columns` pixels.

    Where all neighbours are valid, values are interpolated by cubic radial basis functions and a linear function; at
    borders, linearly between the corners of the lattice's mesh.
    """

    rows: int
    columns: int
    linear: Weights
    smooth: Weights | None
    """Cubic weights; None if every pixel coincides with a microlens."""
    prediction: Weights | None
    """Weights that predict each microlens from its neighbours; None without errors or interpolation."""
    far_prediction: Weights | None
    """The same from microlenses at twice the distance."""
    origin: Floats
    """(2,): x and y of the first pixel, mm."""
    spacing: tuple[float, float]
    """Pixel spacing along x and y, mm."""

    def interpolate(self, values: Floats, power: int = 1) -> Floats:
        """Interpolate values (n, C) of the microlenses to (rows, columns, C); nan where one is missing.

        Weights are raised to `power`. With power 2, variances become variances: light of different microlenses falls on
        different pixels, so that their errors are independent.
        """
        interpolated = (self.linear if self.smooth is None else self.smooth).interpolate(values, power)
        missing = np.isnan(interpolated)
        if self.smooth is not None and missing.any():
            interpolated = np.where(missing, self.linear.interpolate(values, power), interpolated)
        return interpolated.reshape(self.rows, self.columns, -1)

    def local_mean(self, values: Floats) -> Floats:
        """Mean (rows, columns, C) of the valid values (n, C) of microlenses around 3 x 3 pixels."""
        mean = (self.linear if self.smooth is None else self.smooth).mean_of_valid(values)
        mean = mean.reshape(self.rows, self.columns, -1)
        for _ in range(2):
            padded = np.concatenate([mean[:1], mean, mean[-1:]])
            mean = ((padded[:-2] + padded[1:-1] + padded[2:]) / 3.0).swapaxes(0, 1)
        return mean

    def interpolation_variance(self, values: Floats, variance: Floats) -> Floats:
        """Variance (rows, columns, C) of the interpolation error, from values and variances (n, C).

        Each microlens is predicted from its neighbours. The prediction error beyond the noise measures detail that the
        lattice does not resolve. From twice the distance it is larger by 2^2H (H = 0: white noise); over half of the
        distance, between microlenses, smaller by 2^H. It is 0 at a microlens.
        """
        if self.smooth is None or self.prediction is None or self.far_prediction is None:
            return np.zeros((self.rows, self.columns, values.shape[1]))
        excess = [
            (values - weights.interpolate(values)) ** 2 - variance - weights.interpolate(variance, 2)
            for weights in (self.prediction, self.far_prediction)
        ]
        near, far = np.split(np.maximum(self.local_mean(np.hstack(excess)), 0.0), 2, axis=2)
        growth = np.divide(near, far, out=np.ones_like(far), where=far > near)
        distance_weight = np.clip(1.0 - (self.smooth.weight**2).sum(axis=1), 0.0, 1.0).reshape(self.rows, -1, 1)
        return np.asarray(_DOUBT[self.linear.weight.shape[1]] ** 2 * distance_weight * np.sqrt(growth) * near)


class Weights(NamedTuple):
    """Weighted sums of k microlenses for each of n points."""

    source: NDArray[np.int64]
    """(n, k): rows of the microlenses; -1 for none."""
    weight: Floats
    """(n, k): weights, whose sum is 1."""

    def interpolate(self, values: Floats, power: int = 1) -> Floats:
        """Weighted sums (n, C) of values (m, C), with the weights to a power; nan where one is missing."""
        # Row -1 stands for a missing microlens.
        padded = np.vstack([values, np.full((1, values.shape[1]), np.nan)])
        total = np.zeros((len(self.source), values.shape[1]))
        for k in range(self.source.shape[1]):
            weight = self.weight[:, k, None] ** power
            # A missing value with weight 0 does not count (nan times 0 is nan).
            total += np.where(weight != 0, weight * padded[self.source[:, k]], 0.0)
        return total

    def mean_of_valid(self, values: Floats) -> Floats:
        """Mean (n, C) of the valid values (m, C) alone, with the absolute weights; 0 without one."""
        # Row -1 stands for a missing microlens.
        padded = np.vstack([values, np.full((1, values.shape[1]), np.nan)])
        valid = np.isfinite(padded).astype(np.float64)
        padded, (total, weights) = np.nan_to_num(padded), np.zeros((2, len(self.source), values.shape[1]))
        for k in range(self.source.shape[1]):
            weight, source = np.abs(self.weight[:, k, None]), self.source[:, k]
            total += weight * padded[source]
            weights += weight * valid[source]
        return np.divide(total, weights, out=total, where=weights > 0)


def resampling(
    array: MicrolensArray,
    index: NDArray[np.int64],
    spacing: float | None,
    *,
    positions: Floats | None = None,
    basis: Floats | None = None,
    errors: bool = True,
) -> Resampling:
    """Weights that resample views of the microlenses `index` (n, 2) to a grid with a spacing in mm.

    Without a spacing, lattices with vectors along x and y keep their own, and others get square pixels of the area of a
    cell. Pixels lie at whole multiples of the spacing from the array's origin, so that views of a region are parts of
    the views of the whole, except at its border. `positions` (n, 2) are the actual positions of the microlenses, by
    default those of the lattice, and `basis` (2, 2) its vectors, by default the array's. Without `errors`, no
    interpolation error is estimated.
    """
    basis = array.basis if basis is None else basis
    design = index @ basis
    positions = design if positions is None else positions
    size = np.abs(basis)
    axis_parallel = (
        min(np.delete(size.ravel(), (0, 3)).max(), np.delete(size.ravel(), (1, 2)).max()) < _ROUNDING * size.max()
    )
    if spacing is not None:
        pixel_spacing = (spacing, spacing)
    elif axis_parallel and array.lattice is not Lattice.HEXAGONAL:
        pixel_spacing = (float(size[:, 0].max()), float(size[:, 1].max()))
    else:
        pixel_spacing = (math.sqrt(array.cell_area),) * 2
    low, high = design.min(axis=0), design.max(axis=0)
    first = [math.ceil(low[k] / pixel_spacing[k] - _ROUNDING) for k in range(2)]
    last = [max(math.floor(high[k] / pixel_spacing[k] + _ROUNDING), first[k]) for k in range(2)]
    # The sensor is read out rotated by 180 degrees: columns run towards -x, rows towards +y.
    x = pixel_spacing[0] * np.arange(last[0], first[0] - 1, -1)
    y = pixel_spacing[1] * np.arange(first[1], last[1] + 1)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    on_lattice = points @ np.linalg.inv(basis)
    nodes, weight = (_triangle if array.lattice is Lattice.HEXAGONAL else _mesh)(on_lattice)
    lenses = Lenses(index, positions, basis)
    linear = _linear(lenses, points, nodes, weight)
    smooth = prediction = far_prediction = None
    if linear.weight.max(axis=1).min() < 1.0 - _ROUNDING:
        smooth = _cubic(lenses, points, on_lattice, include_self=True)
        if errors:
            prediction, far_prediction = (
                _cubic(lenses, positions, index.astype(np.float64), include_self=False, distance=k) for k in (1, 2)
            )
    origin = np.array([x[0], y[0]])
    return Resampling(len(y), len(x), linear, smooth, prediction, far_prediction, origin, pixel_spacing)


class Lenses(NamedTuple):
    """Lattice indices of microlenses, and their actual positions in mm."""

    lattice_index: NDArray[np.int64]
    positions: Floats
    basis: Floats

    def around(self, points: Floats, nodes: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats]:
        """Rows (n, k) of the microlenses at lattice nodes (n, k, 2), -1 for none, and their offsets from points."""
        rows = rows_of(self.lattice_index, nodes)
        return rows, np.where(rows[..., None] >= 0, self.positions[rows], nodes @ self.basis) - points[:, None]


def _linear(lenses: Lenses, points: Floats, nodes: NDArray[np.int64], weight: Floats) -> Weights:
    """Weights of the corners of a mesh, with the least change that reproduces linear functions at actual positions."""
    rows, offset = lenses.around(points, nodes)
    scale = float(np.abs(lenses.basis).max())
    table = np.concatenate([np.ones((*rows.shape, 1)), offset / scale], axis=2)
    error = np.array([1.0, 0.0, 0.0]) - np.einsum("nk,nkc->nc", weight, table)
    inexact = np.abs(error).max(axis=1) > _ROUNDING
    if inexact.any():
        inexact_table = table[inexact]
        squares = inexact_table.transpose(0, 2, 1) @ inexact_table
        weight = weight.copy()
        weight[inexact] += (inexact_table @ np.linalg.solve(squares, error[inexact][..., None]))[..., 0]
    return Weights(rows, weight)


def _cubic(lenses: Lenses, points: Floats, on_lattice: Floats, *, include_self: bool, distance: int = 1) -> Weights:
    """Weights of the nearest microlenses for points (n, 2): cubic radial basis functions that reproduce linear ones.

    Without `include_self`, the microlens at the point itself is left out. At a `distance` of 2, every other microlens
    counts, up to 8. G. B. Wright, Radial Basis Function Interpolation, PhD thesis, University of Colorado (2003),
    section 2.
    """
    reach = _REACH if distance == 1 else 1
    steps = distance * np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), -1).reshape(-1, 2)
    parts = [
        _cubic_block(lenses, points[k : k + _BLOCK], on_lattice[k : k + _BLOCK], steps, include_self)
        for k in range(0, len(points), _BLOCK)
    ]
    return Weights(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _cubic_block(
    lenses: Lenses, points: Floats, on_lattice: Floats, steps: NDArray[np.int64], include_self: bool
) -> Weights:
    rows, offset = lenses.around(points, np.rint(on_lattice).astype(np.int64)[:, None] + steps)
    offset = offset / float(np.sqrt(abs(np.linalg.det(lenses.basis))))
    squared_distance = (offset**2).sum(axis=2)
    # Distances that differ by rounding alone keep the order of the lattice.
    first = 0 if include_self else 1
    order = np.argsort(np.round(squared_distance, 9), axis=1, kind="stable")[:, first : first + _NEIGHBOURS]
    rows, offset = np.take_along_axis(rows, order, axis=1), np.take_along_axis(offset, order[..., None], axis=1)
    count, n_lenses = rows.shape
    table = np.zeros((count, n_lenses + 3, n_lenses + 3))
    table[:, :n_lenses, :n_lenses] = np.linalg.norm(offset[:, :, None] - offset[:, None], axis=3) ** 3
    linear = np.concatenate([np.ones((count, n_lenses, 1)), offset], axis=2)
    table[:, :n_lenses, n_lenses:], table[:, n_lenses:, :n_lenses] = linear, linear.transpose(0, 2, 1)
    right_side = np.zeros((count, n_lenses + 3, 1))
    right_side[:, :n_lenses, 0], right_side[:, n_lenses, 0] = np.linalg.norm(offset, axis=2) ** 3, 1.0
    return Weights(rows, _drop_rounding(np.linalg.solve(table, right_side)[:, :n_lenses, 0]))


def _triangle(point: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Triangle of three neighbouring lattice points (n, 3, 2) around each point, and barycentric weights (n, 3).

    Points (n, 2) are in units of the lattice vectors, which enclose 60 degrees. The short diagonal of their mesh, from
    (1, 0) to (0, 1), divides it into two equilateral triangles.
    """
    corner, fraction = _split(point)
    s = fraction.sum(axis=1)
    lower = s <= 1.0
    third = np.where(lower[:, None], [0, 0], [1, 1])
    nodes = np.stack([corner + third, corner + np.array([1, 0]), corner + np.array([0, 1])], axis=1)
    barycentric = np.where(lower[:, None], fraction, 1.0 - fraction[:, ::-1])
    weight = np.column_stack([1.0 - barycentric.sum(axis=1), barycentric])
    return nodes, _drop_rounding(weight)


def _mesh(point: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Four corners (n, 4, 2) of the mesh around each point, and bilinear weights (n, 4)."""
    corner, fraction = _split(point)
    steps = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    factors = np.where(steps[None] == 1, fraction[:, None], 1.0 - fraction[:, None])
    return corner[:, None] + steps, _drop_rounding(factors.prod(axis=2))


def _split(point: Floats) -> tuple[NDArray[np.int64], Floats]:
    corner = np.floor(point + _ROUNDING)
    return corner.astype(np.int64), np.clip(point - corner, 0.0, 1.0)


def _drop_rounding(weight: Floats) -> Floats:
    significant = np.where(np.abs(weight) > _ROUNDING, weight, 0.0)
    return np.asarray(significant / significant.sum(axis=1, keepdims=True))
