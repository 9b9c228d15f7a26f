"""Hit points of rays in the scene, and angles of incidence on the sensor."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, L, M, N, X, Y, Z
from plenoptic.core.kernels.vectors import cross, dot, row_vector, vector
from plenoptic.core.numba.jit import kernel


@kernel
def fill_hit_points(points, blocks, pixels, distances):
    """Fill the points (m, 3) at `distances` (m,) along the traced rays of `pixels` (m,), in the lens's axes."""
    for i in range(pixels.size):
        base = (pixels[i] // BLOCK) * RAY + pixels[i] % BLOCK
        points[i, 0] = blocks[base + X] + distances[i] * blocks[base + L]
        points[i, 1] = blocks[base + Y] + distances[i] * blocks[base + M]
        points[i, 2] = blocks[base + Z] + distances[i] * blocks[base + N]


@kernel
def fill_in_axes(moved, points, rotation, shift):
    """Fill the points (m, 3) after a rigid motion: rotation (3, 3), then shift (3,)."""
    for i in range(points.shape[0]):
        x, y, z = row_vector(points, i, 0)
        for axis in range(3):
            moved[i, axis] = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z + shift[axis]


@kernel
def fill_norms(norms, points):
    """Fill the distances of points (m, 3) from the origin."""
    for i in range(points.shape[0]):
        x, y, z = row_vector(points, i, 0)
        norms[i] = math.sqrt(x * x + y * y + z * z)


@kernel
def fill_incidence(angles, pixels, directions, normal):
    """Fill the angles of `pixels` between directions (n, 3) and a normal (3,) in radians.

    By the tangent, exact for small angles.
    """
    along_normal = vector(normal, 0)
    for p in pixels:
        ray = row_vector(directions, p, 0)
        across = cross(ray, along_normal)
        angles[p] = math.atan2(math.sqrt(dot(across, across)), dot(ray, along_normal))
