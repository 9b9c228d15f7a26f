"""How far the rays of real microlenses stray from those of ideal ones: margins, found by tracing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.optics.microlenses import ConvexSide, MicrolensArray, MicrolensModel

_AIMS, _OFFSETS = 33, 49
_SAFETY = 1.25
"""Margins found on a grid of rays are widened by this factor."""
_NO_EDGES = np.zeros((0, 3))


def fill_plates(
    blocks: NDArray[np.float64], array: MicrolensArray, distance: float, z_plane: float, edges: NDArray[np.float64]
) -> None:
    """Aimed samples become rays through plano-convex lenses, exact or flat with a high index."""
    from plenoptic.optics import _lattice

    curved_first = array.convex_side is ConvexSide.SENSOR
    flat = array.model is MicrolensModel.FLAT_HIGH_INDEX
    curvature = (-1.0 if curved_first else 1.0) / array.radius
    _lattice.fill_plano_convex(
        blocks, distance, z_plane, curved_first, flat, curvature, array.thickness, array.index, edges
    )


def strays(
    camera: PlenopticCamera, array: MicrolensArray, ratio: float, bend: float, reach: float
) -> tuple[float, float]:
    """How far real rays stray from ideal ones on the plane of the outlines, and on the curved side, in mm.

    Rays of one lens are aimed from a row of sensor points at a grid of points on its rear principal plane; those
    count that meet the curved side inside the cell and pass the plane of the outlines within `reach` of the lens's
    own axis. A lens is round, so one row of sensor points stands for all.
    """
    slack = stray = 0.0
    for _ in range(4):
        offset = (reach + abs(bend) * array.cell_radius + slack) / ratio
        found = _strays_from(camera, array, ratio, bend, reach, offset)
        if found is None:
            return slack, stray
        settled = found[0] <= 1.01 * slack
        slack, stray = max(slack, _SAFETY * found[0]), max(stray, _SAFETY * found[1])
        if settled:
            break
    return slack, stray


def _strays_from(
    camera: PlenopticCamera, array: MicrolensArray, ratio: float, bend: float, reach: float, offset: float
) -> tuple[float, float] | None:
    """The same for sensor points up to `offset` from the lens's axis; None where no ray counts."""
    from plenoptic.optics._blocks import BLOCK

    distance, z_last = camera.microlenses_to_sensor, float(camera.lens.vertices[-1])
    aims = np.linspace(-1.5 * array.cell_radius, 1.5 * array.cell_radius, _AIMS)
    dx, dy, sx = (g.ravel() for g in np.meshgrid(aims, aims, np.linspace(0.0, offset, _OFFSETS), indexing="ij"))
    fields = np.zeros((8, -(-dx.size // BLOCK) * BLOCK))
    for row, column in ((0, dx), (1, dy), (3, dx - sx), (4, dy)):
        fields[row, : dx.size] = column
    blocks = np.ascontiguousarray(fields.reshape(8, -1, BLOCK).transpose(1, 0, 2))
    fill_plates(blocks.reshape(-1), array, distance, camera.stop_to_microlenses, _NO_EDGES)
    x, y, z, u, v, w, _, status = blocks.transpose(1, 0, 2).reshape(8, -1)[:, : dx.size]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        if array.convex_side is ConvexSide.SCENE:
            land_x, land_y = x, y
        elif array.model is MicrolensModel.FLAT_HIGH_INDEX:
            land_x, land_y = dx, dy
        else:
            land_x, land_y = _landing(array, dx, dy, (dx - sx) / distance, dy / distance)
        t = (z_last - z) / w
        real_x, real_y = x + t * u, y + t * v
        counts = (status == 0) & (np.hypot(land_x, land_y) <= array.cell_radius) & (np.hypot(real_x, real_y) <= reach)
        if not counts.any():
            return None
        off = np.hypot(real_x - (bend * dx - ratio * sx), real_y - bend * dy)
        beside = np.hypot(land_x - dx, land_y - dy)
    return float(off[counts].max()), float(beside[counts].max())


def _landing(
    array: MicrolensArray,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    slope_x: NDArray[np.float64],
    slope_y: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where rays through (x, y) of the vertex's plane meet the curved side, which recedes by its sag."""
    land_x, land_y = x, y
    for _ in range(8):
        r2 = np.minimum(land_x**2 + land_y**2, array.radius**2)
        sag = r2 / (array.radius + np.sqrt(array.radius**2 - r2))
        land_x, land_y = x + slope_x * sag, y + slope_y * sag
    return land_x, land_y
