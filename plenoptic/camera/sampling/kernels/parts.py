"""Part of a piece that illuminates one point of a pixel, and its unvignetted core: device functions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.kernels.pieces import MOST_CERTAIN, MOST_CORNERS, MOST_PLANES
from plenoptic.core.kernels.polygons import area_of, cut, point_in
from plenoptic.core.kernels.ray_blocks import MISSED, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.core.values import Floats

ROOM = MOST_CORNERS + MOST_PLANES + 2
"""Corners of a part, at most."""
STEPS = MOST_CERTAIN + 16
"""Planes of a piece of which something is certain, and the sides of its microlens."""


class Divided(NamedTuple):
    """Cores and rims of the k pieces that illuminate one point of a pixel; a core is unvignetted."""

    parts: Floats
    """(3, k ROOM): all that feeds the point, polygons."""
    cores: Floats
    """(3, k ROOM): polygons."""
    rim: Floats
    """(3, ROOM): room for one."""
    corners: NDArray[np.int64]
    """(k, 3): of parts, of cores, and 1 where all this is so for all points that no moving plane cuts."""
    areas: Floats
    """(k, 2): of the core, by how much light it lets pass, and of all rims."""
    steps: Floats
    """(k, STEPS): of the rim that each plane, moved inwards, cuts off; of a part of which nothing is certain, all."""


@device
def aim_at(ray, i, piece, point, start, area):
    """Start path i towards a point of a piece, from its cell's centre; `area` is the area that the point represents."""
    mx, my = piece.cell_x + point[0], piece.cell_y + point[1]
    ray[X + i] = mx
    ray[Y + i] = my
    ray[L + i] = mx - start[0]
    ray[M + i] = my - start[1]
    ray[Z + i] = piece.axis_x
    ray[N + i] = piece.axis_y
    ray[WEIGHT + i] = area
    ray[STATUS + i] = 0.0


@device
def moved(piece, point, at):
    """A point of a piece from the centre of its cell, for the point `at` of a pixel."""
    return point[0] + piece.xu * at[0] + piece.xv * at[1], point[1] + piece.yu * at[0] + piece.yv * at[1]


@device
def fill_part(polygon, first, corners, planes, piece, at):
    """The part of a piece that feeds the point `at` of a pixel, from its centre, as a polygon from a corner on.

    Returns its number of corners.
    """
    (u, v), n = at, piece.corners
    for q in range(n):
        polygon[0, first + q] = corners[0, piece.first_corner + q]
        polygon[1, first + q] = corners[1, piece.first_corner + q]
    for j in range(piece.first_plane, piece.first_plane + piece.planes):
        plane = planes[j]
        limit = plane.limit - plane.s * u - plane.t * v
        if n > 0 and limit < plane.high:
            n = cut(polygon, first, n, plane.a, plane.b, limit)
    return n


@device
def _is_cut(planes, piece, at):
    """True if a plane that moves over the pixel cuts a piece for one of its points."""
    found = False
    for j in range(piece.first_plane, piece.first_plane + piece.planes):
        plane = planes[j]
        by = plane.s * at[0] + plane.t * at[1]
        found = found or ((plane.s != 0.0 or plane.t != 0.0) and plane.limit - by - plane.gap < plane.high)
    return found


@device
def _inner(plane, at):
    """Largest distance at which light certainly passes a plane."""
    return plane.limit - plane.s * at[0] - plane.t * at[1] - plane.gap


@device
def _copy(polygon, to, source, first, n):
    """Copy n corners of a polygon."""
    for q in range(n):
        polygon[0, to + q], polygon[1, to + q] = source[0, first + q], source[1, first + q]


