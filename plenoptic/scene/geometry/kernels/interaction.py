"""Kernels of surface interactions. See `scene.geometry.geometry_records` for the records that they read and fill."""

from __future__ import annotations

import math

from plenoptic.core.kernels.vectors import add, dot, fill_vector, row_vector, scale, vector
from plenoptic.core.numba.jit import kernel
from plenoptic.scene.geometry.geometry_records import FRONT, NORMAL, OFFSET, POINT, SHADING_NORMAL, UV
from plenoptic.scene.geometry.kernels.intersect import (
    NEAR_EDGE,
    corners,
    instance_distance,
    interpolate_normal,
    interpolate_uv,
    intersect_triangle,
    is_reflection,
    pull_inside_triangle,
    ray_offset,
    transform_normal,
)


@kernel
def fill_interactions(interactions, hits, rays, path, geometry, scatters):
    """Fill a row for each ray that hits a scattering surface; returns their number.

    Roughness, metallic and base colour are left to the materials.
    """
    rows, ray_of, path_of, material_of = interactions.rows, interactions.ray, interactions.path, interactions.material
    vertices, triangles, triangle_material = geometry.vertices, geometry.triangles, geometry.triangle_material
    instance_to_world = geometry.instance_to_world
    normals = geometry.normals
    uv = geometry.uv
    instances = hits.instance
    hit = hits.triangle
    middle = vector(geometry.middle, 0)
    row = 0
    for i in range(hit.size):
        k = hit[i]
        if k < 0:
            continue
        material = triangle_material[k]
        if scatters[material] == 0:
            continue
        instance = -1 if instances is None else instances[i]
        triangle = corners(vertices, triangles, k, instance_to_world, instance)
        direction = row_vector(rays, i, 3)
        t, u, v, g = intersect_triangle(row_vector(rays, i, 0), direction, triangle)
        if not t > 0.0 or not t < math.inf:
            continue
        # The geometric normal towards the side that the ray comes from; the shading normal beside it.
        over = 1.0 / math.sqrt(dot(g, g))
        front = 1.0
        if dot(g, direction) > 0.0:
            over, front = -over, 0.0
        if is_reflection(instance_to_world, instance):
            front = 1.0 - front
        g = scale(g, over)
        point = add(row_vector(rays, i, 0), scale(direction, t))
        offset = ray_offset(point, g, triangle, middle, instance_distance(instance_to_world, instance))
        w = 1.0 - u - v
        if min(u, v, w) < NEAR_EDGE:
            point = pull_inside_triangle(point, triangle, (w, u, v), 1.0 / abs(over), offset)
        fill_vector(rows, row, POINT, point)
        fill_vector(rows, row, NORMAL, g)
        fill_vector(rows, row, SHADING_NORMAL, g)
        if normals is not None:
            s = interpolate_normal(normals, triangles, k, u, v)
            if instance_to_world is not None:
                if instance >= 0:
                    s = transform_normal(instance_to_world[instance], s)
            s = scale(s, 1.0 if dot(s, g) >= 0.0 else -1.0)
            if dot(s, direction) < 0.0:
                fill_vector(rows, row, SHADING_NORMAL, s)
        rows[row, OFFSET] = offset
        rows[row, FRONT] = front
        if uv is not None:
            rows[row, UV], rows[row, UV + 1] = interpolate_uv(uv, triangles, k, u, v)
        ray_of[row], path_of[row], material_of[row] = i, path[i], material
        row += 1
    return row


@kernel
def meets_back(rays, hits, geometry):
    """True if the first of some rays hits a triangle from behind."""
    instance = -1 if hits.instance is None else hits.instance[0]
    triangle = corners(geometry.vertices, geometry.triangles, hits.triangle[0], geometry.instance_to_world, instance)
    _, _, _, normal = intersect_triangle(row_vector(rays, 0, 0), row_vector(rays, 0, 3), triangle)
    return (dot(normal, row_vector(rays, 0, 3)) > 0.0) != is_reflection(geometry.instance_to_world, instance)


@kernel
def fill_normals(normals, lane_of, hits, rays, geometry):
    """Unit normal of the triangle hit by each ray, towards the ray's origin; by rows `lane_of`."""
    vertices, triangles = geometry.vertices, geometry.triangles
    instance_to_world = geometry.instance_to_world
    instances = hits.instance
    for i in range(hits.triangle.size):
        instance = -1 if instances is None else instances[i]
        triangle = corners(vertices, triangles, hits.triangle[i], instance_to_world, instance)
        _, _, _, n = intersect_triangle(row_vector(rays, i, 0), row_vector(rays, i, 3), triangle)
        length = math.sqrt(dot(n, n))
        if dot(n, row_vector(rays, i, 3)) > 0.0:
            length = -length
        fill_vector(normals, lane_of[i], 0, (n[0] / length, n[1] / length, n[2] / length))


@kernel
def fill_distances(distances, hits, rays, geometry):
    """Distance along each ray to the triangle it hits, in float64 from the float64 vertices; inf without one."""
    vertices, triangles = geometry.vertices, geometry.triangles
    instance_to_world = geometry.instance_to_world
    instances = hits.instance
    for i in range(hits.triangle.size):
        distances[i] = math.inf
        if hits.triangle[i] >= 0:
            instance = -1 if instances is None else instances[i]
            triangle = corners(vertices, triangles, hits.triangle[i], instance_to_world, instance)
            t, _, _, _ = intersect_triangle(row_vector(rays, i, 0), row_vector(rays, i, 3), triangle)
            if t > 0.0:
                distances[i] = t
