"""Coordinate breaks and mirrors of Zemax files: conversion to placements of the elements that follow.

A coordinate break decentres the axes of later elements by PARM 1 and 2, then tilts them by PARM 3, 4 and 5 degrees
about x, y, z. If PARM 6 is not 0, it tilts them first, about z, y, x, then decentres them. A mirror folds the path.
Here the path is unfolded: later elements are reflected in the mirror, or in the tangent plane at its vertex if it is
curved, so light travels along +z throughout. Lengths along the path, and hence all paraxial quantities, are those of
the file. Plane mirrors are removed; see `Mirror` for the others.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.files.text_lines import name_line_in_errors
from plenoptic.core.values import Floats
from plenoptic.errors import PrescriptionError
from plenoptic.optics.lens.files.zemax_stack import Row
from plenoptic.optics.lens.placement import Placement, rotation_about_axis
from plenoptic.optics.surfaces.mirror import Mirror

_ROUNDING = 1e-12
"""Tolerance in mm, and of the elements of a rotation matrix, below which a placement is dropped."""


def has_folds(rows: list[Row]) -> bool:
    """True if any row is a coordinate break or a mirror."""
    return any(row.turn is not None or row.is_mirror for row in rows)


def with_mirrors_of_negative_index(rows: list[Row], where: str) -> list[Row]:
    """Rows whose mirrors are written as a change of the sign of the index, with mirrors instead."""
    if not any(row.is_negative for row in rows):
        return rows
    converted, before = rows[:1], rows[0]
    for row in rows[1:-1]:
        if row.turn is None and not row.is_mirror:
            if is_mirror := row.is_negative != before.is_negative:
                with name_line_in_errors(where, row.lines.get("GLAS", row.lines["SURF"])):
                    if row.medium != before.medium:
                        raise PrescriptionError(
                            f"the index behind surface {row.number} has another sign and another value than before it; "
                            "a mirror has the same value"
                        )
            before = row
            row = row._replace(is_mirror=is_mirror)
        converted.append(row)
    return [*converted, rows[-1]]


def unfold(rows: list[Row], where: str) -> tuple[list[Row], bool]:
    """Replace breaks and plane mirrors by rows that are removed later; the flag is True if the image is decentred or
    tilted.
    """
    origin, axes, along = np.zeros(3), np.eye(3), 0.0
    # Transform from the folded system of the file to the unfolded path, and direction of travel along the axis.
    axes_seen, offset, sense = np.eye(3), np.zeros(3), 1.0
    unfolded_rows, before = [rows[0]], rows[0].medium
    for row in rows[1:]:
        if row.turn is not None:
            shift, rotation = _break(row.turn)
            origin, axes = origin + axes @ shift, axes @ rotation
        gap = row.gap * sense if row is not rows[-1] else 0.0
        placement = _placement(axes_seen @ origin + offset - (0.0, 0.0, along), axes_seen @ axes * (1.0, 1.0, sense))
        facing, curved = sense, row.is_mirror and not row.is_plane
        fold = Mirror() if placement is None else Mirror(placement.rotation[:, 2])
        if row.is_mirror:
            if row.is_plane and row.is_stop:
                raise PrescriptionError(
                    f"{where}, line {row.lines.get('GLAS', row.lines['SURF'])}: surface {row.number} is a plane mirror "
                    "and the stop; put the stop on a plane of its own"
                )
            normal = axes[:, 2]
            # The plane passes through the nominal vertex of the mirror on the axis, also if the mirror is decentred.
            point = axes_seen.T @ ([0.0, 0.0, along] - offset) if curved else origin
            offset = offset + 2.0 * (normal @ point) * (axes_seen @ normal)
            axes_seen, sense, gap = axes_seen @ (np.eye(3) - 2.0 * np.outer(normal, normal)), -sense, -gap
        if curved:
            unfolded_rows.append(_facing(row, facing)._replace(gap=gap, placement=placement, medium=fold))
        elif row.is_mirror or row.turn is not None:
            # An unfolded plane mirror is a window: its rim becomes a stop.
            unfolded_rows.append(
                Row(row.number, row.lines, gap=gap, medium=before, aperture=row.aperture, placement=placement)
            )
        else:
            unfolded_rows.append(_facing(row, sense)._replace(gap=gap, placement=placement))
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
    """Row as seen in the direction of travel, which an odd number of mirrors reverses."""
    if sense > 0:
        return row
    return row._replace(
        curvature=-row.curvature,
        aspheric=tuple(-a for a in row.aspheric),
        freeform=None if row.freeform is None else row.freeform.inverted,
        offset=-row.offset,
    )


def _placement(shift: Floats, rotation: Floats) -> Placement | None:
    """Placement, or None if it is the identity up to rounding errors, such as those of several 45 degree tilts."""
    if np.abs(shift).max() <= _ROUNDING and np.abs(rotation - np.eye(3)).max() <= _ROUNDING:
        return None
    return Placement(shift, rotation)
