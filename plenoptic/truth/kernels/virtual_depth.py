"""Image distance of hit points by the main lens, and virtual depth.

A ray from (m, n) on the array with slopes (u, v) passes the lens and hits a point P. Rays close to it cross the plane
through P perpendicular to the ray at X = A (dm, dn) + B (du, dv). Those through P have A (dm, dn) = -B (du, dv): their
slopes decrease across the array by B^-1 A, which is 1 / a in all directions if they intersect at the distance a behind
it.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel

NEIGHBOURS = 8
"""Rays around each ray: displaced along +-x and +-y, then tilted along +-x and +-y."""


@kernel
def fill_neighbours(blocks, before, pixels, axes, step, turn):
    """Fill NEIGHBOURS rays around each of the rays `before`, which start at the array, in the lens's axes.

    `axes` (4, 3) are the array's x, y and normal and the centre of its front principal plane. Displaced rays start
    `step` mm away; tilted rays start on that plane with slopes that differ by `turn`.
    """
    for i in range(pixels.size):
        base = (pixels[i] // BLOCK) * RAY + pixels[i] % BLOCK
        x, y, z = before[base + X], before[base + Y], before[base + Z]
        l, m, n = before[base + L], before[base + M], before[base + N]
        along = axes[2, 0] * l + axes[2, 1] * m + axes[2, 2] * n
        t = axes[2, 0] * (axes[3, 0] - x) + axes[2, 1] * (axes[3, 1] - y) + axes[2, 2] * (axes[3, 2] - z)
        t /= along
        for k in range(NEIGHBOURS):
            row = i * NEIGHBOURS + k
            ray = blocks[(row // BLOCK) * RAY : (row // BLOCK + 1) * RAY]
            j = row % BLOCK
            axis = axes[(k >> 1) & 1]
            sign = 1.0 if k & 1 == 0 else -1.0
            offset = sign * step if k < 4 else 0.0
            slope_change = sign * turn * along if k >= 4 else 0.0
            dx, dy, dz = l + slope_change * axis[0], m + slope_change * axis[1], n + slope_change * axis[2]
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            ray[X + j] = x + t * l + offset * axis[0]
            ray[Y + j] = y + t * m + offset * axis[1]
            ray[Z + j] = z + t * n + offset * axis[2]
            ray[L + j] = dx / length
            ray[M + j] = dy / length
            ray[N + j] = dz / length
            ray[WEIGHT + j] = 1.0
            ray[STATUS + j] = 0.0
    pad(blocks, pixels.size * NEIGHBOURS)


@device
def _intersect_plane(blocks, row, px, py, pz, nx, ny, nz):
    """Intersection of ray `row` with the plane through p with the normal n, relative to p; nan for a lost ray."""
    base = (row // BLOCK) * RAY + row % BLOCK
    x, y, z = blocks[base + X] - px, blocks[base + Y] - py, blocks[base + Z] - pz
    l, m, n = blocks[base + L], blocks[base + M], blocks[base + N]
    t = -(x * nx + y * ny + z * nz) / (l * nx + m * ny + n * nz)
    void = 0.0 if blocks[base + STATUS] == 0.0 else math.nan
    return x + t * l + void, y + t * m + void, z + t * n + void


@kernel
def fill_image_distances(distances, blocks, main, points, pixels, step, turn):
    """Fill the distances in mm from the array to the images of `points` (m, 3): inverse of the mean of B^-1 A.

    The points are those of `pixels` (m,), `blocks` the traced NEIGHBOURS of their traced rays, which are among `main`;
    distances of other pixels are unchanged.
    """
    for i in range(pixels.size):
        p = pixels[i]
        base = (p // BLOCK) * RAY + p % BLOCK
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        nx, ny, nz = main[base + L], main[base + M], main[base + N]
        # Two axes perpendicular to the ray (T. Duff et al., J. Comput. Graph. Tech. 6(1), 2017).
        sign = math.copysign(1.0, nz)
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        ex, ey, ez = 1.0 + sign * nx * nx * a, sign * b, -sign * nx
        fx, fy, fz = b, sign + ny * ny * a, -ny
        first = i * NEIGHBOURS
        # Columns of A, then of B: a difference of two rays over the distance between them.
        a00, a01, a10, a11, b00, b01, b10, b11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(0, NEIGHBOURS, 2):
            x, y, z = _intersect_plane(blocks, first + k, px, py, pz, nx, ny, nz)
            xx, yy, zz = _intersect_plane(blocks, first + k + 1, px, py, pz, nx, ny, nz)
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
        # Twice the mean of B^-1 A is its trace; as a fraction, an image on the array is no special case.
        trace = b11 * a00 - b01 * a10 - b10 * a01 + b00 * a11
        determinant = b00 * b11 - b01 * b10
        distances[p] = 2.0 * determinant / trace
