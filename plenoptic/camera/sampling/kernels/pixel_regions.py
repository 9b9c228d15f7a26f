"""Kernels of aperture regions: the part of each microlens that illuminates a pixel, as polygons and cutting planes."""

from __future__ import annotations

import numpy as np

from plenoptic.camera.sampling.kernels.candidates import set_box
from plenoptic.camera.sampling.kernels.pieces import (
    GAP,
    LIMIT,
    MOST_CERTAIN,
    MOST_CORNERS,
    MOST_PLANES,
    NUMBERS,
    A,
    B,
    S,
    T,
    begin,
    begin_moving,
    cut_exactly,
    cut_widely,
    fill_planes,
    reach_of,
    sweep,
)
from plenoptic.core.kernels.polygons import area_of
from plenoptic.core.numba.jit import device, kernel

MOST_PIECES = 64
"""Microlenses of a group; where there are more, their bounds must do, which are the same for all points of a pixel."""
_MOST_CUTS = 24
"""Planes that cut a piece differently at each point of the pixel; where there are more, none does."""
_FEW_CUTS = 6
"""Planes that cut a piece for each path before it is tried whether the edges of its microlens are fewer, where what the
stop lets pass moves as a whole."""
_LITTLE = 1e-3
"""How far a plane may move over a pixel, in parts of the piece, and count as still."""


@kernel
def fill_boxes(found, chosen, corners, views, edges, half):
    """Write boxes around the light that candidates let pass; `chosen` becomes those that shrank much, with large
    margins.
    """
    polygon, planes = np.empty((3, MOST_CORNERS + 2)), np.empty((MOST_PLANES, NUMBERS))
    left, size = 0, (half.x, half.y)
    for k in range(chosen.size):
        candidate = found.rows[chosen[k]]
        if candidate.views <= 0:
            continue
        count, n = 0, begin(polygon, corners, candidate)
        for j in range(candidate.first_view, candidate.first_view + candidate.views):
            count = fill_planes(planes, count, views[j], edges, candidate, (polygon, n), ((0.0, 0.0), size))
        n = cut_widely(polygon, n, planes, 0, count, size)
        if n < 3:
            candidate.views = -1
            continue
        before = candidate.half_x * candidate.half_y
        set_box(candidate, polygon, n)
        if candidate.half_x * candidate.half_y < 0.5 * before and candidate.slack > half.slack:
            chosen[left] = chosen[k]
            left += 1
    return left


@device
def _count_cuts(polygon, n, planes, end, half):
    """Count planes that cut a polygon.

    Those count that cut deeper at some points of the pixel than at others by more than a tolerance, or leave light
    inside of them that may be vignetted.
    """
    count = 0
    for j in range(end):
        by = sweep(planes[j], half)
        high = reach_of(polygon, n, planes[j, A], planes[j, B])
        little = _LITTLE * (high + reach_of(polygon, n, -planes[j, A], -planes[j, B]))
        gap = planes[j, GAP]
        count += 1 if high > planes[j, LIMIT] - by - gap and (gap > 0.0 or 2.0 * by > little) else 0
    return count


@device
def _store_cuts(kept, used, polygon, n, planes, end, half):
    """Append the planes that cut a polygon somewhere on the pixel, or leave light in it that is not certain."""
    for j in range(end):
        high = reach_of(polygon, n, planes[j, A], planes[j, B])
        if high > planes[j, LIMIT] - sweep(planes[j], half) - planes[j, GAP]:
            if used < kept.size:
                plane = kept[used]
                plane.a, plane.b, plane.limit = planes[j, A], planes[j, B], planes[j, LIMIT]
                plane.s, plane.t, plane.high, plane.gap = planes[j, S], planes[j, T], high, planes[j, GAP]
            used += 1
    return used


@device
def _store_edges(kept, used, base, m, move, corners, candidate, half):
    """Append the edges of a candidate that cut a moving polygon somewhere on the pixel, as that sees them."""
    for q in range(candidate.corners):
        here = candidate.first_corner + q
        after = candidate.first_corner + (q + 1 if q + 1 < candidate.corners else 0)
        a, b = corners[1, after] - corners[1, here], corners[0, here] - corners[0, after]
        limit, high = a * corners[0, here] + b * corners[1, here], reach_of(base, m, a, b)
        s, t = a * move[0] + b * move[2], a * move[1] + b * move[3]
        if high > limit - abs(s) * half[0] - abs(t) * half[1]:
            if used < kept.size:
                plane = kept[used]
                plane.a, plane.b, plane.limit, plane.s, plane.t, plane.high = a, b, limit, s, t, high
                plane.gap = 0.0
            used += 1
    return used


