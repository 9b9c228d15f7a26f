"""Pixels of the raw image as samples of a picture, and the rendering of the picture from them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.gaussian import opening_width
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats
from plenoptic.lightfield.focused.pixel_rays import PixelRays, Pupil

_WIDTH = 0.6
"""Standard deviation of a window's weights, in pixels of the picture."""
_SAMPLES = 1.2
"""The same in units of the sample spacing (root of the area per sample), if that is larger."""
OVERSHOOT = 0.25
"""Largest excess of a picture over its samples, as a fraction of their range; deblurring and noise cause some."""
_DEPTH = 1.0
"""Largest difference in pixels, within a surface, between rays through the centre and the rim of the pupil."""
_ROWS = 8
"""Rows of the picture in one task."""


class Splats(NamedTuple):
    """n samples of a picture, sorted by cell; lengths are in pixels of the picture."""

    first: NDArray[np.int64]
    """Index of the first sample of each cell, and the end of the last."""
    offset: Floats
    """(n, 2): offset from the centre of the cell, down and along."""
    nearness: Floats
    """Increases towards the camera."""
    disparity: Floats
    weight: Floats
    area: Floats
    """Area of the picture per sample on an unoccluded surface."""
    pixel: Floats
    """Variance of the footprint of the pixel alone along each axis."""
    spread: Floats
    """Variance of the footprint."""
    radiance: Floats
    variance: Floats | None
    lens: NDArray[np.int64] | None = None
    """Number of the microlens."""


class Window(NamedTuple):
    """Parameters of the window of samples around a pixel."""

    shape: tuple[int, int]
    width: float
    depth: float
    """Largest difference of nearness within a surface."""
    terms: int
    """Terms of the fitted function: 6 quadratic, 3 linear."""
    max_pixel_variance: float
    """Largest variance of a pixel's footprint."""
    points: Floats | None
    """(lenses, 1, 2): positions of microlenses, in cells, that are predicted from the other ones; None: all cells."""


class Near(NamedTuple):
    """Work arrays for the samples around a pixel."""

    number: NDArray[np.int64]
    nearness: Floats
    weight: Floats
    cover: Floats
    down: Floats
    along: Floats
    spread: Floats
    """Offset from the pixel in widths of the window, and variance of the footprint beyond a pixel's, in their squares.
    """
    fit_weight: Floats


class Canvas(NamedTuple):
    """A picture, its variance, disparity and coverage."""

    picture: Floats
    variance: Floats | None
    disparity: Floats
    coverage: Floats


class Grid(NamedTuple):
    """Pixel grid on the array: row i lies at y = (first[0] + i) spacing, column j at -x = (first[1] + j) spacing."""

    first: tuple[int, int]
    shape: tuple[int, int]
    spacing: float

    def positions(self) -> Floats:
        """Positions (rows, columns, 2) of the pixels: x and y in mm."""
        y, x = ((self.first[k] + np.arange(self.shape[k])) * self.spacing for k in range(2))
        return np.stack(np.broadcast_arrays(-x[None, :], y[:, None]), axis=-1)


def grid_of(rays: PixelRays, spacing: float) -> Grid:
    """The grid that covers the microlenses; pixels lie at whole multiples of the spacing."""
    positions = rays.through * (-1.0, 1.0) / spacing
    low, high = np.ceil(positions.min(axis=0)).astype(int), np.floor(positions.max(axis=0)).astype(int)
    columns, rows = np.maximum(high - low + 1, 1).tolist()
    return Grid((int(low[1]), int(low[0])), (rows, columns), spacing)


def footprints(rays: PixelRays, nearness: Floats) -> tuple[Floats, Floats]:
    """Variances of footprints on the array along each axis, mm^2: by the pixel, and by its microlens.

    The nearness is a / (1 + a V); the image lies a behind the array, and V is the vergence of the pupil. From the image
    a pixel is p a / b large, and the microlens aperture w is w (1 - a / a_f), with 1/a_f = 1/b - 1/f. The pupil sees
    both smaller by 1 + a V.
    """
    focal = np.array(rays.array.focal_lengths_at(rays.camera.wavelength))[rays.type]
    vergence = rays.pupil.vergence + 1.0 / rays.to_sensor - 1.0 / focal
    pixel_width = rays.camera.sensor.pixel_pitch * nearness / rays.to_sensor
    aperture_width = opening_width(rays.array) * (1.0 - vergence * nearness)
    # Variances of a square and of a disc.
    return pixel_width**2 / 12.0, aperture_width**2 / 16.0


