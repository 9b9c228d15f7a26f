"""Aperture regions of pixels as convex pieces and planes that clip them: the kernels."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.candidates import set_box
from plenoptic.camera.sampling.kernels.round_pieces import ROUND_CORNERS, fill_motion, fill_round_piece
from plenoptic.core.kernels.polygons import area_of, cut
from plenoptic.core.numba.jit import device, kernel

MAX_PIECES = 64
"""Most microlenses of a group that are clipped by ray transfers; with more, the pupil bounds are used."""
_MAX_MOVING_PLANES = 24
"""Most planes that clip a piece differently at each point of the pixel; with more, none does."""
_FEW_PLANES = 6
"""With more planes, the piece is taken as the image of the stop, which moves as a whole, if that needs fewer planes."""
_SLACK = 2e-3
"""Relative margin of a candidate below which its ray transfers are not fitted again."""
_FIXED = 1e-3
"""Displacement over a pixel, relative to the piece, below which a plane counts as fixed."""
MAX_CORNERS = 64
"""Most corners of a clipped polygon; further planes are left out."""
MAX_PLANES = 128
"""Most tangents and edges of all elements in front of a microlens; further ones are left out."""
MAX_CORE_PLANES = 48
"""Most planes of a piece with an unvignetted core; pieces with more have none."""
_TANGENTS, _SAGITTA = 24, 0.01
"""Tangents around a circle, and the sagitta between them as a fraction of the extent of the light."""
A, B, LIMIT, S, T, GAP, NUMBERS = range(7)
"""Columns of a plane: see `PLANE`."""


@device
def polygon_reach(polygon, n, a, b):
    """Largest a x + b y over the corners of a polygon."""
    far = -math.inf
    for q in range(n):
        far = max(far, a * polygon[0, q] + b * polygon[1, q])
    return far


@device
def _tangents(far, reach, radius):
    """Tangents of a circle that bound a disc of radius `reach` whose centre is `far` from the circle's.

    Returns their number, the angle of the first one to the direction of the disc, and the angle between neighbours.
    """
    if far <= reach:
        return _TANGENTS, 0.0, 2.0 * math.pi / _TANGENTS
    angle_range = 2.0 * math.asin(reach / far)
    count = min(math.ceil(angle_range / math.sqrt(8.0 * _SAGITTA * min(reach / radius, 1.0))), _TANGENTS)
    return count, -0.5 * angle_range * (1.0 - 1.0 / count), angle_range / count


@device
def _append_plane(planes, n, transfer, edge, centre):
    """Append the plane of an edge (normal, distance, sagitta of the opening inside it) for (u, v) from `centre`.

    Returns the number of planes.
    """
    nx, ny, distance, sagitta = edge
    if n < MAX_PLANES:
        planes[n, A] = nx * transfer.x_by_x + ny * transfer.y_by_x
        planes[n, B] = nx * transfer.x_by_y + ny * transfer.y_by_y
        planes[n, S] = nx * transfer.x_by_u + ny * transfer.y_by_u
        planes[n, T] = nx * transfer.x_by_v + ny * transfer.y_by_v
        planes[n, GAP] = sagitta + 2.0 * transfer.margin
        planes[n, LIMIT] = distance + transfer.margin - nx * transfer.x - ny * transfer.y
        planes[n, LIMIT] -= planes[n, S] * centre[0] + planes[n, T] * centre[1]
        return n + 1
    return n


@device
def fill_planes(planes, count, transfer, edges, candidate, shape, where):
    """Append the planes of a ray transfer that may clip a candidate's polygon, `shape` (polygon, number of corners).

    `where` is a rectangle of the sensor: its centre, from that of the group, and its half sides. Returns the number of
    planes.
    """
    (polygon, n), (centre, half) = shape, where
    x = transfer.x + transfer.x_by_x * candidate.x + transfer.x_by_y * candidate.y
    y = transfer.y + transfer.y_by_x * candidate.x + transfer.y_by_y * candidate.y
    x = x + transfer.x_by_u * centre[0] + transfer.x_by_v * centre[1]
    y = y + transfer.y_by_u * centre[0] + transfer.y_by_v * centre[1]
    reach = 0.0
    for q in range(n):
        dx, dy = polygon[0, q] - candidate.x, polygon[1, q] - candidate.y
        from_x, from_y = transfer.x_by_x * dx + transfer.x_by_y * dy, transfer.y_by_x * dx + transfer.y_by_y * dy
        reach = max(reach, from_x * from_x + from_y * from_y)
    reach = transfer.margin + math.sqrt(reach) + math.hypot(transfer.x_by_u, transfer.y_by_u) * half[0]
    reach += math.hypot(transfer.x_by_v, transfer.y_by_v) * half[1]
    far, radius = math.hypot(x, y), transfer.radius
    if transfer.edges == 0 and far + reach > radius:
        tangents, angle, step = _tangents(far, reach, radius)
        angle += math.atan2(y, x)
        # Chords of the arcs between the intersections of neighbouring tangents lie inside the circle.
        sagitta = radius * (1.0 - math.cos(0.5 * step))
        for k in range(tangents):
            normal = math.cos(angle + k * step), math.sin(angle + k * step)
            count = _append_plane(planes, count, transfer, (normal[0], normal[1], radius, sagitta), centre)
    for j in range(transfer.first_edge, transfer.first_edge + transfer.edges):
        if edges[j, 0] * x + edges[j, 1] * y + reach > edges[j, 2]:
            count = _append_plane(planes, count, transfer, (edges[j, 0], edges[j, 1], edges[j, 2], 0.0), centre)
    return count


@device
def sweep_of(plane, half):
    """Displacement of a plane between the centre of a pixel, or of a group, and its corners."""
    return abs(plane[S]) * half[0] + abs(plane[T]) * half[1]


@device
def fill_candidate_polygon(polygon, corners, candidate):
    """Copy the polygon of a candidate; return its number of corners."""
    for q in range(candidate.corners):
        polygon[0, q] = corners[0, candidate.first_corner + q]
        polygon[1, q] = corners[1, candidate.first_corner + q]
    return candidate.corners


@device
def clip_outermost(polygon, n, planes, count, half):
    """Clip a polygon with planes, each at its outermost position over the pixel; return the number of corners."""
    for j in range(count):
        if 0 < n < MAX_CORNERS:
            n = cut(polygon, 0, n, planes[j, A], planes[j, B], planes[j, LIMIT] + sweep_of(planes[j], half))
    return n


@device
def fill_moving_box(box, motion, transfer, candidate, shape, half):
    """Bounding box of a polygon that moves over the pixel with the image of an opening, and its motion, a matrix.

    `shape` is the polygon and its number of corners. Returns the number of corners of the box; 0 if the image of the
    cell is no larger than the margin of the transfer, as through the centres of pinholes.
    """
    polygon, n = shape
    det = transfer.x_by_x * transfer.y_by_y - transfer.x_by_y * transfer.y_by_x
    if abs(det) * candidate.half_x * candidate.half_y <= transfer.margin * transfer.margin:
        return 0
    fill_motion(motion, transfer, det)
    by_x = abs(motion[0]) * half[0] + abs(motion[1]) * half[1]
    by_y = abs(motion[2]) * half[0] + abs(motion[3]) * half[1]
    left, right = -polygon_reach(polygon, n, -1.0, 0.0) - by_x, polygon_reach(polygon, n, 1.0, 0.0) + by_x
    low, high = -polygon_reach(polygon, n, 0.0, -1.0) - by_y, polygon_reach(polygon, n, 0.0, 1.0) + by_y
    box[0, 0], box[0, 1], box[0, 2], box[0, 3] = left, right, right, left
    box[1, 0], box[1, 1], box[1, 2], box[1, 3] = low, low, high, high
    return 4


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
        n = clip_outermost(polygon, n, planes, count, size)
        if n < 3:
            candidate.transfers = -1
            continue
        area_before = candidate.half_x * candidate.half_y
        set_box(candidate, polygon, n)
        if candidate.half_x * candidate.half_y < 0.5 * area_before and candidate.slack > _SLACK:
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
            # The polygon that holds the light of all points of the pixel.
            count, n = 0, fill_candidate_polygon(polygon, corners, candidate)
            for j in range(candidate.first_transfer, candidate.first_transfer + candidate.transfers):
                count = fill_planes(planes, count, transfers[j], edges, candidate, (polygon, n), (centre, half))
            n = clip_outermost(polygon, n, planes, count, half)
            piece_area = area_of(polygon, 0, n) if n >= 3 else 0.0
            if not piece_area > 0.0:
                continue
            # The planes that clip it further for single points.
            has_core = with_core and candidate.complete == 1 and count < MAX_PLANES
            for j in range(0 if has_core else count):
                planes[j, GAP] = 0.0
            first_plane = end_plane
            round_area = 0.0
            if candidate.transfers == 1 and not with_core:
                transfer = transfers[candidate.first_transfer]
                round_area = fill_round_piece(box, motion, transfer, candidate, corners, (centre, half))
            if not round_area > 0.0:
                motion[:] = 0.0
            n_cuts = _count_clipping_planes(polygon, n, planes, count, half) if varies else 0
            if round_area > 0.0:
                n, piece_area, n_cuts = ROUND_CORNERS, round_area, 0
                for q in range(n):
                    polygon[0, q], polygon[1, q] = box[0, q], box[1, q]
            elif n_cuts > _FEW_PLANES and candidate.transfers == 1:
                # The image of the stop at the pixel's centre: it moves as a whole and is clipped by the cell's edges.
                m = fill_moving_box(box, motion, transfers[candidate.first_transfer], candidate, (polygon, n), half)
                m = clip_outermost(box, m, planes, count, (0.0, 0.0))
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
            # The piece with its corners.
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
                piece.is_round = 1 if round_area > 0.0 else 0
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
