"""Kernel: rays from points of microlenses to points of a plane at the pupil."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import kernel


@kernel
def fill_pupil_rays(blocks, start, turn, z, rows, x, y):
    """Fill a bundle (n_blocks * RAY,) with the rays from start[rows] (m,) to the points (x, y) of the plane `z`.

    `start` (n, 3) is in the lens's axes; x, y (m,) are in axes rotated by the angle of cosine and sine `turn` (n, 2).
    The last ray is repeated up to the end of its block.
    """
    for i in range(blocks.size // RAY * BLOCK):
        j = min(i, rows.size - 1)
        k, ray = rows[j], i // BLOCK * RAY + i % BLOCK
        cos, sin = turn[k, 0], turn[k, 1]
        dx, dy, dz = cos * x[j] - sin * y[j] - start[k, 0], sin * x[j] + cos * y[j] - start[k, 1], z - start[k, 2]
        per_length = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
        blocks[ray + X], blocks[ray + Y], blocks[ray + Z] = start[k, 0], start[k, 1], start[k, 2]
        blocks[ray + L], blocks[ray + M], blocks[ray + N] = dx * per_length, dy * per_length, dz * per_length
        blocks[ray + WEIGHT], blocks[ray + STATUS] = 1.0, 0.0
