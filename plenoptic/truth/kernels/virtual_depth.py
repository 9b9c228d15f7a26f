"""Kernels of virtual depth: images of hit points by the main lens.

A ray that left the array at (m, n) with slopes (u, v), and left the lens, meets a point P. Rays near it cross the
plane through P across the ray at X = A (dm, dn) + B (du, dv). Those that meet in P have A (dm, dn) = -B (du, dv): their
slopes fall across the array by B^-1 A, which is 1 / a in all directions if they meet at the distance a behind it.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel

NEIGHBOURS = 8
"""Rays around each ray: moved along x and y either way, then turned along x and y either way."""


@kernel
def fill_neighbours(blocks, before, lane_of, axes, step, turn):
    """Rays around those of `before`, which start at the array, NEIGHBOURS of each; in the lens's axes.

    `axes` (4, 3) are the array's x, y and normal and the centre of its front principal plane. Moved ones start `step`
    mm aside, turned ones start on that plane with slopes that differ by `turn`.
    """
    for i in range(lane_of.size):
        base = (lane_of[i] // BLOCK) * RAY + lane_of[i] % BLOCK
        x, y, z = before[base + X], before[base + Y], before[base + Z]
        l, m, n = before[base + L], before[base + M], before[base + N]
        along = axes[2, 0] * l + axes[2, 1] * m + axes[2, 2] * n
        t = axes[2, 0] * (axes[3, 0] - x) + axes[2, 1] * (axes[3, 1] - y) + axes[2, 2] * (axes[3, 2] - z)
        t /= along
        for k in range(NEIGHBOURS):
            at = i * NEIGHBOURS + k
            ray = blocks[(at // BLOCK) * RAY : (at // BLOCK + 1) * RAY]
            j = at % BLOCK
            axis = axes[(k >> 1) & 1]
            sign = 1.0 if k & 1 == 0 else -1.0
            aside = sign * step if k < 4 else 0.0
            bend = sign * turn * along if k >= 4 else 0.0
            dx, dy, dz = l + bend * axis[0], m + bend * axis[1], n + bend * axis[2]
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            ray[X + j] = x + t * l + aside * axis[0]
            ray[Y + j] = y + t * m + aside * axis[1]
            ray[Z + j] = z + t * n + aside * axis[2]
            ray[L + j] = dx / length
            ray[M + j] = dy / length
            ray[N + j] = dz / length
            ray[WEIGHT + j] = 1.0
            ray[STATUS + j] = 0.0
    pad(blocks, lane_of.size * NEIGHBOURS)


@device
def _crossing(blocks, at, px, py, pz, nx, ny, nz):
    """Intersection of ray `at` with the plane through p with the normal n, from p; nan for a lost ray."""
    base = (at // BLOCK) * RAY + at % BLOCK
    x, y, z = blocks[base + X] - px, blocks[base + Y] - py, blocks[base + Z] - pz
    l, m, n = blocks[base + L], blocks[base + M], blocks[base + N]
    t = -(x * nx + y * ny + z * nz) / (l * nx + m * ny + n * nz)
    void = 0.0 if blocks[base + STATUS] == 0.0 else math.nan
    return x + t * l + void, y + t * m + void, z + t * n + void


@kernel
def fill_image_distances(distances, blocks, main, points, lane_of, step, turn):
    """Distance from the array to the image of `points` (n, 3): the inverse of the mean of B^-1 A, in mm.

    `blocks` are the traced NEIGHBOURS of the traced rays `main`; lanes that are not in `lane_of` stay unchanged.
    """
    for i in range(lane_of.size):
        p = lane_of[i]
        base = (p // BLOCK) * RAY + p % BLOCK
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        nx, ny, nz = main[base + L], main[base + M], main[base + N]
        # Two axes across the ray (T. Duff et al., J. Comput. Graph. Tech. 6(1), 2017).
        sign = math.copysign(1.0, nz)
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        ex, ey, ez = 1.0 + sign * nx * nx * a, sign * b, -sign * nx
        fx, fy, fz = b, sign + ny * ny * a, -ny
        first = i * NEIGHBOURS
        # Columns of A, then of B: a difference of two rays over the distance between them.
        a00, a01, a10, a11, b00, b01, b10, b11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(0, NEIGHBOURS, 2):
            x, y, z = _crossing(blocks, first + k, px, py, pz, nx, ny, nz)
            xx, yy, zz = _crossing(blocks, first + k + 1, px, py, pz, nx, ny, nz)
            x, y, z = x - xx, y - yy, z - zz
            scale = 0.5 / (step if k < 4 else turn)
            e, f = scale * (x * ex + y * ey + z * ez), scale * (x * fx + y * fy + z * fz)
            if k == 0:
                a00, a10 = e, f
            elif k == 2:
                a01, a11 = e, f
            elif k == 4:
                b00, b10 = e, f
            else:
                b01, b11 = e, f
        # Twice the mean of B^-1 A is its trace; as a fraction, an image on the array itself is no exception.
        trace = b11 * a00 - b01 * a10 - b10 * a01 + b00 * a11
        determinant = b00 * b11 - b01 * b10
        distances[p] = 2.0 * determinant / trace


@kernel
def fill_virtual_depth(depths, images):
    """Distance of the image behind the array over that of the sensor."""
    for p in range(depths.size):
        depths[p] = images.distance[p] / images.behind[p]


@kernel
def fill_disparity(disparities, images):
    """Pixels by which the image moves between neighbouring microlenses, relative to their centres."""
    for p in range(disparities.size):
        disparities[p] = images.pitch / (images.distance[p] / images.behind[p])
