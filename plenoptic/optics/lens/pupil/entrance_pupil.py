"""Bounds of the entrance pupil seen from points in front of the lens, by ray tracing.

The bounds are sampling regions and do not affect the weights of rays; too large a region wastes rays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.element_record import IDEAL
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.lens_record import LensRecord, lens_record
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.outline import DARK, Guess, PupilRays, light_outline, polygon_around, up_to_stops
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.surfaces.surface import Surface

_COARSE, _DENSE, _FINE = 64, 512, 64
"""Rays along a side of the search grids: over the whole rim, in a second search if the first finds no light, and over
the unvignetted part."""
_HEIGHTS = 65
_LARGEST_TANGENT = 1e3
"""Tangent of the steepest sampled ray: steeper ones carry a millionth of the light of a plane."""


class Entrance(NamedTuple):
    """Quantities of the entrance pupil that do not depend on the object point."""

    z: float
    """z in mm of the plane at which rays are aimed: no part of the first element lies in front of it."""
    depth: float
    """Depth of the first element behind that plane, in mm."""
    centre: Floats
    """(2,) centre of the first element in mm."""
    reach: float
    """Semi-diameter of the first element, projected along the axis, in mm."""
    pupil: tuple[float, float, Floats]
    """Position, semi-diameter and centre (2,) of the paraxial entrance pupil in mm."""
    lens: LensRecord
    """Lens record towards the sensor, with round stops."""
    parts: tuple[LensRecord, ...]
    """`lens` in parts, see `up_to_stops`."""


def entrance(lens: LensStack, wavelength: float) -> Entrance:
    """Entrance of a lens by its model."""
    record = lens_record(lens, wavelength, reverse=False, round_stops=True)
    points = cardinal_points(lens, wavelength)
    size, placed = points.entrance_pupil_semi_diameter, lens.stop.placement
    shift = np.zeros(2) if placed is None else placed.shift[:2] * (size / lens.stop.semi_diameter)
    pupil = (points.entrance_pupil, size, shift)
    z, axis = float(record.rows[0]["z"]), np.zeros(2)
    if lens.model is not LensModel.EXACT:
        return Entrance(
            z, 0.0, axis, math.sqrt(float(record.rows[0]["semi_diameter2"])), pupil, record, up_to_stops(record)
        )
    first = lens.elements[0]
    reach, sag = first.semi_diameter, np.zeros(1)
    if isinstance(first, Surface):
        sag = first.sag(np.linspace(0.0, reach, _HEIGHTS))
        if first.depth is not None:
            sag = np.append(sag, math.copysign(first.depth, first.radius))
    low, high = float(sag.min()), float(sag.max())
    if isinstance(first, Surface) and first.freeform is not None:
        added = 2.0 * first.freeform.bounds(reach).height  # peak to valley
        low, high = low - added, high + added
    if first.placement is not None:
        shift, turn = first.placement.shift, first.placement.rotation
        sine = float(np.hypot(turn[2, 0], turn[2, 1]))
        low, high = low + float(shift[2]) - sine * reach, high + float(shift[2]) + sine * reach
        axis, reach = shift[:2], reach + sine * float(np.abs(sag).max())
    return Entrance(z + low, high - low, axis, reach, pupil, record, up_to_stops(record))


def entrance_polygon(where: Entrance, point: Floats) -> Floats | None:
    """Corners (SIDES, 2) of a polygon on the plane of the entrance around all transmitted rays from a point; None if
    dark.
    """
    rays = PupilRays(where.parts, point, where.z)
    with np.errstate(all="ignore"):  # the squares of a distant point may overflow; it counts as dark
        low, high = _rim_box(where, point)
        rim, box = Guess(low, high, _COARSE), _pupil_box(where, point)
        outline = light_outline(rays, [rim] if box is None else [rim, Guess(*box, _COARSE)], rim, _FINE)
        if outline is DARK:
            outline = light_outline(rays, [rim._replace(rays=_DENSE)], rim, _FINE)
    return None if outline is DARK else polygon_around(outline.support)


def _rim_box(where: Entrance, point: Floats) -> tuple[Floats, Floats]:
    """Bounding box of all rays that can pass the first element, or the opening of an ideal lens."""
    height = where.z - point[2]
    if IDEAL in where.lens.rows["kind"]:
        centre, reach = _ideal_opening(where.lens, point)
        return centre - reach, centre + reach
    sides = []
    for depth in (0.0, where.depth):
        fraction = height / (height + depth)
        middle = point[:2] + fraction * (where.centre - point[:2])
        sides += [middle - fraction * where.reach, middle + fraction * where.reach]
    return np.min(sides, axis=0), np.max(sides, axis=0)


def _ideal_opening(lens: LensRecord, point: Floats) -> tuple[Floats, float]:
    """Disc on the first plane through which rays pass the stop of an ideal lens: centre and radius in mm.

    Heights and slopes are linear in the point aimed at, m, and in the source, p: y = a m + b p, u = c m + d p.
    """
    z = float(lens.rows[0]["z"])
    height = z - point[2]
    a, b, c, d = 1.0, 0.0, 1.0 / height, -1.0 / height
    for row in lens.rows:
        gap = float(row["z"]) - z
        a, b, z = a + gap * c, b + gap * d, float(row["z"])
        if row["kind"] == IDEAL:
            power = float(row["curvature"])
            c, d, z = c - power * a, d - power * b, z + float(row["max_depth"])
        else:
            # If the image of the stop lies at the point itself, all light passes, or none.
            radius = math.sqrt(float(row["semi_diameter2"]))
            a = math.copysign(max(abs(a), radius / (_LARGEST_TANGENT * height)), a)
            return -b / a * point[:2], radius / abs(a)
    return np.zeros(2), _LARGEST_TANGENT * height


def _pupil_box(where: Entrance, point: Floats) -> tuple[Floats, Floats] | None:
    """Bounding box of the paraxial entrance pupil seen from the point: a grid over the rim may miss a small pupil."""
    z, semi_diameter, shift = where.pupil
    if not (math.isfinite(z) and math.isfinite(semi_diameter)) or z <= point[2]:
        return None
    fraction = (where.z - point[2]) / (z - point[2])
    middle = (1.0 - fraction) * point[:2] + fraction * shift
    return middle - 1.5 * fraction * semi_diameter, middle + 1.5 * fraction * semi_diameter
