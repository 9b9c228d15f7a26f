"""Where exactly a ray meets a triangle, and what the surface is like there: device functions."""

from __future__ import annotations

import math

from plenoptic.core.jit import device

OFFSET = 2.0**-20
"""Secondary rays start off the surface by this much of the coordinates that float32 has rounded: 16 units of
rounding of the numbers in which Embree holds the triangles (after C. Waechter and N. Binder, Ray Tracing Gems,
2019, ch. 6, with a length along the normal in place of one shift a component)."""


OFFSET_64 = 2.0**-42
"""And by this much of all coordinates, for the rounding of the hit point itself in float64."""


SHADOW_END = 1.0 - 2.0**-18
"""Where shadow rays end, as a part of the way to the light: float32 must not find the light itself in between."""


@device
def corners(vertices, triangles, k, matrices, place):
    """The nine coordinates of the corners of triangle k in the world.

    `place` is the row of `matrices` (n, 13) that brings the triangle into the world, -1 where it is there already;
    `matrices` is None in scenes without instances.
    """
    # Rows are not taken out of arrays: a view costs two atomic counts of references.
    i, j, k = triangles[k, 0], triangles[k, 1], triangles[k, 2]
    ax, ay, az = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    bx, by, bz = vertices[j, 0], vertices[j, 1], vertices[j, 2]
    cx, cy, cz = vertices[k, 0], vertices[k, 1], vertices[k, 2]
    if matrices is not None:
        if place >= 0:
            m = matrices[place]
            ax, ay, az = moved(m, ax, ay, az)
            bx, by, bz = moved(m, bx, by, bz)
            cx, cy, cz = moved(m, cx, cy, cz)
    return ax, ay, az, bx, by, bz, cx, cy, cz


@device
def reach_of(matrices, place):
    """How far the middle of an instance's mesh is from that of the scene, as `clearance` wants it; -1 for others."""
    if matrices is not None:
        if place >= 0:
            return matrices[place, 12]
    return -1.0


@device
def moved(m, x, y, z):
    """A point through the rows of a 3 x 4 matrix, the first 12 of its numbers."""
    return (
        m[0] * x + m[1] * y + m[2] * z + m[3],
        m[4] * x + m[5] * y + m[6] * z + m[7],
        m[8] * x + m[9] * y + m[10] * z + m[11],
    )


@device
def meet(rays, i, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Distance along ray i to the plane of a triangle, two barycentric coordinates there, and its normal.

    The normal is not normalised. All in float64 from the float64 vertices; a triangle without area gives NaN.
    """
    e1x, e1y, e1z = bx - ax, by - ay, bz - az
    e2x, e2y, e2z = cx - ax, cy - ay, cz - az
    nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    ox, oy, oz = rays[i, 0] - ax, rays[i, 1] - ay, rays[i, 2] - az
    dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
    t = -(nx * ox + ny * oy + nz * oz) / (nx * dx + ny * dy + nz * dz)
    px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
    over = 1.0 / (nx * nx + ny * ny + nz * nz)
    u = (nx * (py * e2z - pz * e2y) + ny * (pz * e2x - px * e2z) + nz * (px * e2y - py * e2x)) * over
    v = (nx * (e1y * pz - e1z * py) + ny * (e1z * px - e1x * pz) + nz * (e1x * py - e1y * px)) * over
    return t, min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0), nx, ny, nz


@device
def clearance(px, py, pz, nx, ny, nz, ax, ay, az, bx, by, bz, cx, cy, cz, middle, reach):
    """How far off a triangle, at a point of it with the unit normal n, a ray must start to be in front of it.

    In float32 the triangle lies off its place by the rounding of its corners, relative to the `middle` of the scene,
    along the normal: coordinates along the surface, large as they may be, do not count. For an instance, the ray was
    turned in float32, and they all count, as does `reach`, how far its mesh's own middle is from that of the scene; it
    is negative for other triangles.
    """
    mx, my, mz = abs(nx), abs(ny), abs(nz)
    if reach >= 0.0:
        mx, my, mz = 1.0, 1.0, 1.0
    x, y, z = middle[0], middle[1], middle[2]
    across = mx * abs(px - x) + my * abs(py - y) + mz * abs(pz - z)
    a = mx * (abs(ax - x) + abs(ax - px)) + my * (abs(ay - y) + abs(ay - py)) + mz * (abs(az - z) + abs(az - pz))
    b = mx * (abs(bx - x) + abs(bx - px)) + my * (abs(by - y) + abs(by - py)) + mz * (abs(bz - z) + abs(bz - pz))
    c = mx * (abs(cx - x) + abs(cx - px)) + my * (abs(cy - y) + abs(cy - py)) + mz * (abs(cz - z) + abs(cz - pz))
    largest = max(abs(ax) + abs(ay) + abs(az), abs(bx) + abs(by) + abs(bz), abs(cx) + abs(cy) + abs(cz))
    along = max(abs(px) + abs(py) + abs(pz), largest)
    return OFFSET * max(across, a, b, c, reach) + OFFSET_64 * along


@device
def interpolated_normal(normals, triangles, k, u, v):
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
def interpolated_uv(uv, triangles, k, u, v):
    """Texture coordinates in between."""
    i, j, k = triangles[k, 0], triangles[k, 1], triangles[k, 2]
    w = 1.0 - u - v
    return w * uv[i, 0] + u * uv[j, 0] + v * uv[k, 0], w * uv[i, 1] + u * uv[j, 1] + v * uv[k, 1]
