"""The optical path of rays from element to element: the kernels.

Rays between two elements are straight, and a ray stands on one until it is moved to the next: the way is that from
where it stood, along its direction there, in the axes of the element that it meets.
"""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import BLOCK, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device


@device
def begin_path(path, ray):
    """Rays as they were given: how far they will be moved to the point closest to the lens origin."""
    for i in range(BLOCK):
        ahead = -(ray[X + i] * ray[L + i] + ray[Y + i] * ray[M + i] + ray[Z + i] * ray[N + i])
        path.length[i] = path.indices[0] * ahead


@device
def keep_start(path, ray):
    """Store positions and directions of rays before they are moved to an element, in its axes."""
    for row in range(6):
        for i in range(BLOCK):
            path.start[row, i] = ray[row * BLOCK + i]


@device
def add_path(path, ray, k):
    """Rays stand on element k now."""
    index, start = path.indices[k], path.start
    for i in range(BLOCK):
        x, y, z = ray[X + i] - start[0, i], ray[Y + i] - start[1, i], ray[Z + i] - start[2, i]
        path.length[i] += index * (x * start[3, i] + y * start[4, i] + z * start[5, i])
