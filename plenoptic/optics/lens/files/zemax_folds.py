"""Coordinate breaks and mirrors of Zemax files: they become placements of the elements that follow.

A coordinate break moves and turns the axes of later elements: it is decentred by PARM 1 and 2, then turned by PARM 3, 4
and 5 degrees about its x, y, z; with PARM 6 not 0 turned first, about z, y, x, then decentred. A mirror folds the path:
later elements are seen in the mirror, a curved one in the plane that touches its vertex, which is unfolded here, so
that light goes along +z throughout. Lengths along the path stay those of the file, and so does everything paraxial.
Plane mirrors vanish then; see `Mirror` for the others.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import PrescriptionError
from plenoptic.optics.lens.files.zemax_stack import Row
from plenoptic.optics.lens.placement import Placement, rotation_about_axis
from plenoptic.optics.surfaces.mirror import Mirror

_ROUNDING = 1e-12
"""mm, and of the elements of a matrix: a placement that differs by less from none is none."""


def is_folded(rows: list[Row]) -> bool:
    """True if any row is a coordinate break or a mirror."""
    return any(row.turn is not None or row.is_mirror for row in rows)


def unfold(rows: list[Row], where: str) -> tuple[list[Row], bool]:
    """Rows with breaks and plane mirrors as rows that vanish, and whether the image stands off the axis."""
    origin, axes, along = np.zeros(3), np.eye(3), 0.0
    # From places in the file to places in the unfolded path, and whether light goes along the axis or against it.
    axes_seen, offset, sense = np.eye(3), np.zeros(3), 1.0
    unfolded_rows, before = [rows[0]], rows[0].medium
    for row in rows[1:]:
        if row.turn is not None:
            shift, rotation = _break(row.turn)
            origin, axes = origin + axes @ shift, axes @ rotation
        gap = row.gap * sense if row is not rows[-1] else 0.0
        place = _placement(axes_seen @ origin + offset - (0.0, 0.0, along), axes_seen @ axes * (1.0, 1.0, sense))
        facing, curved = sense, row.is_mirror and not row.is_plane
        fold = Mirror() if place is None else Mirror(place.rotation[:, 2])
        if row.is_mirror:
            if row.is_plane and row.is_stop:
                raise PrescriptionError(
                    f"{where}, line {row.lines.get('GLAS', row.lines['SURF'])}: surface {row.number} is a plane mirror "
                    "and the stop; put the stop on a plane of its own"
                )
            normal = axes[:, 2]
            # The plane goes through the mirror's place on the axis, also where the mirror is decentred.
            point = axes_seen.T @ ([0.0, 0.0, along] - offset) if curved else origin
            offset = offset + 2.0 * (normal @ point) * (axes_seen @ normal)
            axes_seen, sense, gap = axes_seen @ (np.eye(3) - 2.0 * np.outer(normal, normal)), -sense, -gap
        if curved:
            unfolded_rows.append(_facing(row, facing)._replace(gap=gap, placement=place, medium=fold))
        elif row.is_mirror or row.turn is not None:
            # A plane mirror is as a window there: its rim stays, as a stop.
            unfolded_rows.append(
                Row(row.number, row.lines, gap=gap, medium=before, aperture=row.aperture, placement=place)
            )
        else:
            unfolded_rows.append(_facing(row, sense)._replace(gap=gap, placement=place))
            before = row.medium
        origin, along = origin + axes[:, 2] * gap * sense, along + gap
    return unfolded_rows, unfolded_rows[-1].placement is not None


def _break(turn: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Shift and rotation of a coordinate break, in the axes before it."""
    x, y, z = (rotation_about_axis(axis, math.radians(angle)) for axis, angle in enumerate(turn[2:5]))
    decentre = np.array([turn[0], turn[1], 0.0])
    if turn[5] == 0:
        return decentre, x @ y @ z
    rotation = z @ y @ x
    return rotation @ decentre, rotation


def _facing(row: Row, sense: float) -> Row:
    """A row as light meets it: behind an odd number of mirrors it comes from the other side."""
    if sense > 0:
        return row
    return row._replace(
        curvature=-row.curvature,
        aspheric=tuple(-a for a in row.aspheric),
        freeform=None if row.freeform is None else row.freeform.inverted,
        offset=-row.offset,
    )


def _placement(shift: Floats, rotation: Floats) -> Placement | None:
    """None where it differs from none by rounding only, which several turns by 45 degrees leave behind."""
    if np.abs(shift).max() <= _ROUNDING and np.abs(rotation - np.eye(3)).max() <= _ROUNDING:
        return None
    return Placement(shift, rotation)
