"""What part of the microlens plane feeds each pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.record import CameraTables
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.array import MicrolensModel


def pixel_centres(tables: CameraTables, rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.float64]:
    """(n, 2): centres of the pixels of a rectangle (first and end row and column), row by row: local x and y in mm."""
    x = -(np.arange(*columns) + 0.5 - tables.columns / 2) * tables.pitch
    y = (np.arange(*rows) + 0.5 - tables.rows / 2) * tables.pitch
    on_sensor = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    placed = tables.parts.sensor_to_local
    return np.ascontiguousarray(on_sensor @ placed.turn[:2, :2].T + placed.shift[:2])


MOST_CELLS = 100_000
"""Microlenses that may feed one pixel; beyond it, a rendering would not end."""


def cells_per_pixel(tables: CameraTables) -> float:
    """About how many microlenses are looked at for each pixel, at least 1.

    Raises
    ------
    InvalidValueError
        Where they are too many: the images of far too many microlenses overlap.
    """
    cells = tables.cells
    if cells is None:
        return 1.0
    gap = tables.z_plane - tables.bounds.z
    ratio = gap / tables.distance
    bend = 0.0
    if cells.model is not MicrolensModel.PINHOLE:
        bend = float(np.abs(1.0 + ratio - gap * cells.powers).max())
    reach = float(tables.bounds.reach.max()) + tables.slack + bend * cells.radius
    search = (reach + ratio * tables.pitch) / (1.0 + ratio) + cells.radius
    area = abs(float(np.linalg.det(cells.basis)))
    if cells.listed is not None:
        area = float(cells.listed.bins[2] ** 2 * (len(cells.listed.bin_first) - 1) / max(len(cells.listed.lenses), 1))
    count = 1.0 + np.pi * search**2 / area
    if count > MOST_CELLS:
        raise InvalidValueError(
            f"each pixel sees about {count:.3g} microlenses, and the limit is {MOST_CELLS}; their pitch is too small, "
            "or their images overlap too much: check the units, close the stop or reduce microlenses_to_sensor"
        )
    return count


class Regions(NamedTuple):
    """What feeds pixels."""

    triangles: NDArray[np.float64]
    """(n, TRIANGLE); see `pixel_regions`."""
    first: NDArray[np.int64]
    """(pixels + 1,): where each pixel's triangles begin."""
    details: NDArray[np.float64] | None
    """(n, LANE): what paths keep of their microlens (see `to_lens`); None where these do not differ."""


_NO_BINS = (None, None, None, np.zeros((0, 10)), np.zeros((0, 1, 0, 2)), np.zeros((0, 1), np.int64))


def feeding_regions(tables: CameraTables, pixels: NDArray[np.float64], margin: float) -> Regions:
    """Triangles that cover what feeds each pixel.

    `margin` is the distance from a pixel's centre to the points of it that matter, in mm.

    Raises
    ------
    InvalidValueError
        Where far too many microlenses feed each pixel; see `cells_per_pixel`.
    """
    from plenoptic.camera.sampling.kernels import pixel_regions
    from plenoptic.optics.microlens.kernels.to_lens import LANE

    cells_per_pixel(tables)
    first = np.zeros(len(pixels) + 1, dtype=np.int64)
    cells, bounds = tables.cells, tables.bounds
    room = 16 * len(pixels)
    while True:
        triangles = np.empty((room, pixel_regions.TRIANGLE))
        details = None
        if cells is None:
            needed = pixel_regions.fill_pupil_regions(
                triangles, first, pixels, bounds.corners, bounds.reach, bounds.step
            )
        else:
            details = np.empty((room, LANE)) if cells.differs else None
            needed = pixel_regions.fill_cell_regions(
                triangles,
                details,
                first,
                pixels,
                margin,
                tables.distance,
                tables.lean,
                tables.gap,
                tables.frame,
                cells.model is MicrolensModel.PINHOLE,
                cells.origin,
                cells.basis,
                cells.inverse,
                cells.corners,
                cells.powers,
                cells.pattern,
                cells.clip,
                *(_NO_BINS if cells.listed is None else cells.listed[:6]),
                cells.radius,
                cells.cell if cells.walls else None,
                tables.slack,
                bounds.normals,
                bounds.support,
                bounds.reach,
                bounds.step,
            )
        if needed <= room:
            return Regions(triangles[:needed], first, None if details is None else details[:needed])
        room = needed
