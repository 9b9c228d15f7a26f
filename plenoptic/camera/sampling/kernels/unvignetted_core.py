"""Unvignetted core and rims of a clipped piece, for the control variate of white images: device functions.

All light through the core of a piece passes the lens, so that its contribution is known without tracing. Paths are
drawn in the rims between the core and the piece's outline alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.kernels.aimed_rays import displaced_point, set_aimed_ray
from plenoptic.camera.sampling.kernels.region_polygons import MAX_CORE_PLANES, MAX_CORNERS, MAX_PLANES
from plenoptic.core.kernels.polygons import area_of, cut, point_in
from plenoptic.core.kernels.ray_blocks import MISSED, STATUS
from plenoptic.core.numba.jit import device
from plenoptic.core.values import Floats

MAX_CLIPPED_CORNERS = MAX_CORNERS + MAX_PLANES + 2
"""Most corners of a clipped piece."""
MAX_RIMS = MAX_CORE_PLANES + 16
"""Most planes of a piece with a core, including the sides of its microlens."""


class SplitRegion(NamedTuple):
    """Pieces (k) of an aperture region, clipped for one point of a pixel and split into core and rims."""

    outlines: Floats
    """(3, k MAX_CLIPPED_CORNERS): clipped pieces, polygons."""
    cores: Floats
    """(3, k MAX_CLIPPED_CORNERS): polygons."""
    rim: Floats
    """(3, MAX_CLIPPED_CORNERS): workspace for one rim."""
    corners: NDArray[np.int64]
    """(k, 3): corners of the outline, of the core; 1 if both are valid for all points that no moving plane clips."""
    areas: Floats
    """(k, 2): area of the core times its transmission, and of all rims, mm^2."""
    rim_areas: Floats
    """(k, MAX_RIMS): area of the rim behind each plane, moved inwards; the first is the whole piece without a core."""


@device
def fill_clipped_piece(polygon, first, corners, planes, piece, in_pixel):
    """Clip a piece with its planes for the point `in_pixel` from a pixel's centre; return the number of corners.

    The polygon is filled from the corner `first` on.
    """
    (u, v), n = in_pixel, piece.corners
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
def _clips(planes, piece, in_pixel):
    """True if a plane that moves over the pixel clips a piece, or its core, at this point."""
    clipped = False
    for j in range(piece.first_plane, piece.first_plane + piece.planes):
        plane = planes[j]
        by = plane.s * in_pixel[0] + plane.t * in_pixel[1]
        clipped = clipped or ((plane.s != 0.0 or plane.t != 0.0) and plane.limit - by - plane.gap < plane.high)
    return clipped


@device
def _core_limit(plane, in_pixel):
    """Limit of a plane inside which light is never vignetted."""
    return plane.limit - plane.s * in_pixel[0] - plane.t * in_pixel[1] - plane.gap


@device
def _copy(polygon, to, source, first, n):
    """Copy n corners of a polygon."""
    for q in range(n):
        polygon[0, to + q], polygon[1, to + q] = source[0, first + q], source[1, first + q]


@device
def _split_piece(split, c, corners, planes, piece, in_pixel):
    """Split a piece for the point `in_pixel`: its planes, moved inwards, cut off one rim each and leave the core."""
    outlines, cores, rim_areas, first = split.outlines, split.cores, split.rim_areas, c * MAX_CLIPPED_CORNERS
    n = fill_clipped_piece(outlines, first, corners, planes, piece, in_pixel)
    core_area = area_of(outlines, first, n) if n >= 3 else 0.0
    split.corners[c, 0], split.areas[c, 1], rim_areas[c, 0] = n, 0.0, 0.0
    if piece.has_core == 1:
        _copy(cores, first, outlines, first, n)
        for j in range(piece.planes):
            plane, before = planes[piece.first_plane + j], core_area
            limit = _core_limit(plane, in_pixel)
            if n >= 3 and plane.gap > 0.0 and limit < plane.high:
                n = cut(cores, first, n, plane.a, plane.b, limit)
                core_area = min(area_of(cores, first, n), before) if n >= 3 else 0.0
            rim_areas[c, j] = before - core_area
            split.areas[c, 1] += before - core_area
    else:
        rim_areas[c, 0], split.areas[c, 1] = core_area, core_area
        n, core_area = 0, 0.0
    split.corners[c, 1], split.areas[c, 0] = n, core_area


@device
def _point_on_rim(split, c, planes, piece, in_pixel, remainder, random):
    """Point on the rims of a piece, at the cumulative area `remainder` of its rims."""
    rim, j = split.rim, 0
    n = split.corners[c, 0]
    _copy(rim, 0, split.outlines, c * MAX_CLIPPED_CORNERS, n)
    while j < piece.planes - 1 and remainder >= split.rim_areas[c, j]:
        remainder -= split.rim_areas[c, j]
        j += 1
    for i in range(j + 1 if piece.has_core == 1 else 0):
        plane = planes[piece.first_plane + i]
        limit, sign = _core_limit(plane, in_pixel), -1.0 if i == j else 1.0
        if n >= 3 and plane.gap > 0.0 and limit < plane.high:
            n = cut(rim, 0, n, sign * plane.a, sign * plane.b, sign * limit)
    if n >= 3:
        return point_in(rim, 0, n, remainder, random)
    return rim[0, 0], rim[1, 0]


@device
def split_region(split, regions, region, in_pixel):
    """Split the pieces of a region (first and end) for the point `in_pixel`; reuse the valid ones."""
    corners, planes = regions.corners, regions.planes
    details = regions.details
    for k in range(region[0], region[1]):
        c, piece = k - region[0], regions.pieces[k]
        is_clipped = _clips(planes, piece, in_pixel)
        if is_clipped or split.corners[c, 2] == 0:
            _split_piece(split, c, corners, planes, piece, in_pixel)
            if details is not None:
                split.areas[c, 0] *= details[k].transmission
            split.corners[c, 2] = 0 if is_clipped else 1


@device
def _sample_area(areas, column, count, target_area):
    """Piece whose part of the summed areas contains `target_area`, and the remainder of that in the piece."""
    chosen = 0
    for c in range(count):
        if areas[c, column] > 0.0:
            chosen = c
            if target_area < areas[c, column]:
                break
            target_area -= areas[c, column]
    return chosen, target_area


@device
def aim_with_core(ray, core_ray, i, split, regions, region, start, random):
    """Aim path i at the rims of a region, by area, and its core ray at the cores; return the index of the piece.

    `start` is the point on the sensor, and the same from the pixel's centre. Without rims the path has the weight 0
    and is aimed at a core.
    """
    (on_sensor, in_pixel), pieces, low, areas = start, regions.pieces, region[0], split.areas
    core_area, rim_area, count = 0.0, 0.0, region[1] - region[0]
    for c in range(count):
        core_area += areas[c, 0]
        rim_area += areas[c, 1]
    c, remainder = _sample_area(areas, 0, count, random[0] * core_area)
    point = 0.0, 0.0
    if areas[c, 0] > 0.0:
        scale = area_of(split.cores, c * MAX_CLIPPED_CORNERS, split.corners[c, 1]) / areas[c, 0]
        point = point_in(split.cores, c * MAX_CLIPPED_CORNERS, split.corners[c, 1], remainder * scale, random[1])
    piece = pieces[low + c]
    set_aimed_ray(core_ray, i, piece, displaced_point(piece, point, in_pixel), on_sensor, core_area)
    if rim_area > 0.0:
        c, remainder = _sample_area(areas, 1, count, random[0] * rim_area)
        point = _point_on_rim(split, c, regions.planes, pieces[low + c], in_pixel, remainder, random[1])
    piece = pieces[low + c]
    set_aimed_ray(ray, i, piece, displaced_point(piece, point, in_pixel), on_sensor, rim_area)
    if not core_area + rim_area > 0.0:
        ray[STATUS + i] = MISSED
    return low + c
