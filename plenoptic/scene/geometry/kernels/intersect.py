"""Exact intersection of a ray with a triangle, and the surface there: device functions.

The rows of `Geometry.instance_to_world` begin with the 12 numbers of a 3 x 4 matrix, row by row.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.vectors import absolute, add, cross, dot, row_vector, scale, sub
from plenoptic.core.numba.jit import device
from plenoptic.scene.geometry.geometry_records import INSTANCE_DISTANCE, RAY_OFFSET, RAY_OFFSET_64

SHADOW_END = 1.0 - 2.0**-18
"""Where shadow rays end, as a part of the way to the light: float32 must not find the light itself in between."""


@device
def corners(vertices, triangles, k, instance_to_world, instance):
    """The three corners of triangle k in the world.

    `instance` is the row of `instance_to_world` (None without instances) that brings it there, -1 where it is there.
    """
    i, j, k = triangles[k, 0], triangles[k, 1], triangles[k, 2]
    a, b, c = row_vector(vertices, i, 0), row_vector(vertices, j, 0), row_vector(vertices, k, 0)
    if instance_to_world is not None:
        if instance >= 0:
            m = instance_to_world[instance]
            a, b, c = transform_point(m, a), transform_point(m, b), transform_point(m, c)
    return a, b, c


@device
def intersect_triangle(origin, direction, triangle):
    """Distance along a ray to the plane of a triangle, two barycentric coordinates there, and its normal.

    The normal is not normalised. All in float64 from the float64 vertices; a triangle without area gives NaN.
    """
    a, b, c = triangle
    e1, e2 = sub(b, a), sub(c, a)
    n = cross(e1, e2)
    o = sub(origin, a)
    t = -dot(n, o) / dot(n, direction)
    p = add(o, scale(direction, t))
    over = 1.0 / dot(n, n)
    u, v = dot(n, cross(p, e2)) * over, dot(n, cross(e1, p)) * over
    return t, min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0), n


@device
def ray_offset(point, normal, triangle, middle, distance):
    """Distance from a triangle, at a point of it with the unit normal, at which a ray must start to be in front of it.

    In float32 the triangle lies off its place by the rounding of its corners, relative to the `middle` of the scene,
    along the normal: coordinates along the surface, large as they may be, do not count. For an instance, the ray was
    turned in float32, and they all count, as does the `distance` of its mesh's own middle from that of the scene; it
    is negative for other triangles.
    """
    a, b, c = triangle
    m = absolute(normal)
    if distance >= 0.0:
        m = (1.0, 1.0, 1.0)
    across = dot(m, absolute(sub(point, middle)))
    at_a = dot(m, add(absolute(sub(a, middle)), absolute(sub(a, point))))
    at_b = dot(m, add(absolute(sub(b, middle)), absolute(sub(b, point))))
    at_c = dot(m, add(absolute(sub(c, middle)), absolute(sub(c, point))))
    along = max(_sum(absolute(point)), max(_sum(absolute(a)), _sum(absolute(b)), _sum(absolute(c))))
    return RAY_OFFSET * max(across, at_a, at_b, at_c, distance) + RAY_OFFSET_64 * along


NEAR_EDGE = 2.0**-10
"""Barycentric coordinates below which it is asked whether a point lies beyond an edge; and how far it moves at most,
in parts of its way to the middle of the triangle."""


@device
def pull_inside_triangle(point, triangle, coordinates, twice, offset):
    """A point of a triangle, from beyond an edge, where Embree finds grown triangles, to `offset` inside.

    A ray from beyond the edge between two walls has left the room, and one that starts nearer than the offset may have,
    in float32. `coordinates` are barycentric, `twice` is double the area.
    """
    a, b, c = triangle
    sides = sub(c, b), sub(a, c), sub(b, a)
    fraction = 0.0
    for k in range(3):
        inside = offset * math.sqrt(dot(sides[k], sides[k])) / twice
        if coordinates[k] < inside:
            fraction = max(fraction, (inside - coordinates[k]) / (1.0 / 3.0 - coordinates[k]))
    centre = scale(add(add(a, b), c), 1.0 / 3.0)
    return add(point, scale(sub(centre, point), min(fraction, NEAR_EDGE)))


@device
def _sum(a):
    return a[0] + a[1] + a[2]


@device
def interpolate_normal(normals, triangles, k, u, v):
    """Vertex normals in between, of unit length; zeros where the triangle has none."""
    i, j, k = triangles[k, 0], triangles[k, 1], triangles[k, 2]
    w = 1.0 - u - v
    x = w * normals[i, 0] + u * normals[j, 0] + v * normals[k, 0]
    y = w * normals[i, 1] + u * normals[j, 1] + v * normals[k, 1]
    z = w * normals[i, 2] + u * normals[j, 2] + v * normals[k, 2]
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        return 0.0, 0.0, 0.0
    over = 1.0 / length
    return x * over, y * over, z * over


@device
def interpolate_uv(uv, triangles, k, u, v):
    """Texture coordinates in between; 0 in scenes without any."""
    if uv is None:
        return 0.0, 0.0
    i, j, k = triangles[k, 0], triangles[k, 1], triangles[k, 2]
    w = 1.0 - u - v
    return w * uv[i, 0] + u * uv[j, 0] + v * uv[k, 0], w * uv[i, 1] + u * uv[j, 1] + v * uv[k, 1]


@device
def transform_point(m, p):
    """A point through a matrix."""
    return (
        m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3],
        m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7],
        m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11],
    )


@device
def transform_normal(m, n):
    """A normal by the cofactors of the 3 x 3 part of a matrix, at unit length; zeros stay."""
    x, y, z = n
    a = (m[5] * m[10] - m[6] * m[9]) * x + (m[6] * m[8] - m[4] * m[10]) * y + (m[4] * m[9] - m[5] * m[8]) * z
    b = (m[2] * m[9] - m[1] * m[10]) * x + (m[0] * m[10] - m[2] * m[8]) * y + (m[1] * m[8] - m[0] * m[9]) * z
    c = (m[1] * m[6] - m[2] * m[5]) * x + (m[2] * m[4] - m[0] * m[6]) * y + (m[0] * m[5] - m[1] * m[4]) * z
    length = math.sqrt(a * a + b * b + c * c)
    if not length > 0.0:
        return 0.0, 0.0, 0.0
    return a / length, b / length, c / length


@device
def is_reflection(instance_to_world, instance):
    """True if corners that run counter-clockwise in the frame of the mesh run clockwise in the world."""
    if instance_to_world is not None:
        if instance >= 0:
            m = instance_to_world[instance]
            x = m[5] * m[10] - m[6] * m[9]
            y = m[6] * m[8] - m[4] * m[10]
            z = m[4] * m[9] - m[5] * m[8]
            return m[0] * x + m[1] * y + m[2] * z < 0.0
    return False


@device
def instance_distance(instance_to_world, instance):
    """Distance of the middle of an instance's mesh from that of the scene, see `ray_offset`; -1 for plain triangles."""
    if instance_to_world is not None:
        if instance >= 0:
            return instance_to_world[instance, INSTANCE_DISTANCE]
    return -1.0
