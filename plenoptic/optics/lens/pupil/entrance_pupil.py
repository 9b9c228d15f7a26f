"""Bounds of the entrance pupil seen from points in front of the lens, by ray tracing.

The bounds are sampling regions and do not affect the weights of rays; too large a region wastes rays.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.element_record import IDEAL
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.lens_record import LensRecord, lens_record
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.outline import (
    DARK,
    SIDES,
    Guess,
    Outline,
    PupilRays,
    light_outline,
    normals_of,
    polygon_around,
    up_to_stops,
)
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_record
from plenoptic.optics.surfaces.surface import Surface

_COARSE, _DENSE, _FINE = 64, 512, 64
"""Rays along a side of the search grids: over the whole rim, in a second search if the first finds no light, and over
the unvignetted part."""
_HEIGHTS = 65
_LARGEST_TANGENT = 1e3
"""Tangent of the steepest sampled ray: steeper ones carry a millionth of the light of a plane."""

_REGION = 0.0625
"""Size of the simplices of object space: displacement of the beam along the lens, or its change in size, over the
pupil."""
_FARTHEST = 2.0**-20
"""Length of the lens over the distance of the farthest corner of a simplex, which lies at infinity."""
_RING = np.column_stack([normals_of(8) / math.cos(math.pi / 8), np.zeros(8)])
"""Points (8, 3) around a disc of radius 1, whose octagon contains it."""
_SMALL_DISC = 2.0**-7
"""Displacement of the beams of a disc over the size of the pupil up to which it needs no search: outlines are wider."""
_LONGEST = 1e150
"""Coordinate in mm up to which points share outlines."""

Outlines: TypeAlias = dict[tuple[float, ...], Floats]
"""Supports (SIDES,) of the pupil's outline at corners of simplices of object space."""


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
    outline = _outline(where, point)
    if outline is DARK:
        rim = Guess(*_rim_box(where, point), _DENSE)
        with np.errstate(all="ignore"):
            outline = light_outline(PupilRays(where.parts, point, where.z), [rim], rim, _FINE)
    return None if outline is DARK else polygon_around(outline.support)


