"""How far the rays of real microlenses stray from those of ideal ones: margins, found by tracing."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.models import ConvexSide
from plenoptic.optics.microlens.record import EdgesRecord, SensorPlane, plate_record

_AIMS, _OFFSETS = 33, 49
SAFETY = 1.25
"""Margins found on a grid of rays are widened by this factor."""
UNCUT = EdgesRecord(np.zeros((0, 3)), None, np.zeros((0, 3)), math.inf)
"""Edges that end nothing."""


def aberration_margins(
    array: MicrolensArray,
    wavelength: float,
    power: float,
    distance: float,
    pupil_distance: float,
    bend: float,
    reach: float,
) -> tuple[float, float]:
    """How far real rays stray from ideal ones on the plane of the outlines, and on the curved side, in mm.

    Rays of one lens are aimed from a row of sensor points at a grid of points on its rear principal plane; those
    count that meet the curved side inside the cell and pass the plane of the outlines within `reach` of the lens's
    own axis. A lens is round, so one row of sensor points stands for all. Ideal rays are those at 587.6 nm.
    """
    from plenoptic.core.kernels.ray_blocks import BLOCK
    from plenoptic.optics.microlens.kernels.plano_convex import fill_plano_convex

    sensor, plate, radius = SensorPlane(distance, None), plate_record(array, (wavelength,)), (array.index - 1.0) / power
    aims = np.linspace(-1.5 * array.cell_radius, 1.5 * array.cell_radius, _AIMS)
    margin = aside = 0.0
    for _ in range(4):
        # Sensor points as far from the lens's axis as light from them can pass the plane of the outlines within reach.
        farthest = (reach + abs(bend) * array.cell_radius + margin) * distance / pupil_distance
        dx, dy, sx = (g.ravel() for g in np.meshgrid(aims, aims, np.linspace(0.0, farthest, _OFFSETS), indexing="ij"))
        fields = np.zeros((8, -(-dx.size // BLOCK) * BLOCK))
        for row, column in ((0, dx), (1, dy), (3, dx - sx), (4, dy)):
            fields[row, : dx.size] = column
        blocks = np.ascontiguousarray(fields.reshape(8, -1, BLOCK).transpose(1, 0, 2))
        fill_plano_convex(blocks.reshape(-1), None, sensor, plate, power, UNCUT, pupil_distance, None)
        x, y, z, u, v, w, _, status = blocks.transpose(1, 0, 2).reshape(8, -1)[:, : dx.size]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            landing = np.stack([x, y] if array.convex_side is ConvexSide.SCENE else [dx, dy])
            if array.convex_side is not ConvexSide.SCENE and not array.model.is_flat:
                landing = _landing(radius, landing, np.stack([(dx - sx) / distance, dy / distance]))
            t = -z / w
            real_x, real_y = x + t * u, y + t * v
            counts = (status == 0) & (np.hypot(*landing) <= array.cell_radius) & (np.hypot(real_x, real_y) <= reach)
            off = np.hypot(real_x - (bend * dx - pupil_distance / distance * sx), real_y - bend * dy)[counts]
            beside = np.hypot(landing[0] - dx, landing[1] - dy)[counts]
        if not counts.any():
            break
        settled = off.max() <= 1.01 * margin
        margin, aside = max(margin, SAFETY * float(off.max())), max(aside, SAFETY * float(beside.max()))
        if settled:
            break
    return margin, aside


def _landing(radius: float, points: Floats, slopes: Floats) -> Floats:
    """Where rays through points (2, n) of the vertex's plane meet the curved side, which recedes by its sag."""
    land = points
    for _ in range(8):
        r2 = np.minimum(land[0] ** 2 + land[1] ** 2, radius**2)
        land = points + slopes * (r2 / (radius + np.sqrt(radius**2 - r2)))
    return land
