"""Reflection at the curved sides of plano-convex microlenses: kernels for light that travels forwards."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.lens.kernels.spherical_refraction import UNLIMITED, refract_sphere
from plenoptic.optics.microlens.kernels.cell_lookup import (
    AXIS_X,
    AXIS_Y,
    LENS_ROWS,
    POWER,
    find_cells,
    find_lenses,
    intersect_sphere,
)
from plenoptic.optics.microlens.kernels.to_sensor import reach_sensor, to_plane


@device
def _reflect(ray, lens_rows, bow, power):
    """Reflect rays from the plane z = 0 of the vertices, into the mirror image of space in that plane.

    Spheres have the curvature `bow` times their power, that of each lens or one for all.
    """
    for i in range(BLOCK):
        c = bow * (lens_rows[POWER + i] if power is None else power)
        x, y = ray[X + i] - lens_rows[AXIS_X + i], ray[Y + i] - lens_rows[AXIS_Y + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        x, y, z, _, q2 = intersect_sphere(x, y, l, m, n, c)
        q = math.sqrt(max(q2, 0.0))
        nx, ny, nz = -c * x, -c * y, 1.0 - c * z
        ray[X + i] = x + lens_rows[AXIS_X + i]
        ray[Y + i] = y + lens_rows[AXIS_Y + i]
        ray[Z + i] = -z
        ray[L + i] = l - 2.0 * q * nx
        ray[M + i] = m - 2.0 * q * ny
        ray[N + i] = 2.0 * q * nz - n
        lost = 0.0 if q2 > 0.0 and nz > 0.0 and ray[N + i] > 0.0 else MISSED
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@kernel
def fill_curved_reflection(blocks, z_front, plane, plate, array, differs):
    """Reflect rays behind the lens at the curved sides, from outside, or from inside the glass behind the flat side.

    `z_front` is the vertex of the first side. Rays end on the `SensorPlane` behind it in the mirror image of space.
    """
    lens_rows = np.empty(LENS_ROWS * BLOCK)
    curved_first, thickness = plate.towards_scene, plate.thickness
    index = plate.refractive_index if plate.indices is None else plate.indices[0]
    bow = (1.0 if curved_first else -1.0) / (plate.refractive_index - 1.0)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        to_plane(ray, z_front)
        if not curved_first:
            refract_sphere(ray, 0.0, 1.0 / index, None, UNLIMITED, 1.0, 0.0, None)
            to_plane(ray, thickness)
        if differs is None:
            find_cells(ray, lens_rows, bow * array.lattice.powers[0], array.lattice)
            _reflect(ray, lens_rows, bow, array.lattice.powers[0])
        else:
            find_lenses(ray, lens_rows, bow, curved_first, array)
            _reflect(ray, lens_rows, bow, None)
        if not curved_first:
            for i in range(BLOCK):
                ray[Z + i] -= thickness
            refract_sphere(ray, 0.0, index, None, UNLIMITED, 1.0, 0.0, None)
        reach_sensor(ray, lens_rows, plane, None)
