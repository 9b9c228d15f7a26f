"""Rays that have left the lens, in the world: the kernel."""

from __future__ import annotations

from plenoptic.core.jit import kernel
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, L, M, N, X, Y, Z


@kernel
def fill_world_rays(rays, path, blocks, n, rotation, position):
    """The rays of a bundle that left the lens, as rows of origin and direction in the world; returns how many.

    `rotation` and `position` are None where the world is the camera's frame.
    """
    found = 0
    for k in range(n):
        base = (k // BLOCK) * RAY + k % BLOCK
        if blocks[base + STATUS] != 0.0:
            continue
        x, y, z = blocks[base + X], blocks[base + Y], blocks[base + Z]
        l, m, n_z = blocks[base + L], blocks[base + M], blocks[base + N]
        row = rays[found]
        if rotation is None:
            row[0], row[1], row[2], row[3], row[4], row[5] = x, y, z, l, m, n_z
        else:
            for axis in range(3):
                row[axis] = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z + position[axis]
                row[3 + axis] = rotation[axis, 0] * l + rotation[axis, 1] * m + rotation[axis, 2] * n_z
        path[found] = k
        found += 1
    return found
