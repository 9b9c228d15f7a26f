"""Pixels of the raw image as samples of a picture, and the kernel that makes the picture of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.report.optics import opening_width
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats
from plenoptic.lightfield.focused.pixel_rays import PixelRays, Pupil
from plenoptic.optics.microlens.array import MicrolensArray

_WIDTH = 0.6
"""Of a window: the standard deviation of its weights, in pixels of the picture."""
_SAMPLES = 1.2
"""The same in roots of the area of the picture that a sample has, where that is more."""
_CUT = 3.0
"""Widths at which a window ends."""
_DEPTH = 1.0
"""Pixels by which rays through the middle and the rim of the pupil may differ within a surface."""
_NONE, _FULL = 0.1, 0.65
"""A surface whose samples are so dense, over what it has where nothing hides it, shows nothing or fills a pixel."""
_PIVOT = 0.1
"""Samples fix a function where each of its terms varies so much among them, beside the terms before it."""
_ROWS = 8
"""Of the picture, a task."""


class Splats(NamedTuple):
    """n samples of a picture, those of a cell together; lengths are pixels of the picture."""

    first: NDArray[np.int64]
    """Where those of each cell begin, and the last end."""
    place: Floats
    """(n, 2): from the middle of the cell, down and along."""
    nearness: Floats
    """Grows towards the camera."""
    disparity: Floats
    weight: Floats
    area: Floats
    """Of the picture, for each sample, where nothing hides the surface."""
    pixel: Floats
    """Variance of the footprint of the pixel alone along each axis."""
    spread: Floats
    """Variance of the footprint."""
    radiance: Floats
    variance: Floats | None


class Window(NamedTuple):
    """How samples around a pixel are taken."""

    shape: tuple[int, int]
    width: float
    cut: float
    depth: float
    """Difference of nearness within a surface."""
    none: float
    full: float
    terms: int
    pivot: float
    largest: float
    """The largest variance of a pixel's footprint."""


class Near(NamedTuple):
    """Room for the samples around a pixel."""

    number: NDArray[np.int64]
    share: Floats
    cover: Floats
    down: Floats
    along: Floats
    used: Floats


class Surfaces(NamedTuple):
    """What is known of the samples of a picture as a whole."""

    depth: float
    """Difference of nearness within a surface."""
    area: float
    """Of the picture, for each sample."""
    terms: int
    """Of the function that is fitted: 6 quadratic, 3 linear."""


class Canvas(NamedTuple):
    """A picture."""

    picture: Floats
    variance: Floats | None
    disparity: Floats
    coverage: Floats


class Grid(NamedTuple):
    """Its pixels on the array: row i lies at y = (first[0] + i) spacing, column j at -x = (first[1] + j) spacing."""

    first: tuple[int, int]
    shape: tuple[int, int]
    spacing: float

    def places(self) -> Floats:
        """(rows, columns, 2): x and y in mm."""
        y, x = ((self.first[k] + np.arange(self.shape[k])) * self.spacing for k in range(2))
        return np.stack(np.broadcast_arrays(-x[None, :], y[:, None]), axis=-1)


class Footprint(NamedTuple):
    """What a sample's pixel and microlens blur, as variances on the array in mm^2 along each axis."""

    pixel: Floats
    lens: Floats

    def blur(self) -> Floats:
        """The radius of the image of a point, in pixels of the raw image."""
        return np.asarray(np.sqrt(self.lens / (3.0 * self.pixel)))


def grid_of(rays: PixelRays, spacing: float) -> Grid:
    """The grid that covers the microlenses; pixels lie at whole multiples of the spacing."""
    places = rays.through * (-1.0, 1.0) / spacing
    low, high = np.ceil(places.min(axis=0)).astype(int), np.floor(places.max(axis=0)).astype(int)
    columns, rows = np.maximum(high - low + 1, 1).tolist()
    return Grid((int(low[1]), int(low[0])), (rows, columns), spacing)


