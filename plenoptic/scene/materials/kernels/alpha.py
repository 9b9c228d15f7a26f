"""Surfaces that are not there for all paths: kernels."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.sobol import mix
from plenoptic.core.kernels.vectors import add, dot, fill_vector, row_vector, scale, vector
from plenoptic.core.numba.jit import device, kernel
from plenoptic.scene.geometry.kernels.intersect import (
    SHADOW_END,
    corners,
    instance_distance,
    interpolate_uv,
    intersect_triangle,
    ray_offset,
)
from plenoptic.scene.textures.kernels.lookup import opacity_at

_OPACITY_SALT = np.uint64(411)
_UNIT_53 = 2.0**-53


@kernel
def advance_rays(again, rays, hits, which, keys, shadows, geometry, alpha):
    """Advance those of the rays `which` that go through the surface they hit; returns their number, their indices in
    `again`.

    Those of paths go through it by chance, and with `keys` None through surfaces of opacity below one half. With
    `shadows` they are shadow rays, which are marked as blocked, or weakened and moved on.
    """
    vertices, triangles, uv = geometry.vertices, geometry.triangles, geometry.uv
    instance_to_world = geometry.instance_to_world
    instances = hits.instance
    rows = alpha.texture.row
    texels = alpha.texture.texels
    textures = alpha.texture.textures
    middle = vector(geometry.middle, 0)
    number = np.empty(1)
    passed = 0
    for j in range(which.size):
        i = which[j]
        k = hits.triangle[i]
        if k < 0:
            continue
        material = geometry.triangle_material[k]
        if shadows is None:
            if not alpha.opacity[material] < 1.0:
                continue
        instance = -1 if instances is None else instances[i]
        triangle = corners(vertices, triangles, k, instance_to_world, instance)
        origin, direction = row_vector(rays, i, 0), row_vector(rays, i, 3)
        t, u, v, normal = intersect_triangle(origin, direction, triangle)
        if shadows is None:
            if not t > 0.0:
                continue
        elif not t < SHADOW_END:
            continue
        coverage = 1.0
        if alpha.opacity[material] < 1.0 and t > 0.0:
            st = interpolate_uv(uv, triangles, k, u, v)
            texture = -1 if rows is None else rows[material]
            opacity, cutoff = alpha.opacity[material], alpha.cutoff[material]
            coverage = opacity_at(number, opacity, cutoff, texture, st, texels, textures)
        if shadows is not None:
            if coverage >= 1.0:
                shadows.blocked[i] = 1
                continue
            for c in range(shadows.radiance.shape[1]):
                shadows.radiance[i, c] *= 1.0 - coverage
        elif keys is None:
            if coverage >= 0.5:
                continue
        else:
            path = keys.path[i]
            key = mix(mix(keys.key[path], _OPACITY_SALT + np.uint64(keys.salt)), np.uint64(keys.number[path]))
            if np.float64(key >> np.uint64(11)) * _UNIT_53 < coverage:
                continue
        distance = instance_distance(instance_to_world, instance)
        t_next = t + step_behind(origin, direction, t, normal, triangle, middle, distance)
        if shadows is None:
            hits.travelled[i] += t_next
        else:
            if not t_next < SHADOW_END:
                continue
            fill_vector(rays, i, 3, scale(direction, 1.0 - t_next))
        fill_vector(rays, i, 0, add(origin, scale(direction, t_next)))
        again[passed] = i
        passed += 1
    return passed


@device
def step_behind(origin, direction, t, normal, triangle, middle, distance):
    """Distance along a ray from its hit at t to behind the triangle, as float32 sees it."""
    length = np.sqrt(dot(normal, normal))
    n = (normal[0] / length, normal[1] / length, normal[2] / length)
    off = ray_offset(add(origin, scale(direction, t)), n, triangle, middle, distance)
    speed = np.sqrt(dot(direction, direction))
    slope = abs(dot(n, direction)) / speed
    # At grazing incidence the way through the gap is long, but never longer than a hundred times its width.
    return off / (max(slope, 0.01) * speed)
