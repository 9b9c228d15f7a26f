"""Surfaces that are not there for all paths: kernels."""

from __future__ import annotations

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.sobol import mix
from plenoptic.scene.geometry.kernels.intersect import SHADOW_END, clearance, corners, meet, reach_of
from plenoptic.scene.textures.kernels.colors import opacity_at

_THERE = np.uint64(411)
_UNIT_53 = 2.0**-53


@kernel
def fill_passed(
    again,
    rays,
    travelled,
    hits,
    placed,
    which,
    path_of,
    path_key,
    path_index,
    salt,
    vertices,
    triangles,
    triangle_material,
    uv,
    matrices,
    middle,
    opacity,
    cutoff,
    opacity_texture,
    texels,
    texture_rows,
):
    """Of the rays `which`, move those on that go through the surface they met; returns how many, named in `again`.

    With `path_key` None they go through what is opaque to less than half.
    """
    share = np.empty(1)
    passed = 0
    for j in range(which.size):
        i = which[j]
        k = hits[i]
        if k < 0:
            continue
        material = triangle_material[k]
        if not opacity[material] < 1.0:
            continue
        place = -1 if placed is None else placed[i]
        ax, ay, az, bx, by, bz, cx, cy, cz = corners(vertices, triangles, k, matrices, place)
        t, u, v, nx, ny, nz = meet(rays, i, ax, ay, az, bx, by, bz, cx, cy, cz)
        if not t > 0.0:
            continue
        there = opacity_at(
            share, material, k, u, v, triangles, uv, opacity, cutoff, opacity_texture, texels, texture_rows
        )
        if path_key is None:
            if there >= 0.5:
                continue
        else:
            key = mix(mix(path_key[path_of[i]], _THERE + np.uint64(salt)), np.uint64(path_index[path_of[i]]))
            if np.float64(key >> np.uint64(11)) * _UNIT_53 < there:
                continue
        way = t + beyond(rays, i, t, nx, ny, nz, ax, ay, az, bx, by, bz, cx, cy, cz, middle, reach_of(matrices, place))
        rays[i, 0], rays[i, 1], rays[i, 2] = (
            rays[i, 0] + way * rays[i, 3],
            rays[i, 1] + way * rays[i, 4],
            rays[i, 2] + way * rays[i, 5],
        )
        travelled[i] += way
        again[passed] = i
        passed += 1
    return passed


@device
def beyond(rays, i, t, nx, ny, nz, ax, ay, az, bx, by, bz, cx, cy, cz, middle, reach):
    """How much farther along a ray it is behind the triangle that it meets at t, as float32 sees it."""
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    px, py, pz = rays[i, 0] + t * rays[i, 3], rays[i, 1] + t * rays[i, 4], rays[i, 2] + t * rays[i, 5]
    off = clearance(px, py, pz, nx, ny, nz, ax, ay, az, bx, by, bz, cx, cy, cz, middle, reach)
    speed = np.sqrt(rays[i, 3] * rays[i, 3] + rays[i, 4] * rays[i, 4] + rays[i, 5] * rays[i, 5])
    slope = abs(nx * rays[i, 3] + ny * rays[i, 4] + nz * rays[i, 5]) / speed
    # At grazing incidence the way through the gap is long, but never longer than a hundred times its width.
    return off / (max(slope, 0.01) * speed)


@kernel
def fill_thinned(
    again,
    blocked,
    shadow_radiance,
    rays,
    hits,
    placed,
    which,
    vertices,
    triangles,
    triangle_material,
    uv,
    matrices,
    middle,
    opacity,
    cutoff,
    opacity_texture,
    texels,
    texture_rows,
):
    """Of the shadow rays `which`, mark the blocked ones and weaken and move on those that go through what they met."""
    share = np.empty(1)
    passed = 0
    for j in range(which.size):
        i = which[j]
        k = hits[i]
        if k < 0:
            continue
        place = -1 if placed is None else placed[i]
        ax, ay, az, bx, by, bz, cx, cy, cz = corners(vertices, triangles, k, matrices, place)
        t, u, v, nx, ny, nz = meet(rays, i, ax, ay, az, bx, by, bz, cx, cy, cz)
        if not t < SHADOW_END:
            continue
        material = triangle_material[k]
        there = 1.0
        if opacity[material] < 1.0 and t > 0.0:
            there = opacity_at(
                share, material, k, u, v, triangles, uv, opacity, cutoff, opacity_texture, texels, texture_rows
            )
        if there >= 1.0:
            blocked[i] = 1
            continue
        for c in range(shadow_radiance.shape[1]):
            shadow_radiance[i, c] *= 1.0 - there
        way = t + beyond(rays, i, t, nx, ny, nz, ax, ay, az, bx, by, bz, cx, cy, cz, middle, reach_of(matrices, place))
        if not way < SHADOW_END:
            continue
        left = 1.0 - way
        rays[i, 0], rays[i, 1], rays[i, 2] = (
            rays[i, 0] + way * rays[i, 3],
            rays[i, 1] + way * rays[i, 4],
            rays[i, 2] + way * rays[i, 5],
        )
        rays[i, 3], rays[i, 4], rays[i, 5] = left * rays[i, 3], left * rays[i, 4], left * rays[i, 5]
        again[passed] = i
        passed += 1
    return passed
