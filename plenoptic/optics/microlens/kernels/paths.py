"""Optical path of rays through microlenses: common parts of the kernels."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.kernels.paths import keep_start
from plenoptic.optics.microlens.kernels.cell_lookup import AXIS_X, AXIS_Y, PLACE, POWER


@device
def start_before(path, ray, z):
    """Start rays before a side whose vertex lies at z, from which z is measured then."""
    keep_start(path, ray)
    for i in range(BLOCK):
        path.start[2, i] = ray[Z + i] - z


@device
def add_height(path, ray, place, bow, powers, curved_first):
    """Planes with the normals of spheres of curvature `bow` times their power shift the phase as their heights would.

    A height s adds s (n cos i - n' cos t), angles to the axis. Its gradient is the change of direction by the normals,
    times the indices, since n' cos t - n cos i over the normal's z is how much of the normal is added.
    """
    before, behind = (0, 1) if curved_first else (1, 0)
    n, n_behind = path.indices[before], path.indices[behind]
    for i in range(BLOCK):
        c = bow * (place[POWER + i] if powers is None else powers[0])
        x, y = ray[X + i] - place[AXIS_X + i], ray[Y + i] - place[AXIS_Y + i]
        r2 = x * x + y * y
        height = c * r2 / (1.0 + math.sqrt(max(1.0 - c * c * r2, 0.0)))
        path.length[i] += height * (n * path.start[5, i] - n_behind * ray[N + i])


@device
def give_places(lenses, place, first, last):
    """The microlenses of a block of rays, as rows (n, PLACE)."""
    for i in range(last - first):
        for row in range(PLACE):
            lenses[first + i, row] = place[row * BLOCK + i]
