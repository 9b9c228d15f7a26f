"""Where exactly a ray meets a triangle, and what the surface is like there: device functions."""

from __future__ import annotations

import math

from plenoptic._jit import device

OFFSET = 2.0**-20
"""Secondary rays start off the surface by this much of the coordinates that float32 has rounded: 16 units of
rounding of the numbers in which Embree holds the triangles (after C. Waechter and N. Binder, Ray Tracing Gems,
2019, ch. 6, with a length along the normal in place of one shift a component)."""


OFFSET_64 = 2.0**-42
"""And by this much of all coordinates, for the rounding of the hit point itself in float64."""


SHADOW_END = 1.0 - 2.0**-18
"""Where shadow rays end, as a part of the way to the light: float32 must not find the light itself in between."""


@device
def meet(ray, vertices, triangles, k):
    """Distance along the ray to the plane of triangle k, two barycentric coordinates there, and its normal.

    The normal is not normalised. All in float64 from the float64 vertices; a triangle without area gives NaN.
    """
    a, b, c = vertices[triangles[k, 0]], vertices[triangles[k, 1]], vertices[triangles[k, 2]]
    e1x, e1y, e1z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    e2x, e2y, e2z = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    ox, oy, oz = ray[0] - a[0], ray[1] - a[1], ray[2] - a[2]
    t = -(nx * ox + ny * oy + nz * oz) / (nx * ray[3] + ny * ray[4] + nz * ray[5])
    px, py, pz = ox + t * ray[3], oy + t * ray[4], oz + t * ray[5]
    n2 = nx * nx + ny * ny + nz * nz
    u = (nx * (py * e2z - pz * e2y) + ny * (pz * e2x - px * e2z) + nz * (px * e2y - py * e2x)) / n2
    v = (nx * (e1y * pz - e1z * py) + ny * (e1z * px - e1x * pz) + nz * (e1x * py - e1y * px)) / n2
    return t, min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0), nx, ny, nz


@device
def distance_and_facing(ray, vertices, triangles, k):
    """Distance along the ray to the plane of triangle k, and whether its front is seen."""
    a, b, c = vertices[triangles[k, 0]], vertices[triangles[k, 1]], vertices[triangles[k, 2]]
    e1x, e1y, e1z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    e2x, e2y, e2z = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    along = nx * ray[3] + ny * ray[4] + nz * ray[5]
    t = -(nx * (ray[0] - a[0]) + ny * (ray[1] - a[1]) + nz * (ray[2] - a[2])) / along
    return t, along < 0.0


@device
def clearance(px, py, pz, nx, ny, nz, vertices, triangles, k, middle):
    """How far off triangle k, at a point of it with the unit normal n, a ray must start to be in front of it.

    In float32 the triangle lies off its place by the rounding of its corners, relative to the `middle` of the scene,
    along the normal: coordinates along the surface, large as they may be, do not count.
    """
    ax, ay, az = abs(nx), abs(ny), abs(nz)
    across = ax * abs(px - middle[0]) + ay * abs(py - middle[1]) + az * abs(pz - middle[2])
    along = abs(px) + abs(py) + abs(pz)
    for corner in range(3):
        v = vertices[triangles[k, corner]]
        size = ax * abs(v[0] - middle[0]) + ay * abs(v[1] - middle[1]) + az * abs(v[2] - middle[2])
        reach = ax * abs(v[0] - px) + ay * abs(v[1] - py) + az * abs(v[2] - pz)
        across = max(across, size + reach)
        along = max(along, abs(v[0]) + abs(v[1]) + abs(v[2]))
    return OFFSET * across + OFFSET_64 * along


@device
def interpolated_normal(normals, triangles, k, u, v):
    """Vertex normals in between, of unit length; zeros where the triangle has none."""
    a, b, c = normals[triangles[k, 0]], normals[triangles[k, 1]], normals[triangles[k, 2]]
    w = 1.0 - u - v
    x = w * a[0] + u * b[0] + v * c[0]
    y = w * a[1] + u * b[1] + v * c[1]
    z = w * a[2] + u * b[2] + v * c[2]
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        return 0.0, 0.0, 0.0
    return x / length, y / length, z / length


@device
def texel_weights(uv, triangles, k, u, v, shape):
    """Four rows of `texels` around a point and their bilinear weights; the image repeats, v points up."""
    a, b, c = uv[triangles[k, 0]], uv[triangles[k, 1]], uv[triangles[k, 2]]
    w = 1.0 - u - v
    start, rows, columns = shape[0], shape[1], shape[2]
    x = (w * a[0] + u * b[0] + v * c[0]) * columns - 0.5
    y = (1.0 - (w * a[1] + u * b[1] + v * c[1])) * rows - 0.5
    left, top = math.floor(x), math.floor(y)
    fx, fy = x - left, y - top
    c0, r0 = int(left) % columns, int(top) % rows
    c1, r1 = (c0 + 1) % columns, (r0 + 1) % rows
    return (
        start + r0 * columns + c0,
        start + r0 * columns + c1,
        start + r1 * columns + c0,
        start + r1 * columns + c1,
        fx,
        fy,
    )
