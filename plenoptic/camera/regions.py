"""What part of the microlens plane feeds each pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.tables import CameraTables
from plenoptic.errors import InvalidValueError


def pixel_centres(tables: CameraTables, rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.float64]:
    """(n, 2): centres in mm on the sensor of the pixels of a rectangle (first and end row and column), row by row."""
    x = -(np.arange(*columns) + 0.5 - tables.columns / 2) * tables.pitch
    y = (np.arange(*rows) + 0.5 - tables.rows / 2) * tables.pitch
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


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
    radius = float(np.hypot(*cells.corners.T).max())
    reach = float(tables.bounds.reach.max()) + cells.slack + abs(cells.bend) * radius
    search = (reach + tables.ratio * tables.pitch) / (1.0 + tables.ratio)
    count = 1.0 + np.pi * search**2 / abs(float(np.linalg.det(cells.basis)))
    if count > MOST_CELLS:
        raise InvalidValueError(
            f"each pixel sees about {count:.3g} microlenses, and the limit is {MOST_CELLS}; their pitch is too small, "
            "or their images overlap too much: check the units, close the stop or reduce microlenses_to_sensor"
        )
    return count


def feeding_regions(
    tables: CameraTables, pixels: NDArray[np.float64], margin: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Triangles that cover what feeds each pixel, and where each pixel's triangles begin.

    `margin` is the distance from a pixel's centre to the points of it that matter, in mm.
    """
    from plenoptic.camera import _regions

    first = np.zeros(len(pixels) + 1, dtype=np.int64)
    cells, bounds = tables.cells, tables.bounds
    room = 16 * len(pixels)
    while True:
        triangles = np.empty((room, _regions.TRIANGLE))
        if cells is None:
            needed = _regions.fill_pupil_regions(triangles, first, pixels, bounds.corners, bounds.reach, bounds.step)
        else:
            needed = _regions.fill_cell_regions(
                triangles,
                first,
                pixels,
                margin,
                cells.basis,
                cells.inverse,
                cells.corners,
                tables.ratio,
                cells.bend,
                cells.slack,
                bounds.normals,
                bounds.support,
                bounds.reach,
                bounds.step,
            )
        if needed <= room:
            return triangles[:needed], first
        room = needed
