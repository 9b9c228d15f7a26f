"""Bundles of rays in whole blocks: kernels."""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel


@device
def pad(blocks, n):
    """Fill the last block from ray n on with lost rays."""
    for path in range(n, blocks.size // 8):
        ray = blocks[(path // BLOCK) * RAY : (path // BLOCK + 1) * RAY]
        i = path % BLOCK
        for row in range(8):
            ray[row * BLOCK + i] = 0.0
        ray[STATUS + i] = MISSED


@kernel
def fill_status_counts(counts, blocks, n):
    """Count the rays of a bundle for each status."""
    for k in range(n):
        counts[int(blocks[(k // BLOCK) * RAY + STATUS + k % BLOCK])] += 1


@kernel
def fill_world_rays(rays, path, blocks, n, rotation, position):
    """Transform the rays of a bundle that leave the lens into world rows (origin, direction); return their number.

    `rotation` and `position` are None if the world is the camera's frame.
    """
    n_rays = 0
    for k in range(n):
        base = (k // BLOCK) * RAY + k % BLOCK
        if blocks[base + STATUS] != 0.0:
            continue
        x, y, z = blocks[base + X], blocks[base + Y], blocks[base + Z]
        l, m, n_z = blocks[base + L], blocks[base + M], blocks[base + N]
        row = rays[n_rays]
        if rotation is None:
            row[0], row[1], row[2], row[3], row[4], row[5] = x, y, z, l, m, n_z
        else:
            for axis in range(3):
                row[axis] = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z + position[axis]
                row[3 + axis] = rotation[axis, 0] * l + rotation[axis, 1] * m + rotation[axis, 2] * n_z
        path[n_rays] = k
        n_rays += 1
    return n_rays