def _disc_polygon(where: Entrance, point: Floats, radius: float) -> Floats | None:
    """Polygon as of `entrance_polygon` around all rays from a disc that faces each of them."""
    outline = _outline(where, point)
    farthest = np.stack(_rim_box(where, point)) if outline is DARK else polygon_around(outline.support)
    radius = float(_radius_in_plane(farthest, where.z, point, radius))
    if radius <= 0.5 * _SMALL_DISC * float((outline.support + np.roll(outline.support, SIDES // 2)).min()):
        return polygon_around(outline.support + radius)
    ring = [_outline(where, point + radius * offset).support for offset in _RING]
    support = np.max([outline.support, *ring], axis=0)
    return polygon_around(support) if np.isfinite(support[0]) else None


def _radius_in_plane(corners: Floats, z: float, point: Floats, radius: Floats | float) -> Floats:
    """Radius of the disc at the z of a point through which pass all rays from one that faces them.

    Rays go to corners (..., k, 2) on the plane z.
    """
    across = np.linalg.norm(corners - point[..., None, :2], axis=-1).max(axis=-1)
    return np.asarray(radius * np.hypot(1.0, across / (z - point[..., 2])))


def _outline(where: Entrance, point: Floats) -> Outline:
    with np.errstate(all="ignore"):  # the squares of a distant point may overflow; it counts as dark
        rim, box = Guess(*_rim_box(where, point), _COARSE), _pupil_box(where, point)
        guesses = [rim] if box is None else [rim, Guess(*box, _COARSE)]
        return light_outline(PupilRays(where.parts, point, where.z), guesses, rim, _FINE)


def entrance_polygons(
    where: Entrance, points: Floats, radius: Floats | None = None, outlines: Outlines | None = None
) -> Floats:
    """Corners (n, SIDES, 2) of polygons as of `entrance_polygon` for points (n, 3); nan if dark.

    With `radius` (n,) they are around all rays from discs around the points, each of which faces the ray. `outlines`
    are those of earlier calls with the same entrance, and get those that this one adds.

    Object space is divided into simplices, and the polygon of a point is the union of the outlines at the corners of
    its simplex, as they lie on the plane of the entrance pupil. Points with light at the edge of that polygon have
    their own, and so have points of simplices with a corner that is dark or sees several parts of the pupil. A point is
    dark without a search if the corners of its cube and of all cubes around it are dark. Polygons do not depend on the
    other points.
    """
    polygons, is_dark = np.full((len(points), SIDES, 2), np.nan), np.zeros(len(points), bool)
    # The squares of more distant points may overflow.
    near = np.flatnonzero(np.abs(points).max(axis=1, initial=0.0) < _LONGEST)
    radii, outlines = None if radius is None else radius[near], {} if outlines is None else outlines
    polygons[near], is_dark[near] = _polygons_of_simplices(where, points[near], radii, outlines)
    for k in np.flatnonzero(np.isnan(polygons[:, 0, 0]) & ~is_dark):
        size = 0.0 if radius is None else float(radius[k])
        corners = _disc_polygon(where, points[k], size) if size else entrance_polygon(where, points[k])
        if corners is not None:
            polygons[k] = corners
    return polygons


def _polygons_of_simplices(
    where: Entrance, points: Floats, radius: Floats | None, outlines: Outlines
) -> tuple[Floats, NDArray[np.bool_]]:
    """Corners (n, SIDES, 2) of polygons around the outlines at the corners of each point's simplex, nan without one;
    and True (n,) for points amid dark simplices.
    """
    polygons, is_dark = np.full((len(points), SIDES, 2), np.nan), np.zeros(len(points), bool)
    z, semi_diameter, _ = where.pupil
    if IDEAL in where.lens.rows["kind"] or not math.isfinite(z):
        z = where.z
    size = min(semi_diameter, where.reach)
    rows = np.flatnonzero(z - points[:, 2] > 0.0) if math.isfinite(size) else np.empty(0, np.intp)
    span = max(float(np.abs(where.lens.rows["z"] - z).max()), size)
    distance, across = z - points[rows, 2], points[rows, 0] + 1j * points[rows, 1]
    is_centred = where.lens.frames is None and where.lens.freeform is None
    turn = np.exp(1j * np.angle(across)) if is_centred else np.ones(len(rows))
    local = np.abs(across) + 0j if is_centred else across
    # Displacement of the beam along the lens and its change in size, over that of the pupil.
    scale = _REGION * np.array([size / span, 1.0, size / span])
    place = np.column_stack([local.real / distance, span / distance, local.imag / distance]) / scale
    support_at = functools.partial(_kept_support, outlines, functools.partial(_corner_support, where, (z, span), scale))
    supports = _largest_supports(support_at, place[:, :2] if is_centred else place)
    is_dark[rows] = np.isneginf(supports[:, 0])
    if radius is not None:  # points of a disc are in the cubes around that of its centre
        is_dark[rows] &= radius[rows] * np.hypot(1.0, np.abs(across) / distance) < distance * scale[0]
    shared = np.isfinite(supports[:, 0])
    rows, distance, supports = rows[shared], distance[shared], supports[shared]
    local, turn = local[shared], turn[shared]
    fraction, normals = 1.0 - (z - where.z) / distance[:, None], normals_of(SIDES)
    around = (1.0 - fraction) * (local.real[:, None] * normals[:, 0] + local.imag[:, None] * normals[:, 1])
    supports, large = around + fraction * supports, np.zeros(len(rows), bool)
    if radius is not None:
        # The beam of a displaced point turns around its centre on the plane of the pupil.
        inside = np.stack([local.real, local.imag, points[rows, 2]], axis=-1)
        in_plane = _radius_in_plane(polygon_around(supports), where.z, inside, radius[rows])
        displacement = np.abs(1.0 - fraction) * in_plane[:, None]
        supports, large = supports + displacement, displacement[:, 0] > _SMALL_DISC * size
    corners = polygon_around(supports) @ (1.0, 1j) * turn[:, None]
    edge = np.concatenate([corners, 0.5 * (corners + np.roll(corners, -1, axis=1))], axis=1)
    start = np.stack([edge.real, edge.imag, np.full(edge.shape, where.z)], axis=-1)
    is_enclosed = _are_dark(where, points[rows], start)
    if radius is not None and large.any():
        for offset in _RING:
            displaced = points[rows[large]] + in_plane[large, None] * offset
            is_enclosed[large] &= _are_dark(where, displaced, start[large])
    polygons[rows[is_enclosed]] = np.stack([corners.real, corners.imag], axis=-1)[is_enclosed]
    return polygons, is_dark


def _are_dark(where: Entrance, points: Floats, ends: Floats) -> NDArray[np.bool_]:
    """True (n,) if no ray from a point (n, 3) through its ends (n, k, 3) passes the lens."""
    directions = ends - points[:, None]
    rays = RayBundle.through(ends.reshape(-1, 3), directions.reshape(-1, 3), 1.0)
    return np.asarray((trace_record(where.lens, rays, threads=1).status != 0).reshape(ends.shape[:2]).all(axis=1))


def _kept_support(outlines: Outlines, support_at: Callable[..., Floats], *corner: float) -> Floats:
    """Support at a corner, computed if it is not among the outlines, to which it is added."""
    if corner not in outlines:
        outlines[corner] = support_at(*corner)
    return outlines[corner]


def _largest_supports(support_at: Callable[..., Floats], place: Floats) -> Floats:
    """Largest supports (n, SIDES) on the plane of the pupil of the outlines at the corners of simplices around points
    `place` (n, 2) or (n, 3); nan if one is dark, has parts or cannot be seen.

    They are -inf if the corners of the cube and of all cubes around it are dark. `place` is x, nearness and y over the
    size of cubes: slopes from the pupil to the point, and length over distance.
    """
    first = np.floor(place)
    # The paths from the first corner of a cube to the last one, along the axes in the order of the fractional parts.
    steps = np.argsort(first - place, axis=1, kind="stable")[:, :, None] == np.arange(place.shape[1])
    corners = first[:, None] + np.concatenate([np.zeros((len(place), 1, place.shape[1])), steps.cumsum(axis=1)], axis=1)
    unique, number = np.unique(corners.reshape(-1, place.shape[1]), axis=0, return_inverse=True)
    supports = np.array([support_at(*corner) for corner in unique.tolist()]).reshape(-1, SIDES)
    of_simplices = supports[number.reshape(corners.shape[:2])]
    largest, is_dark = of_simplices.max(axis=1), np.isneginf(of_simplices[:, :, 0])
    largest[is_dark.any(axis=1)] = np.nan
    rows = np.flatnonzero(is_dark.all(axis=1))
    cubes, number = np.unique(first[rows], axis=0, return_inverse=True)
    blocks = [itertools.product(*(range(int(k) - 1, int(k) + 3) for k in cube)) for cube in cubes]
    amid_dark = [all(np.isneginf(support_at(*map(float, corner))[0]) for corner in block) for block in blocks]
    largest[rows[np.array(amid_dark, bool)[number.ravel()]]] = -np.inf
    return np.asarray(largest)


def _corner_support(
    where: Entrance, pupil: tuple[float, float], scale: Floats, x: float, nearness: float, y: float = 0.0
) -> Floats:
    """Support (SIDES,) of the outline at a corner; -inf if dark, nan if it has parts or cannot be seen.

    `pupil` is its z and the lens's length.
    """
    z, span = pupil
    behind = span / max(nearness * float(scale[1]), _FARTHEST)
    if not z - behind < where.z:
        return np.full(SIDES, np.nan)
    point = np.array([x * scale[0] * behind, y * scale[2] * behind, z - behind])
    outline, fraction = _outline(where, point), 1.0 - (z - where.z) / behind
    if outline.parted:
        return np.full(SIDES, np.nan)
    return np.asarray((outline.support - (1.0 - fraction) * (normals_of(SIDES) @ point[:2])) / fraction)


def rim_polygons(where: Entrance, points: Floats, radius: Floats | None = None) -> Floats:
    """Corners (n, 4, 2) on the plane of the entrance of rectangles around all rays to the first element of an exact
    lens, from points (n, 3) or discs around them.
    """
    low, high = _rim_box(where, points)
    if radius is not None:
        size = _radius_in_plane(np.stack([low, high], axis=1), where.z, points, radius)[:, None]
        low, high = low - size, high + size
    return np.stack([low, np.column_stack([high[:, 0], low[:, 1]]), high, np.column_stack([low[:, 0], high[:, 1]])], 1)


def _rim_box(where: Entrance, point: Floats) -> tuple[Floats, Floats]:
    """Bounding box of all rays that can pass the first element, or the opening of an ideal lens, from a point (3,); or
    boxes (n, 2) of points (n, 3), not of ideal lenses.
    """
    height = where.z - point[..., 2:]
    if IDEAL in where.lens.rows["kind"]:
        centre, reach = _ideal_opening(where.lens, point)
        return centre - reach, centre + reach
    sides = []
    for depth in (0.0, where.depth):
        fraction = height / (height + depth)
        middle = point[..., :2] + fraction * (where.centre - point[..., :2])
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
            power, ratio = float(row["curvature"]), float(row["index_ratio"])
            c, d, z = ratio * c - power * a, ratio * d - power * b, z + float(row["max_depth"])
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
