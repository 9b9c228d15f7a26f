"""What part of the microlens plane feeds each pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.tables import CameraTables


def pixel_centres(tables: CameraTables, rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.float64]:
    """(n, 2): centres in mm on the sensor of the pixels of a rectangle (first and end row and column), row by row."""
    x = -(np.arange(*columns) + 0.5 - tables.columns / 2) * tables.pitch
    y = (np.arange(*rows) + 0.5 - tables.rows / 2) * tables.pitch
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


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
