"""Kernels: rays lose the light that a surface reflects or absorbs, and that glass absorbs."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.element_record import ASPHERE, CONIC, FREEFORM, SPHERE
from plenoptic.optics.lens.kernels.mirror import normal_at


@device
def weaken(ray, lens, k, waves, first, index_ratios, places):
    """Multiply weights by the transmittance of the surface in row k, whose vertex is the origin, behind refraction.

    Tables go by the squared cosine in the medium of the lower index: that of the refracted ray, or by Snell's law that
    of the incident one. Lost rays, whose numbers may be nan, take a cosine of 0. `places` (BLOCK,) is a workspace:
    several short loops are vectorised, one long loop is not.
    """
    row = lens.rows[k]
    if row.kind == SPHERE:
        c = row.curvature
        for i in range(BLOCK):
            l, m, n = ray[L + i], ray[M + i], ray[N + i]
            projection = n - c * (ray[X + i] * l + ray[Y + i] * m + ray[Z + i] * n)
            places[i] = projection * projection
    elif row.kind == CONIC or row.kind == ASPHERE or row.kind == FREEFORM:
        for i in range(BLOCK):
            nx, ny, nz = normal_at(ray[X + i], ray[Y + i], ray[Z + i], lens, k)
            projection = nx * ray[L + i] + ny * ray[M + i] + nz * ray[N + i]
            places[i] = projection * projection / (nx * nx + ny * ny + nz * nz)
    else:
        return
    table = lens.losses.transmittance[k]
    intervals = table.shape[1] - 1
    for i in range(BLOCK):
        mu = row.index_ratio if index_ratios is None else index_ratios[i]
        cos2 = places[i] if mu >= 1.0 else 1.0 - (1.0 - places[i]) * (1.0 / (mu * mu))
        places[i] = min(cos2 if cos2 > 0.0 else 0.0, 1.0) * intervals
    if waves is None:
        column = table[0]
        for i in range(BLOCK):
            node = min(np.int32(places[i]), np.int32(intervals - 1))
            low = column[node]
            ray[WEIGHT + i] *= low + (places[i] - node) * (column[node + np.int32(1)] - low)
    else:
        for i in range(BLOCK):
            node, wave = min(np.int32(places[i]), np.int32(intervals - 1)), waves[first + i]
            low = table[wave, node]
            ray[WEIGHT + i] *= low + (places[i] - node) * (table[wave, node + np.int32(1)] - low)


@device
def begin_depth(gap):
    """Initialise the optical depths of a block of rays; `gap` is (7, BLOCK)."""
    for i in range(BLOCK):
        gap[6, i] = 0.0


@device
def store_ray(gap, ray):
    """Store positions and directions of rays before their propagation to an element, in its axes."""
    for row in range(6):
        for i in range(BLOCK):
            gap[row, i] = ray[row * BLOCK + i]


@device
def add_depth(gap, ray, attenuation, waves, first):
    """Add attenuation (wavelengths,) times the distance from the stored points to the intersections."""
    for i in range(BLOCK):
        x, y, z = ray[X + i] - gap[0, i], ray[Y + i] - gap[1, i], ray[Z + i] - gap[2, i]
        wave = 0 if waves is None else waves[first + i]
        gap[6, i] += attenuation[wave] * (x * gap[3, i] + y * gap[4, i] + z * gap[5, i])


@device
def absorb(ray, gap):
    """Multiply weights by the internal transmittance of all glasses."""
    for i in range(BLOCK):
        ray[WEIGHT + i] *= math.exp(-gap[6, i])
