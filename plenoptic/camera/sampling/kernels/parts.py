"""What of a piece feeds one point of a pixel, and what of that surely passes the lens: device functions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.kernels.pieces import MOST_CORNERS, MOST_PLANES
from plenoptic.core.jit import device
from plenoptic.core.kernels.polygons import area_of, cut, point_in
from plenoptic.core.kernels.ray_blocks import MISSED, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.values import Floats

ROOM = MOST_CORNERS + MOST_PLANES + 2
"""Corners of a part, at most."""
RIMS, RIM_ROOM = 49, 1024
"""Rims of a piece, and their corners; what is beyond is not divided further."""


class Divided(NamedTuple):
    """What of k pieces feeds one point of a pixel: cores, which light surely passes, and rims around them."""

    core: Floats
    """(3, k ROOM): polygons."""
    corners: NDArray[np.int64]
    """(k,): of cores."""
    areas: Floats
    """(k, 2): of the core, by how much light it lets pass, and of all rims."""
    rims: Floats
    """(3, k RIM_ROOM): polygons."""
    begins: NDArray[np.int64]
    """(k, RIMS + 1): where they begin."""
    rim_areas: Floats
    """(k, RIMS)."""
    counts: NDArray[np.int64]
    """(k, 2): of rims, and 1 where all this is so for all points of the pixel that no moving plane cuts."""


@device
def aim_at(ray, i, piece, point, start, area):
    """Start path i towards a point of a piece, from its cell's centre; `area` is what the sample stands for."""
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
    """Whether a plane that moves over the pixel cuts a piece for one of its points."""
    found = False
    for j in range(piece.first_plane, piece.first_plane + piece.planes):
        plane = planes[j]
        by = plane.s * at[0] + plane.t * at[1]
        found = found or ((plane.s != 0.0 or plane.t != 0.0) and plane.limit - by - plane.gap < plane.high)
    return found


@device
def _keep_rim(divided, c, first, n, a, b, limit):
    """Keep as a rim what of a core of n corners lies beyond a x + b y = limit; whether there is any."""
    core, rims, count = divided.core, divided.rims, divided.counts[c, 0]
    begin = divided.begins[c, count]
    for q in range(n):
        rims[0, begin + q], rims[1, begin + q] = core[0, first + q], core[1, first + q]
    m = cut(rims, begin, n, -a, -b, -limit)
    area = area_of(rims, begin, m) if m >= 3 else 0.0
    if area > 0.0:
        divided.rim_areas[c, count], divided.begins[c, count + 1] = area, begin + m
        divided.areas[c, 1] += area
        divided.counts[c, 0] = count + 1
    return m >= 3


@device
def _divide(divided, c, corners, planes, piece, at):
    """Divide what of a piece feeds the point `at` of a pixel: its planes, moved inwards, cut off one rim each."""
    core, first = divided.core, c * ROOM
    divided.begins[c, 0], divided.counts[c, 0], divided.areas[c, 1] = c * RIM_ROOM, 0, 0.0
    n, certain = fill_part(core, first, corners, planes, piece, at), piece.certain == 1
    for j in range(piece.first_plane, piece.first_plane + piece.planes):
        plane = planes[j]
        limit = plane.limit - plane.s * at[0] - plane.t * at[1] - plane.gap
        if certain and n >= 3 and plane.gap > 0.0 and limit < plane.high:
            count = divided.counts[c, 0]
            certain = count < RIMS - 1 and divided.begins[c, count] + 2 * n + 4 <= (c + 1) * RIM_ROOM
            if certain and _keep_rim(divided, c, first, n, plane.a, plane.b, limit):
                n = cut(core, first, n, plane.a, plane.b, limit)
    if not certain and n >= 3:
        _keep_rim(divided, c, first, n, 0.0, 0.0, -1.0)
        n = 0
    divided.corners[c] = n
    divided.areas[c, 0] = area_of(core, first, n) if n >= 3 else 0.0


@device
def divide(divided, regions, region, at):
    """Divide the pieces of a region (first and end) for the point `at` of a pixel, but for those that are known."""
    corners, planes, details = regions.corners, regions.planes, regions.details
    for k in range(region[0], region[1]):
        c, piece = k - region[0], regions.pieces[k]
        cut_here = _is_cut(planes, piece, at)
        if cut_here or divided.counts[c, 1] == 0:
            _divide(divided, c, corners, planes, piece, at)
            if details is not None:
                divided.areas[c, 0] *= details[k].transmission
            divided.counts[c, 1] = 0 if cut_here else 1


@device
def _found(areas, column, count, left):
    """The piece in whose part of the summed areas `left` lies, and what is left of it there."""
    found = 0
    for c in range(count):
        if areas[c, column] > 0.0:
            found = c
            if left < areas[c, column]:
                break
            left -= areas[c, column]
    return found, left


@device
def aim_divided(ray, sure, i, divided, pieces, place, random):
    """Start path i towards a rim of some pieces, by areas, and with what passes their cores beside it.

    `place` is the point of the pixel, on the sensor and from the pixel's centre. Where there is no rim, the path counts
    nothing, and passes a core. Returns the number of the piece.
    """
    (start, at), areas, certain, total = place, divided.areas, 0.0, 0.0
    for c in range(pieces.size):
        certain += areas[c, 0]
        total += areas[c, 1]
    c, left = _found(areas, 0, pieces.size, random[0] * certain)
    point = 0.0, 0.0
    if areas[c, 0] > 0.0:
        scale = area_of(divided.core, c * ROOM, divided.corners[c]) / areas[c, 0]
        point = point_in(divided.core, c * ROOM, divided.corners[c], left * scale, random[1])
    aim_at(sure, i, pieces[c], moved(pieces[c], point, at), start, certain)
    if total > 0.0:
        c, left = _found(areas, 1, pieces.size, random[0] * total)
        k = 0
        while k < divided.counts[c, 0] - 1 and left >= divided.rim_areas[c, k]:
            left -= divided.rim_areas[c, k]
            k += 1
        begin = divided.begins[c, k]
        point = point_in(divided.rims, begin, divided.begins[c, k + 1] - begin, left, random[1])
    aim_at(ray, i, pieces[c], moved(pieces[c], point, at), start, total)
    if not certain + total > 0.0:
        ray[STATUS + i] = MISSED
    return c