@device
def _divide(divided, c, corners, planes, piece, at):
    """Divide the part of a piece that illuminates the point `at` of a pixel: its planes, moved inwards, cut off one rim
    each.
    """
    parts, cores, steps, first = divided.parts, divided.cores, divided.steps, c * ROOM
    n = fill_part(parts, first, corners, planes, piece, at)
    left = area_of(parts, first, n) if n >= 3 else 0.0
    divided.corners[c, 0], divided.areas[c, 1], steps[c, 0] = n, 0.0, 0.0
    if piece.certain == 1:
        _copy(cores, first, parts, first, n)
        for j in range(piece.planes):
            plane, before = planes[piece.first_plane + j], left
            limit = _inner(plane, at)
            if n >= 3 and plane.gap > 0.0 and limit < plane.high:
                n = cut(cores, first, n, plane.a, plane.b, limit)
                left = min(area_of(cores, first, n), before) if n >= 3 else 0.0
            steps[c, j] = before - left
            divided.areas[c, 1] += before - left
    else:
        steps[c, 0], divided.areas[c, 1] = left, left
        n, left = 0, 0.0
    divided.corners[c, 1], divided.areas[c, 0] = n, left


@device
def _point_on_rim(divided, c, planes, piece, at, left, random):
    """A point on the rims of a piece, `left` of whose area lies before it."""
    rim, j = divided.rim, 0
    n = divided.corners[c, 0]
    _copy(rim, 0, divided.parts, c * ROOM, n)
    while j < piece.planes - 1 and left >= divided.steps[c, j]:
        left -= divided.steps[c, j]
        j += 1
    for i in range(j + 1 if piece.certain == 1 else 0):
        plane = planes[piece.first_plane + i]
        limit, sign = _inner(plane, at), -1.0 if i == j else 1.0
        if n >= 3 and plane.gap > 0.0 and limit < plane.high:
            n = cut(rim, 0, n, sign * plane.a, sign * plane.b, sign * limit)
    if n >= 3:
        return point_in(rim, 0, n, left, random)
    return rim[0, 0], rim[1, 0]


@device
def divide(divided, regions, region, at):
    """Divide the pieces of a region (first and end) for the point `at` of a pixel, but for those that are known."""
    corners, planes = regions.corners, regions.planes
    details = regions.details
    for k in range(region[0], region[1]):
        c, piece = k - region[0], regions.pieces[k]
        cut_here = _is_cut(planes, piece, at)
        if cut_here or divided.corners[c, 2] == 0:
            _divide(divided, c, corners, planes, piece, at)
            if details is not None:
                divided.areas[c, 0] *= details[k].transmission
            divided.corners[c, 2] = 0 if cut_here else 1


@device
def _found(areas, column, count, left):
    """Select the piece at `left` of the cumulative areas, and return the remainder of `left` within it."""
    found = 0
    for c in range(count):
        if areas[c, column] > 0.0:
            found = c
            if left < areas[c, column]:
                break
            left -= areas[c, column]
    return found, left


@device
def aim_divided(ray, sure, i, divided, regions, region, place, random):
    """Start path i towards a rim of the pieces of a region, by areas, with the light of their cores.

    `place` is the point of the pixel, on the sensor and from the pixel's centre. Where there is no rim, the path counts
    nothing, and passes a core. Returns the piece.
    """
    (start, at), pieces, low, areas = place, regions.pieces, region[0], divided.areas
    certain, total, count = 0.0, 0.0, region[1] - region[0]
    for c in range(count):
        certain += areas[c, 0]
        total += areas[c, 1]
    c, left = _found(areas, 0, count, random[0] * certain)
    point = 0.0, 0.0
    if areas[c, 0] > 0.0:
        scale = area_of(divided.cores, c * ROOM, divided.corners[c, 1]) / areas[c, 0]
        point = point_in(divided.cores, c * ROOM, divided.corners[c, 1], left * scale, random[1])
    aim_at(sure, i, pieces[low + c], moved(pieces[low + c], point, at), start, certain)
    if total > 0.0:
        c, left = _found(areas, 1, count, random[0] * total)
        point = _point_on_rim(divided, c, regions.planes, pieces[low + c], at, left, random[1])
    aim_at(ray, i, pieces[low + c], moved(pieces[low + c], point, at), start, total)
    if not certain + total > 0.0:
        ray[STATUS + i] = MISSED
    return low + c
