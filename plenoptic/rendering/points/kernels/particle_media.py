"""Kernel: rays through bodies whose surfaces do not refract."""

from __future__ import annotations

import math

from plenoptic.core.kernels.vectors import add, dot, fill_vector, row_vector, scale, vector
from plenoptic.core.numba.jit import kernel
from plenoptic.scene.geometry.kernels.intersect import corners, instance_distance, intersect_triangle, is_reflection
from plenoptic.scene.materials.kernels.absorption import enter, innermost, leave
from plenoptic.scene.materials.kernels.alpha import step_behind


@kernel
def cross_surfaces(again, depth, segments, hits, which, geometry, extinction):
    """Move the rays `which` to behind the surfaces that they hit, or to their ends; returns the number of those that go
    on, their indices in `again`.

    `segments` are rays (n, 6) of unit direction, the lengths left (n,), and media (n, NESTED) as of `media_at`. `depth`
    (n, C) gets the optical depth, by `extinction` (media + 1, C) per mm, whose last row is that outside all bodies.
    """
    rays, left, media = segments
    n, middle, outside = 0, vector(geometry.middle, 0), extinction.shape[0] - 1
    for j in range(which.size):
        i, k = which[j], hits.triangle[j]
        origin, direction = row_vector(rays, i, 0), row_vector(rays, i, 3)
        inside, reached, step = innermost(media[i]), left[i], 0.0
        if k >= 0:
            instance = -1 if hits.instance is None else hits.instance[j]
            triangle = corners(geometry.vertices, geometry.triangles, k, geometry.instance_to_world, instance)
            t, _, _, normal = intersect_triangle(origin, direction, triangle)
            t = t if t > 0.0 else 0.0
            if t < left[i]:
                distance = instance_distance(geometry.instance_to_world, instance)
                reached, step = t, step_behind(origin, direction, t, normal, triangle, middle, distance)
                behind = (dot(normal, direction) > 0.0) != is_reflection(geometry.instance_to_world, instance)
                if behind:
                    leave(media[i], geometry.triangle_material[k])
                else:
                    enter(media[i], geometry.triangle_material[k])
        step = min(step, left[i] - reached)
        beyond = innermost(media[i])
        for c in range(depth.shape[1]):
            depth[i, c] += reached * extinction[inside if inside >= 0 else outside, c]
            depth[i, c] += step * extinction[beyond if beyond >= 0 else outside, c]
        left[i] -= reached + step
        fill_vector(rays, i, 0, add(origin, scale(direction, reached + step)))
        if left[i] > 0.0 and math.isfinite(left[i]):
            again[n] = i
            n += 1
    return n
