"""Kernels: optical path length of rays from element to element.

Each step adds the index times the distance between two intersections, along the ray, in the axes of the next element.
"""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import BLOCK, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device


@device
def begin_path(path, ray):
    """Initialise path lengths in mm: from the origin of each input ray to its point closest to the lens origin."""
    for i in range(BLOCK):
        ahead = -(ray[X + i] * ray[L + i] + ray[Y + i] * ray[M + i] + ray[Z + i] * ray[N + i])
        path.length[i] = path.indices[0] * ahead


@device
def store_start(start, ray):
    """Store positions and directions of rays in (6, BLOCK), before their propagation to an element, in its axes."""
    for row in range(6):
        for i in range(BLOCK):
            start[row, i] = ray[row * BLOCK + i]


@device
def distance_from(start, ray, i):
    """Distance in mm of ray i from the stored point to the intersection with the element."""
    x, y, z = ray[X + i] - start[0, i], ray[Y + i] - start[1, i], ray[Z + i] - start[2, i]
    return x * start[3, i] + y * start[4, i] + z * start[5, i]


@device
def add_path(path, ray, k):
    """Add the optical path length from the stored points to the intersections with element k."""
    for i in range(BLOCK):
        path.length[i] += path.indices[k] * distance_from(path.start, ray, i)
