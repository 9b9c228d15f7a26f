"""Aperture regions of pixels as convex pieces and planes that clip them: the kernels."""

from __future__ import annotations

import numpy as np

from plenoptic.camera.sampling.kernels.aperture_planes import (
    GAP,
    LIMIT,
    MAX_CORE_PLANES,
    MAX_CORNERS,
    MAX_PLANES,
    NUMBERS,
    A,
    B,
    S,
    T,
    clip_at_centre,
    clip_outermost,
    fill_candidate_polygon,
    fill_moving_box,
    fill_planes,
    polygon_reach,
    sweep_of,
)
from plenoptic.camera.sampling.kernels.candidates import set_box
from plenoptic.core.kernels.polygons import area_of
from plenoptic.core.numba.jit import device, kernel

MAX_PIECES = 64
"""Most microlenses of a group that are clipped by ray transfers; with more, the pupil bounds are used."""
_MAX_MOVING_PLANES = 24
"""Most planes that clip a piece differently at each point of the pixel; with more, none does."""
_FEW_PLANES = 6
"""With more planes, the piece is taken as the image of the stop, which moves as a whole, if that needs fewer planes."""
_FIXED = 1e-3
"""Displacement over a pixel, relative to the piece, below which a plane counts as fixed."""


@kernel
def fill_boxes(candidates, chosen, corners, transfers, edges, half):
    """Set the bounding boxes of the light of candidates `chosen` (n,).

    Returns the number of those that shrank by more than half and still have large margins, which move to the front.
    """
    polygon, planes = np.empty((3, MAX_CORNERS + 2)), np.empty((MAX_PLANES, NUMBERS))
    n_shrunk, size = 0, (half.x, half.y)
    for k in range(chosen.size):
        candidate = candidates.rows[chosen[k]]
        if candidate.transfers <= 0:
            continue
        count, n = 0, fill_candidate_polygon(polygon, corners, candidate)
        for j in range(candidate.first_transfer, candidate.first_transfer + candidate.transfers):
            count = fill_planes(planes, count, transfers[j], edges, candidate, (polygon, n), ((0.0, 0.0), size))
        n = clip_outermost(polygon, n, planes, 0, count, size)
        if n < 3:
            candidate.transfers = -1
            continue
        area_before = candidate.half_x * candidate.half_y
        set_box(candidate, polygon, n)
        if candidate.half_x * candidate.half_y < 0.5 * area_before and candidate.slack > half.slack:
            chosen[n_shrunk] = chosen[k]
            n_shrunk += 1
    return n_shrunk


@device
def _count_clipping_planes(polygon, n, planes, end, half):
    """Number of planes that clip a polygon by different amounts over the pixel, or leave rims inside."""
    count = 0
    for j in range(end):
        sweep = sweep_of(planes[j], half)
        high = polygon_reach(polygon, n, planes[j, A], planes[j, B])
        tolerance = _FIXED * (high + polygon_reach(polygon, n, -planes[j, A], -planes[j, B]))
        gap = planes[j, GAP]
        count += 1 if high > planes[j, LIMIT] - sweep - gap and (gap > 0.0 or 2.0 * sweep > tolerance) else 0
    return count


@device
def _store_clipping_planes(rows, used, polygon, n, planes, end, half):
    """Append the planes that clip a polygon for some point of the pixel, or leave rims inside."""
    for j in range(end):
        high = polygon_reach(polygon, n, planes[j, A], planes[j, B])
        if high > planes[j, LIMIT] - sweep_of(planes[j], half) - planes[j, GAP]:
            if used < rows.size:
                plane = rows[used]
                plane.a, plane.b, plane.limit = planes[j, A], planes[j, B], planes[j, LIMIT]
                plane.s, plane.t, plane.high, plane.gap = planes[j, S], planes[j, T], high, planes[j, GAP]
            used += 1
    return used


@device
def _store_moving_edges(rows, used, box, m, motion, corners, candidate, half):
    """Append the edges of a candidate that clip a moving polygon for some point of the pixel, in its coordinates."""
    for q in range(candidate.corners):
        corner = candidate.first_corner + q
        next_corner = candidate.first_corner + (q + 1 if q + 1 < candidate.corners else 0)
        a, b = corners[1, next_corner] - corners[1, corner], corners[0, corner] - corners[0, next_corner]
        limit, high = a * corners[0, corner] + b * corners[1, corner], polygon_reach(box, m, a, b)
        s, t = a * motion[0] + b * motion[2], a * motion[1] + b * motion[3]
        if high > limit - abs(s) * half[0] - abs(t) * half[1]:
            if used < rows.size:
                plane = rows[used]
                plane.a, plane.b, plane.limit, plane.s, plane.t, plane.high = a, b, limit, s, t, high
                plane.gap = 0.0
            used += 1
    return used