@kernel
def fill_regions(regions, needed, starts, group, found, corners, seen, half):
    """Regions of starts (n, 2) in groups (n,); `needed` (3,) counts pieces, corners and planes.

    A start stands for the points of the sensor up to `half` (2,) beside it. `corners` are those of the candidates,
    `seen` their views, the edges of elements, the centres of groups, and whether pieces shall have unvignetted cores.
    Where the room in `regions` is too small nothing beyond it is written.
    """
    pieces, first = regions.pieces, regions.first
    details = regions.details
    views, edges, centres, known = seen
    polygon, base = np.empty((3, MOST_CORNERS + 2)), np.empty((3, MOST_CORNERS + 2))
    planes, move = np.empty((MOST_PLANES, NUMBERS)), np.zeros(4)
    used, end_corner, end_plane = 0, 0, 0
    for p in range(starts.shape[0]):
        first[p] = used
        g = group[p]
        centre = starts[p, 0] - centres[g, 0], starts[p, 1] - centres[g, 1]
        area = 0.0
        varies = half[0] + half[1] > 0.0
        for c in range(found.first[g], found.first[g + 1]):
            candidate = found.rows[c]
            if candidate.views < 0:
                continue
            count, n = 0, begin(polygon, corners, candidate)
            for j in range(candidate.first_view, candidate.first_view + candidate.views):
                count = fill_planes(planes, count, views[j], edges, candidate, (polygon, n), (centre, half))
            n = cut_widely(polygon, n, planes, 0, count, half)
            part = area_of(polygon, 0, n) if n >= 3 else 0.0
            if not part > 0.0:
                continue
            certain = known and candidate.certain == 1 and count < MOST_PLANES
            for j in range(0 if certain else count):
                planes[j, GAP] = 0.0
            start, moved = end_plane, 0 if not varies else _count_cuts(polygon, n, planes, count, half)
            move[:] = 0.0
            if moved > _FEW_CUTS and candidate.views == 1:
                m = begin_moving(base, move, views[candidate.first_view], candidate, (polygon, n), half)
                m = cut_exactly(base, m, planes, 0, count)
                end_plane = _store_edges(regions.planes, start, base, m, move, corners, candidate, half)
                if 3 <= m < MOST_CORNERS and end_plane - start < moved:
                    n, part = m, area_of(base, 0, m)
                    for q in range(m):
                        polygon[0, q], polygon[1, q] = base[0, q], base[1, q]
                    if certain and moved <= MOST_CERTAIN:
                        for j in range(count):
                            planes[j, S], planes[j, T] = 0.0, 0.0
                        end_plane = _store_cuts(regions.planes, end_plane, polygon, n, planes, count, half)
                    moved = -moved
                else:
                    end_plane = start
                    move[:] = 0.0
            if 0 < moved <= (MOST_CERTAIN if certain else _MOST_CUTS):
                end_plane = _store_cuts(regions.planes, start, polygon, n, planes, count, half)
            certain = certain and abs(moved) <= MOST_CERTAIN
            area += part
            if used < pieces.size:
                piece = pieces[used]
                piece.cell_x, piece.cell_y = candidate.cell_x, candidate.cell_y
                piece.axis_x, piece.axis_y = candidate.axis_x, candidate.axis_y
                piece.area = area
                piece.xu, piece.xv, piece.yu, piece.yv = move[0], move[1], move[2], move[3]
                piece.first_corner, piece.corners = end_corner, n
                piece.first_plane, piece.planes = start, end_plane - start
                piece.certain = 1 if certain else 0
                if details is not None:
                    details[used] = found.details[c]
            for q in range(n):
                if end_corner + q < regions.corners.shape[1]:
                    regions.corners[0, end_corner + q] = polygon[0, q]
                    regions.corners[1, end_corner + q] = polygon[1, q]
            end_corner += n
            used += 1
    first[starts.shape[0]] = used
    needed[0], needed[1], needed[2] = used, end_corner, end_plane
