"""What surfaces are like where rays meet them: the kernels.

What is known of a hit is a row of WIDTH numbers, at the places named here.
"""

from __future__ import annotations

import math

from plenoptic._jit import device, kernel
from plenoptic._sobol import set_index, set_key
from plenoptic.scene._hit import clearance, corners, interpolated_normal, interpolated_uv, meet, reach_of

POINT, GEOMETRIC, SHADING = 0, 3, 6
"""Where three numbers begin: the point; the triangle's unit normal on the side of the ray; the shading normal."""
CLEARANCE, DISTANCE, FRONT, ROUGHNESS, METALLIC, S, T = 9, 10, 11, 12, 13, 14, 15
WIDTH = 16


@kernel
def fill_surfaces(
    surface,
    lane_of,
    material_of,
    set_keys,
    set_indices,
    hits,
    placed,
    rays,
    path_of,
    path_key,
    path_index,
    bounce,
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

    `lane_of` names their rays and `material_of` their materials; `set_keys` and `set_indices` are those of the Sobol
    points for this bounce. `normals`, `uv`, `placed` and `matrices` are None in
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
        ray = rays[i]
        place = -1 if placed is None else placed[i]
        ax, ay, az, bx, by, bz, cx, cy, cz = corners(vertices, triangles, k, matrices, place)
        t, u, v, gx, gy, gz = meet(ray, ax, ay, az, bx, by, bz, cx, cy, cz)
        if not t > 0.0 or not t < math.inf:
            continue
        # The geometric normal towards the side that the ray comes from; the shading normal beside it.
        scale = 1.0 / math.sqrt(gx * gx + gy * gy + gz * gz)
        front = 1.0
        if gx * ray[3] + gy * ray[4] + gz * ray[5] > 0.0:
            scale, front = -scale, 0.0
        if matrices is not None:
            if place >= 0 and mirrors(matrices[place]):
                front = 1.0 - front
        gx, gy, gz = gx * scale, gy * scale, gz * scale
        px, py, pz = ray[0] + t * ray[3], ray[1] + t * ray[4], ray[2] + t * ray[5]
        row = surface[found]
        row[0], row[1], row[2] = px, py, pz
        row[3], row[4], row[5] = gx, gy, gz
        row[6], row[7], row[8] = gx, gy, gz
        if normals is not None:
            sx, sy, sz = interpolated_normal(normals, triangles, k, u, v)
            if matrices is not None:
                if place >= 0:
                    sx, sy, sz = turned_normal(matrices[place], sx, sy, sz)
            side = 1.0 if sx * gx + sy * gy + sz * gz >= 0.0 else -1.0
            sx, sy, sz = side * sx, side * sy, side * sz
            if sx * ray[3] + sy * ray[4] + sz * ray[5] < 0.0:
                row[6], row[7], row[8] = sx, sy, sz
        reach = reach_of(matrices, place)
        row[9] = clearance(px, py, pz, gx, gy, gz, ax, ay, az, bx, by, bz, cx, cy, cz, middle, reach)
        row[10], row[11] = t, front
        if roughness is not None:
            row[12] = roughness[material]
        if metallic is not None:
            row[13] = metallic[material]
        if uv is not None:
            row[14], row[15] = interpolated_uv(uv, triangles, k, u, v)
        lane_of[found] = i
        material_of[found] = material
        path = path_of[i]
        key = set_key(path_key[path], bounce + 1)
        set_keys[found] = key
        set_indices[found] = set_index(path_index[path], key, bounce + 1)
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
def behind(ray, k, place, vertices, triangles, matrices):
    """Whether a ray meets triangle k from behind."""
    _, _, _, x, y, z = meet(ray, *corners(vertices, triangles, k, matrices, place))
    back = x * ray[3] + y * ray[4] + z * ray[5] > 0.0
    if matrices is not None:
        if place >= 0 and mirrors(matrices[place]):
            back = not back
    return back


@kernel
def fill_normals(normals, lane_of, hits, placed, rays, vertices, triangles, matrices):
    """Unit normal of the triangle that each ray meets, towards where the ray comes from; by rows `lane_of`."""
    for i in range(hits.size):
        place = -1 if placed is None else placed[i]
        _, _, _, x, y, z = meet(rays[i], *corners(vertices, triangles, hits[i], matrices, place))
        length = math.sqrt(x * x + y * y + z * z)
        if x * rays[i, 3] + y * rays[i, 4] + z * rays[i, 5] > 0.0:
            length = -length
        row = normals[lane_of[i]]
        row[0], row[1], row[2] = x / length, y / length, z / length


@kernel
def fill_distances(distances, hits, placed, rays, vertices, triangles, matrices):
    """Distance along each ray to the triangle it meets, in float64 from the float64 vertices; inf without one."""
    for i in range(hits.size):
        distances[i] = math.inf
        if hits[i] >= 0:
            place = -1 if placed is None else placed[i]
            t, _, _, _, _, _ = meet(rays[i], *corners(vertices, triangles, hits[i], matrices, place))
            if t > 0.0:
                distances[i] = t