@kernel
def fill_regions(regions, counts, points, group, candidates, corners, geometry, half):
    """Fill the aperture regions of sensor points (n, 2) in groups (n,); `counts` (3,): pieces, corners and planes.

    Each point represents a rectangle with the half sides `half` (2,). `corners` are the corners of the candidates,
    `geometry` their ray transfers, the edges of elements, the centres of groups, and whether to keep planes for the
    unvignetted core. Rows beyond the capacity of `regions` are counted but not written.
    """
    pieces, first = regions.pieces, regions.first
    details = regions.details
    transfers, edges, centres, with_core = geometry
    polygon, box = np.empty((3, MAX_CORNERS + 2)), np.empty((3, MAX_CORNERS + 2))
    planes, motion = np.empty((MAX_PLANES, NUMBERS)), np.zeros(4)
    used, end_corner, end_plane = 0, 0, 0
    for p in range(points.shape[0]):
        first[p] = used
        g = group[p]
        centre = points[p, 0] - centres[g, 0], points[p, 1] - centres[g, 1]
        area = 0.0
        varies = half[0] + half[1] > 0.0
        for c in range(candidates.first[g], candidates.first[g + 1]):
            candidate = candidates.rows[c]
            if candidate.transfers < 0:
                continue
            count, n = 0, fill_candidate_polygon(polygon, corners, candidate)
            for j in range(candidate.first_transfer, candidate.first_transfer + candidate.transfers):
                count = fill_planes(planes, count, transfers[j], edges, candidate, (polygon, n), (centre, half))
            n = clip_outermost(polygon, n, planes, 0, count, half)
            piece_area = area_of(polygon, 0, n) if n >= 3 else 0.0
            if not piece_area > 0.0:
                continue
            has_core = with_core and candidate.complete == 1 and count < MAX_PLANES
            for j in range(0 if has_core else count):
                planes[j, GAP] = 0.0
            first_plane, n_cuts = (
                end_plane,
                0 if not varies else _count_clipping_planes(polygon, n, planes, count, half),
            )
            motion[:] = 0.0
            if n_cuts > _FEW_PLANES and candidate.transfers == 1:
                m = fill_moving_box(box, motion, transfers[candidate.first_transfer], candidate, (polygon, n), half)
                m = clip_at_centre(box, m, planes, 0, count)
                end_plane = _store_moving_edges(regions.planes, first_plane, box, m, motion, corners, candidate, half)
                if 3 <= m < MAX_CORNERS and end_plane - first_plane < n_cuts:
                    n, piece_area = m, area_of(box, 0, m)
                    for q in range(m):
                        polygon[0, q], polygon[1, q] = box[0, q], box[1, q]
                    if has_core and n_cuts <= MAX_CORE_PLANES:
                        for j in range(count):
                            planes[j, S], planes[j, T] = 0.0, 0.0
                        end_plane = _store_clipping_planes(regions.planes, end_plane, polygon, n, planes, count, half)
                    n_cuts = -n_cuts
                else:
                    end_plane = first_plane
                    motion[:] = 0.0
            if 0 < n_cuts <= (MAX_CORE_PLANES if has_core else _MAX_MOVING_PLANES):
                end_plane = _store_clipping_planes(regions.planes, first_plane, polygon, n, planes, count, half)
            has_core = has_core and abs(n_cuts) <= MAX_CORE_PLANES
            area += piece_area
            if used < pieces.size:
                piece = pieces[used]
                piece.cell_x, piece.cell_y = candidate.cell_x, candidate.cell_y
                piece.axis_x, piece.axis_y = candidate.axis_x, candidate.axis_y
                piece.area = area
                piece.xu, piece.xv, piece.yu, piece.yv = motion[0], motion[1], motion[2], motion[3]
                piece.first_corner, piece.corners = end_corner, n
                piece.first_plane, piece.planes = first_plane, end_plane - first_plane
                piece.has_core = 1 if has_core else 0
                if details is not None:
                    details[used] = candidates.details[c]
            for q in range(n):
                if end_corner + q < regions.corners.shape[1]:
                    regions.corners[0, end_corner + q] = polygon[0, q]
                    regions.corners[1, end_corner + q] = polygon[1, q]
            end_corner += n
            used += 1
    first[points.shape[0]] = used
    counts[0], counts[1], counts[2] = used, end_corner, end_plane
