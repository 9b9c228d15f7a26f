"""Part of a microlens that illuminates a pixel, from its views of the openings of the lens: device functions."""

from __future__ import annotations

import math

from plenoptic.core.kernels.polygons import cut
from plenoptic.core.numba.jit import device

MOST_CORNERS = 64
"""Of a polygon that is cut; where it has more, further planes are left out."""

MOST_PLANES = 128
"""Tangents and edges of all elements that a microlens may see; further ones are left out."""

MOST_CERTAIN = 48
"""Planes inside of which light is certain to pass; where there are more, it is not known of any."""

_TANGENTS, _SAGITTA = 24, 0.01
"""Tangents around a circle, and how far it lies inside them, in parts of what is seen of it."""

A, B, LIMIT, S, T, GAP, NUMBERS = range(7)
"""Numbers of a plane: see `PLANE`."""


@device
def reach_of(polygon, n, a, b):
    """Largest projection of a polygon's corners onto (a, b)."""
    far = -math.inf
    for q in range(n):
        far = max(far, a * polygon[0, q] + b * polygon[1, q])
    return far


@device
def _tangents(far, reach, radius):
    """Tangents of a circle that bound the part within `reach` of a point `far` from its centre.

    Returns their number, the angle of the first relative to the direction of the point, and the step to the next.
    """
    if far <= reach:
        return _TANGENTS, 0.0, 2.0 * math.pi / _TANGENTS
    wide = 2.0 * math.asin(reach / far)
    count = min(math.ceil(wide / math.sqrt(8.0 * _SAGITTA * min(reach / radius, 1.0))), _TANGENTS)
    return count, -0.5 * wide * (1.0 - 1.0 / count), wide / count


@device
def _add(planes, n, view, edge, centre):
    """Append the plane of an edge, and how far the opening lies inside it, for (u, v) from a centre; returns how many
    there are."""
    nx, ny, distance, inside = edge
    if n < MOST_PLANES:
        planes[n, A], planes[n, B] = nx * view.x_by_x + ny * view.y_by_x, nx * view.x_by_y + ny * view.y_by_y
        planes[n, S], planes[n, T] = nx * view.x_by_u + ny * view.y_by_u, nx * view.x_by_v + ny * view.y_by_v
        planes[n, GAP] = inside + 2.0 * view.margin
        planes[n, LIMIT] = distance + view.margin - nx * view.x - ny * view.y
        planes[n, LIMIT] -= planes[n, S] * centre[0] + planes[n, T] * centre[1]
        return n + 1
    return n


@device
def fill_planes(planes, count, view, edges, candidate, shape, at):
    """Append the planes of a view that may cut a candidate's polygon, the n corners of which are `shape` (polygon, n).

    `at` are a centre on the sensor, from that of the group, and how far from there points matter along x and y. Returns
    how many planes there are.
    """
    (polygon, n), (centre, half) = shape, at
    x = view.x + view.x_by_x * candidate.x + view.x_by_y * candidate.y
    y = view.y + view.y_by_x * candidate.x + view.y_by_y * candidate.y
    x, y = x + view.x_by_u * centre[0] + view.x_by_v * centre[1], y + view.y_by_u * centre[0] + view.y_by_v * centre[1]
    reach = 0.0
    for q in range(n):
        dx, dy = polygon[0, q] - candidate.x, polygon[1, q] - candidate.y
        from_x, from_y = view.x_by_x * dx + view.x_by_y * dy, view.y_by_x * dx + view.y_by_y * dy
        reach = max(reach, from_x * from_x + from_y * from_y)
    reach = view.margin + math.sqrt(reach) + math.hypot(view.x_by_u, view.y_by_u) * half[0]
    reach += math.hypot(view.x_by_v, view.y_by_v) * half[1]
    far, radius = math.hypot(x, y), view.radius
    if view.edges == 0 and far + reach > radius:
        tangents, angle, step = _tangents(far, reach, radius)
        angle += math.atan2(y, x)
        # Chords of the arcs between the points at which tangents meet lie inside the circle.
        sagitta = radius * (1.0 - math.cos(0.5 * step))
        for k in range(tangents):
            normal = math.cos(angle + k * step), math.sin(angle + k * step)
            count = _add(planes, count, view, (normal[0], normal[1], radius, sagitta), centre)
    for j in range(view.first_edge, view.first_edge + view.edges):
        if edges[j, 0] * x + edges[j, 1] * y + reach > edges[j, 2]:
            count = _add(planes, count, view, (edges[j, 0], edges[j, 1], edges[j, 2], 0.0), centre)
    return count


@device
def sweep(plane, half):
    """Largest displacement of a plane between the centre of a pixel, or of a group, and its rim."""
    return abs(plane[S]) * half[0] + abs(plane[T]) * half[1]


@device
def begin(polygon, corners, candidate):
    """The polygon of a candidate; its number of corners."""
    for q in range(candidate.corners):
        polygon[0, q] = corners[0, candidate.first_corner + q]
        polygon[1, q] = corners[1, candidate.first_corner + q]
    return candidate.corners


@device
def cut_widely(polygon, n, planes, first, end, half):
    """Cut a polygon with planes, each as far out as it is anywhere on the pixel; the number of corners."""
    for j in range(first, end):
        if 0 < n < MOST_CORNERS:
            n = cut(polygon, 0, n, planes[j, A], planes[j, B], planes[j, LIMIT] + sweep(planes[j], half))
    return n


@device
def begin_moving(base, move, view, candidate, shape, half):
    """Box around all positions of a polygon that moves with the part which a view lets pass; its motion, as a matrix.

    The n corners of the polygon are `shape` (polygon, n). Returns the number of corners; 0 where the view is
    no larger than its margin, as through the centres of pinholes, and nothing is known.
    """
    polygon, n = shape
    det = view.x_by_x * view.y_by_y - view.x_by_y * view.y_by_x
    if abs(det) * candidate.half_x * candidate.half_y <= view.margin * view.margin:
        return 0
    move[0] = (view.x_by_y * view.y_by_u - view.y_by_y * view.x_by_u) / det
    move[1] = (view.x_by_y * view.y_by_v - view.y_by_y * view.x_by_v) / det
    move[2] = (view.y_by_x * view.x_by_u - view.x_by_x * view.y_by_u) / det
    move[3] = (view.y_by_x * view.x_by_v - view.x_by_x * view.y_by_v) / det
    by_x, by_y = abs(move[0]) * half[0] + abs(move[1]) * half[1], abs(move[2]) * half[0] + abs(move[3]) * half[1]
    left, right = -reach_of(polygon, n, -1.0, 0.0) - by_x, reach_of(polygon, n, 1.0, 0.0) + by_x
    low, high = -reach_of(polygon, n, 0.0, -1.0) - by_y, reach_of(polygon, n, 0.0, 1.0) + by_y
    base[0, 0], base[0, 1], base[0, 2], base[0, 3] = left, right, right, left
    base[1, 0], base[1, 1], base[1, 2], base[1, 3] = low, low, high, high
    return 4


@device
def cut_exactly(polygon, n, planes, first, end):
    """Cut a polygon with planes as they are for the centre of the pixel; the number of corners."""
    for j in range(first, end):
        if 0 < n < MOST_CORNERS:
            n = cut(polygon, 0, n, planes[j, A], planes[j, B], planes[j, LIMIT])
    return n
