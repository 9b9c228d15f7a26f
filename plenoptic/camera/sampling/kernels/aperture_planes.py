"""Planes that bound the light of a pixel in a microlens, from its linear ray transfers: device functions."""

from __future__ import annotations

import math

from plenoptic.core.kernels.polygons import cut
from plenoptic.core.numba.jit import device

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
        planes[n, A], planes[n, B] = (
            nx * transfer.x_by_x + ny * transfer.y_by_x,
            nx * transfer.x_by_y + ny * transfer.y_by_y,
        )
        planes[n, S], planes[n, T] = (
            nx * transfer.x_by_u + ny * transfer.y_by_u,
            nx * transfer.x_by_v + ny * transfer.y_by_v,
        )
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
    x, y = (
        x + transfer.x_by_u * centre[0] + transfer.x_by_v * centre[1],
        y + transfer.y_by_u * centre[0] + transfer.y_by_v * centre[1],
    )
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
def clip_outermost(polygon, n, planes, first, end, half):
    """Clip a polygon with planes, each at its outermost position over the pixel; return the number of corners."""
    for j in range(first, end):
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
    motion[0] = (transfer.x_by_y * transfer.y_by_u - transfer.y_by_y * transfer.x_by_u) / det
    motion[1] = (transfer.x_by_y * transfer.y_by_v - transfer.y_by_y * transfer.x_by_v) / det
    motion[2] = (transfer.y_by_x * transfer.x_by_u - transfer.x_by_x * transfer.y_by_u) / det
    motion[3] = (transfer.y_by_x * transfer.x_by_v - transfer.x_by_x * transfer.y_by_v) / det
    by_x, by_y = (
        abs(motion[0]) * half[0] + abs(motion[1]) * half[1],
        abs(motion[2]) * half[0] + abs(motion[3]) * half[1],
    )
    left, right = -polygon_reach(polygon, n, -1.0, 0.0) - by_x, polygon_reach(polygon, n, 1.0, 0.0) + by_x
    low, high = -polygon_reach(polygon, n, 0.0, -1.0) - by_y, polygon_reach(polygon, n, 0.0, 1.0) + by_y
    box[0, 0], box[0, 1], box[0, 2], box[0, 3] = left, right, right, left
    box[1, 0], box[1, 1], box[1, 2], box[1, 3] = low, low, high, high
    return 4


@device
def clip_at_centre(polygon, n, planes, first, end):
    """Clip a polygon with planes at their position for the pixel's centre; return the number of corners."""
    for j in range(first, end):
        if 0 < n < MAX_CORNERS:
            n = cut(polygon, 0, n, planes[j, A], planes[j, B], planes[j, LIMIT])
    return n
