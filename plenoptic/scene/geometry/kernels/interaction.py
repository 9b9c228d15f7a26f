"""What surfaces are like where rays meet them: the kernels.

What is known of a hit is a row of WIDTH numbers: 0 to 2 the point, 3 to 5 the triangle's unit normal on the side of the
ray, 6 to 8 the shading normal, 9 the clearance, 10 the distance, 11 whether the front is seen (1 or 0), 12 roughness,
13 the share of metal, 14 and 15 texture coordinates.
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device, kernel
from plenoptic.scene.geometry.kernels.intersect import (
    clearance,
    corners,
    interpolated_normal,
    interpolated_uv,
    meet,
    reach_of,
)

WIDTH = 16


@kernel
def fill_surfaces(
    surface,
    lane_of,
    material_of,
    hits,
    placed,
    rays,
    vertices,
    triangles,
    triangle_material,
    scatters,
    normals,
    uv,
    matrices,
    middle,
    roughness,
    metallic,
):
    """Fill a row for each ray that meets a surface that scatters; returns how many there are.

    `lane_of` names their rays and `material_of` their materials. `normals`, `uv`, `placed` and `matrices` are None in
    scenes without, `roughness` and `metallic` (materials,) where no material has any.
    """
    found = 0
    for i in range(hits.size):
        k = hits[i]
        if k < 0:
            continue
        material = triangle_material[k]
        if scatters[material] == 0:
            continue
        place = -1 if placed is None else placed[i]
        ax, ay, az, bx, by, bz, cx, cy, cz = corners(vertices, triangles, k, matrices, place)
        t, u, v, gx, gy, gz = meet(rays, i, ax, ay, az, bx, by, bz, cx, cy, cz)
        if not t > 0.0 or not t < math.inf:
            continue
        # The geometric normal towards the side that the ray comes from; the shading normal beside it.
        scale = 1.0 / math.sqrt(gx * gx + gy * gy + gz * gz)
        front = 1.0
        if gx * rays[i, 3] + gy * rays[i, 4] + gz * rays[i, 5] > 0.0:
            scale, front = -scale, 0.0
        if matrices is not None:
            if place >= 0 and mirrors(matrices[place]):
                front = 1.0 - front
        gx, gy, gz = gx * scale, gy * scale, gz * scale
        px, py, pz = rays[i, 0] + t * rays[i, 3], rays[i, 1] + t * rays[i, 4], rays[i, 2] + t * rays[i, 5]
        surface[found, 0], surface[found, 1], surface[found, 2] = px, py, pz
        surface[found, 3], surface[found, 4], surface[found, 5] = gx, gy, gz
        surface[found, 6], surface[found, 7], surface[found, 8] = gx, gy, gz
        if normals is not None:
            sx, sy, sz = interpolated_normal(normals, triangles, k, u, v)
            if matrices is not None:
                if place >= 0:
                    sx, sy, sz = turned_normal(matrices[place], sx, sy, sz)
            side = 1.0 if sx * gx + sy * gy + sz * gz >= 0.0 else -1.0
            sx, sy, sz = side * sx, side * sy, side * sz
            if sx * rays[i, 3] + sy * rays[i, 4] + sz * rays[i, 5] < 0.0:
                surface[found, 6], surface[found, 7], surface[found, 8] = sx, sy, sz
        reach = reach_of(matrices, place)
        surface[found, 9] = clearance(px, py, pz, gx, gy, gz, ax, ay, az, bx, by, bz, cx, cy, cz, middle, reach)
        surface[found, 10] = front
        if roughness is not None:
            surface[found, 11] = roughness[material]
        if metallic is not None:
            surface[found, 12] = metallic[material]
        if uv is not None:
            surface[found, 13], surface[found, 14] = interpolated_uv(uv, triangles, k, u, v)
        lane_of[found] = i
        material_of[found] = material
        found += 1
    return found


@device
def mirrors(m):
    """Whether a 3 x 4 matrix, (12,), turns right-handed into left-handed."""
    x = m[5] * m[10] - m[6] * m[9]
    y = m[6] * m[8] - m[4] * m[10]
    z = m[4] * m[9] - m[5] * m[8]
    return m[0] * x + m[1] * y + m[2] * z < 0.0


@device
def turned_normal(m, x, y, z):
    """A normal by the cofactors of the 3 x 3 part of a matrix, at unit length; zeros stay."""
    a = (m[5] * m[10] - m[6] * m[9]) * x + (m[6] * m[8] - m[4] * m[10]) * y + (m[4] * m[9] - m[5] * m[8]) * z
    b = (m[2] * m[9] - m[1] * m[10]) * x + (m[0] * m[10] - m[2] * m[8]) * y + (m[1] * m[8] - m[0] * m[9]) * z
    c = (m[1] * m[6] - m[2] * m[5]) * x + (m[2] * m[4] - m[0] * m[6]) * y + (m[0] * m[5] - m[1] * m[4]) * z
    length = math.sqrt(a * a + b * b + c * c)
    if not length > 0.0:
        return 0.0, 0.0, 0.0
    return a / length, b / length, c / length


@kernel
def behind(rays, k, place, vertices, triangles, matrices):
    """Whether the first of some rays meets triangle k from behind."""
    _, _, _, x, y, z = meet(rays, 0, *corners(vertices, triangles, k, matrices, place))
    back = x * rays[0, 3] + y * rays[0, 4] + z * rays[0, 5] > 0.0
    if matrices is not None:
        if place >= 0 and mirrors(matrices[place]):
            back = not back
    return back


@kernel
def fill_normals(normals, lane_of, hits, placed, rays, vertices, triangles, matrices):
    """Unit normal of the triangle that each ray meets, towards where the ray comes from; by rows `lane_of`."""
    for i in range(hits.size):
        place = -1 if placed is None else placed[i]
        _, _, _, x, y, z = meet(rays, i, *corners(vertices, triangles, hits[i], matrices, place))
        length = math.sqrt(x * x + y * y + z * z)
        if x * rays[i, 3] + y * rays[i, 4] + z * rays[i, 5] > 0.0:
            length = -length
        lane = lane_of[i]
        normals[lane, 0], normals[lane, 1], normals[lane, 2] = x / length, y / length, z / length


@kernel
def fill_distances(distances, hits, placed, rays, vertices, triangles, matrices):
    """Distance along each ray to the triangle it meets, in float64 from the float64 vertices; inf without one."""
    for i in range(hits.size):
        distances[i] = math.inf
        if hits[i] >= 0:
            place = -1 if placed is None else placed[i]
            t, _, _, _, _, _ = meet(rays, i, *corners(vertices, triangles, hits[i], matrices, place))
            if t > 0.0:
                distances[i] = t
