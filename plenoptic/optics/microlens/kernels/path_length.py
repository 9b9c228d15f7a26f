"""Optical path lengths of rays through microlenses: device functions."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.kernels.paths import store_start
from plenoptic.optics.microlens.kernels.cell_lookup import AXIS_X, AXIS_Y, LENS_ROWS, POWER


@device
def start_path(path, ray, z):
    """Store the state of rays before a side with its vertex at z, which becomes the origin of z."""
    store_start(path.start, ray)
    for i in range(BLOCK):
        path.start[2, i] = ray[Z + i] - z


@device
def add_height(path, ray, lens_rows, bow, powers, curved_first):
    """Add the path that the height of a sphere adds to a plane with its normals, of curvature `bow` times the power.

    A height s adds s (n cos i - n' cos t), angles to the axis. Its gradient is the change of direction by the normals,
    times the indices, since (n' cos t - n cos i) / normal_z is the factor of the normal in Snell's law.
    """
    before, behind = (0, 1) if curved_first else (1, 0)
    n, n_behind = path.indices[before], path.indices[behind]
    for i in range(BLOCK):
        c = bow * (lens_rows[POWER + i] if powers is None else powers[0])
        x, y = ray[X + i] - lens_rows[AXIS_X + i], ray[Y + i] - lens_rows[AXIS_Y + i]
        r2 = x * x + y * y
        height = c * r2 / (1.0 + math.sqrt(max(1.0 - c * c * r2, 0.0)))
        path.length[i] += height * (n * path.start[5, i] - n_behind * ray[N + i])


@device
def store_lenses(lenses, lens_rows, first, last):
    """Store the microlenses of a block of rays as rows (n, PLACE)."""
    for i in range(last - first):
        for row in range(LENS_ROWS):
            lenses[first + i, row] = lens_rows[row * BLOCK + i]