def surface_depth(pupil: Pupil, spacing: float) -> float:
    """Largest difference of nearness within a surface."""
    return _DEPTH * spacing / abs(pupil.slope)


def sort_splats(grid: Grid, on_array: Floats, samples: Splats) -> Splats:
    """Sort the samples on a grid by cell; `first` and `offset` follow from `on_array` (n, 2)."""
    positions = np.stack([on_array[:, 1] / grid.spacing, -on_array[:, 0] / grid.spacing], axis=1)
    nearest = np.rint(positions)
    cell, inside = nearest - grid.first, np.isfinite(samples.nearness)
    with np.errstate(invalid="ignore"):
        for along_axis, n in zip(cell.T, grid.shape, strict=True):
            inside &= (along_axis >= 0) & (along_axis < n)
    first, order = sort_by_cell(cell, inside, grid.shape)
    columns = [None if column is None else np.take(column, order, axis=0) for column in samples[2:]]
    return Splats(first, np.take(positions - nearest, order, axis=0), *columns)  # type: ignore[arg-type]


def sort_by_cell(
    cell: Floats, inside: NDArray[np.bool_], shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sort samples of cells (n, 2) that are inside: the first index of each cell with the end, and sample numbers."""
    numbers, cells = np.flatnonzero(inside), math.prod(shape)
    down, along = cell[numbers].T
    flat = (down * shape[1] + along).astype(np.min_scalar_type(cells))  # the sort of short integers is linear
    first = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=cells))]).astype(np.int64)
    return first, numbers[np.argsort(flat, kind="stable")]


def splat_picture(  # noqa: PLR0913
    splats: Splats,
    grid: Grid,
    depth: float,
    area: float,
    terms: int,
    threads: int,
    *,
    width: float = _WIDTH,
    points: Floats | None = None,
) -> Canvas:
    """Render the picture of samples that stand for a mean area each, by functions of 6, 3 or 1 terms.

    Within a surface, nearness differs by up to `depth`. `width` is the least standard deviation of a window's weights.
    `points` (lenses, 1, 2), in pixels of the grid, are rendered in its place, each from samples of other microlenses.
    """
    from plenoptic.lightfield.kernels.splat import CUT, WIDENINGS, WIDER, fill_view

    width, largest = max(width, _SAMPLES * math.sqrt(area)), float(splats.pixel.max(initial=0.0))
    window = Window(grid.shape, width, depth, terms, largest, points)
    shape = grid.shape if points is None else points.shape[:2]
    planes = (*shape, splats.radiance.shape[1])
    variance = None if splats.variance is None else np.empty(planes)
    canvas = Canvas(np.empty(planes), variance, np.empty(shape), np.empty(shape))
    reach = math.ceil(CUT * max(width * WIDER ** (WIDENINGS - 1), math.hypot(width, math.sqrt(largest))))
    capacity = _max_samples(splats.first, grid.shape, reach)

    def fill_rows(row: int) -> None:
        near = Near(np.empty(capacity, dtype=np.int64), *np.empty((7, capacity)))
        fit = np.empty(6), np.empty((6, 6))
        fill_view(canvas, splats, window, near, fit, (row, min(row + _ROWS, shape[0])))

    for _ in run_in_order(fill_rows, range(0, shape[0], _ROWS), threads=threads):
        pass
    return canvas


def _max_samples(first: NDArray[np.int64], shape: tuple[int, int], reach: int) -> int:
    """Largest number of samples in a square of cells, `reach` beyond the central one."""
    sums = np.zeros((shape[0] + 1, shape[1] + 1), dtype=np.int64)
    sums[1:, 1:] = np.diff(first).reshape(shape).cumsum(axis=0).cumsum(axis=1)
    (top, bottom), (left, right) = (
        (np.maximum(np.arange(n) - reach, 0), np.minimum(np.arange(n) + reach + 1, n)) for n in shape
    )
    inside = sums[bottom][:, right] - sums[bottom][:, left] - sums[top][:, right] + sums[top][:, left]
    return int(inside.max(initial=0))