def footprints(
    array: MicrolensArray, rays: PixelRays, pupil: Pupil, nearness: Floats, pixel: float, wavelength: float
) -> Footprint:
    """Of pixels of side `pixel`, seen at a nearness a / (1 + a V) of images a behind the array, V the pupil's vergence.

    From there a pixel is p a / b large, and the opening w of a microlens w (1 - a / a_f), with 1 / a_f = 1 / b - 1 / f.
    The pupil sees both smaller by 1 + a V.
    """
    focal = np.array(array.focal_lengths_at(wavelength))[rays.type]
    bent = pupil.vergence + 1.0 / rays.to_sensor - 1.0 / focal
    seen, opened = pixel * nearness / rays.to_sensor, opening_width(array) * (1.0 - bent * nearness)
    # Of a square, and of a disc.
    return Footprint(seen**2 / 12.0, opened**2 / 16.0)


def surface_depth(pupil: Pupil, spacing: float) -> float:
    """Difference of nearness within a surface."""
    return _DEPTH * spacing / abs(pupil.slope)


def sorted_splats(grid: Grid, on_array: Floats, samples: Splats) -> Splats:
    """The samples that fall on a grid, cell by cell; `first` and `place` are found from `on_array` (n, 2)."""
    places = on_array[:, ::-1] * (1.0, -1.0) / grid.spacing
    with np.errstate(invalid="ignore"):
        nearest = np.rint(places)
        cell = nearest - grid.first
        inside = ((cell >= 0) & (cell < grid.shape)).all(axis=1) & np.isfinite(samples.nearness)
    first, kept = sort_by_cell(cell, inside, grid.shape)
    chosen = [None if part is None else np.ascontiguousarray(part[kept]) for part in samples[2:]]
    return Splats(first, np.ascontiguousarray((places - nearest)[kept]), *chosen)  # type: ignore[arg-type]


def sort_by_cell(
    cell: Floats, inside: NDArray[np.bool_], shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Samples in cells (n, 2) that are inside, cell by cell: where those of each begin, and last end; their numbers."""
    kept = np.flatnonzero(inside)
    flat = cell[kept].astype(np.int64) @ (shape[1], 1)
    first = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=math.prod(shape)))]).astype(np.int64)
    return first, kept[np.argsort(flat, kind="stable")]


def splat_picture(splats: Splats, grid: Grid, surfaces: Surfaces, threads: int) -> Canvas:
    """The picture that samples make."""
    from plenoptic.lightfield.kernels.splat import WIDENINGS, WIDER, fill_view

    width, largest = max(_WIDTH, _SAMPLES * math.sqrt(surfaces.area)), float(splats.pixel.max(initial=0.0))
    window = Window(grid.shape, width, _CUT, surfaces.depth, _NONE, _FULL, surfaces.terms, _PIVOT, largest)
    shape = (*grid.shape, splats.radiance.shape[1])
    variance = None if splats.variance is None else np.empty(shape)
    canvas = Canvas(np.empty(shape), variance, np.empty(grid.shape), np.empty(grid.shape))
    reach = math.ceil(_CUT * max(width * WIDER ** (WIDENINGS - 1), math.hypot(width, math.sqrt(largest))))
    room = _most_in(splats.first, grid.shape, reach)

    def work(row: int) -> None:
        near = Near(np.empty(room, dtype=np.int64), *np.empty((5, room)))
        fit = np.empty(6), np.empty((6, 6)), np.empty(6)
        fill_view(canvas, splats, window, near, fit, (row, min(row + _ROWS, grid.shape[0])))

    for _ in run_in_order(work, range(0, grid.shape[0], _ROWS), threads=threads):
        pass
    return canvas


def _most_in(first: NDArray[np.int64], shape: tuple[int, int], reach: int) -> int:
    """The most samples in a square of cells, `reach` beyond the middle one."""
    sums = np.zeros((shape[0] + 1, shape[1] + 1), dtype=np.int64)
    sums[1:, 1:] = np.diff(first).reshape(shape).cumsum(axis=0).cumsum(axis=1)
    (top, bottom), (left, right) = (
        (np.maximum(np.arange(n) - reach, 0), np.minimum(np.arange(n) + reach + 1, n)) for n in shape
    )
    inside = sums[bottom][:, right] - sums[bottom][:, left] - sums[top][:, right] + sums[top][:, left]
    return int(inside.max(initial=0))
