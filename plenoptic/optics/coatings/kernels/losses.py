"""Kernels: rays lose the light that a surface reflects or absorbs, and that glass absorbs."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.element_record import ASPHERE, CONIC, FREEFORM, SPHERE
from plenoptic.optics.lens.kernels.mirror import normal_at
from plenoptic.optics.lens.kernels.paths import distance_from
from plenoptic.optics.lens.kernels.spherical_refraction import COS2, DISTANCE

DEPTH, START, ROWS = 2, 3, 9
"""Rows of the workspace of a block behind those of `spherical_refraction`: optical depth of all glasses so far, and
position and direction of rays in front of a surface that is no sphere."""


@device
def weaken(ray, lens, k, waves, first, index_ratios, workspace):
    """Multiply weights by the transmittance of the surface in row k, whose vertex is the origin, behind refraction.

    Tables go by the cosine in the medium of the lower index. `refract_sphere` stores its square in the workspace (ROWS,
    BLOCK); for other surfaces it is that of the refracted ray, or by Snell's law that of the incident one. Lost rays,
    whose numbers may be nan, take a cosine of 0. Several short loops are vectorised, one long loop is not.
    """
    row, cos2 = lens.rows[k], workspace[COS2]
    if row.kind == CONIC or row.kind == ASPHERE or row.kind == FREEFORM:
        for i in range(BLOCK):
            nx, ny, nz = normal_at(ray[X + i], ray[Y + i], ray[Z + i], lens, k)
            projection = nx * ray[L + i] + ny * ray[M + i] + nz * ray[N + i]
            cos2[i] = projection * projection / (nx * nx + ny * ny + nz * nz)
        for i in range(BLOCK):
            mu = row.index_ratio if index_ratios is None else index_ratios[i]
            cos2[i] = cos2[i] if mu >= 1.0 else 1.0 - (1.0 - cos2[i]) * (1.0 / (mu * mu))
    elif row.kind != SPHERE:
        return
    if waves is None:
        transmit(ray, cos2, lens.losses.transmittance[k])
    else:
        transmit_dispersed(ray, cos2, lens.losses.dispersed[k], waves, first)


@device
def transmit(ray, cos2, table):
    """Multiply weights by a table (nodes + 1) at squared cosines (BLOCK,), which are overwritten."""
    intervals = table.size - 2
    for i in range(BLOCK):
        cos2[i] = intervals * min(cos2[i] if cos2[i] > 0.0 else 0.0, 1.0)
    for i in range(BLOCK):
        node = np.int32(cos2[i])
        low = table[node]
        ray[WEIGHT + i] *= low + (cos2[i] - node) * (table[node + np.int32(1)] - low)


@device
def transmit_dispersed(ray, cos2, table, waves, first):
    """Multiply weights by a table (wavelengths, nodes + 2) at squared cosines (BLOCK,), which are overwritten.

    By the cubic polynomial through the two nodes on either side, in Newton's form. Unsigned indices count from the
    front, so that reading is vectorised.
    """
    columns, last, numbers = np.int32(table.shape[1]), np.int32(table.shape[1] - 4), table.ravel()
    for i in range(BLOCK):
        cos2[i] = (table.shape[1] - 3) * math.sqrt(min(cos2[i] if cos2[i] > 0.0 else 0.0, 1.0))
    for i in range(BLOCK):
        node = min(np.int32(cos2[i]), last)
        t, k = cos2[i] - node, np.uint32(np.int32(waves[first + i]) * columns + node)
        before, low, high, behind = (
            numbers[k],
            numbers[k + np.uint32(1)],
            numbers[k + np.uint32(2)],
            numbers[k + np.uint32(3)],
        )
        second, third = 0.5 * (before + high) - low, (behind - before) * (1.0 / 6.0) + 0.5 * (low - high)
        ray[WEIGHT + i] *= low + t * (high - low + (t - 1.0) * (second + (t + 1.0) * third))


@device
def fill_distances(ray, workspace):
    """Fill the distances from the points in rows START on to the intersections."""
    for i in range(BLOCK):
        workspace[DISTANCE, i] = distance_from(workspace[START:], ray, i)


@device
def add_depth(workspace, attenuation, waves, first):
    """Add attenuation (wavelengths,) times the distance to the intersections."""
    if waves is None:
        per_mm = attenuation[0]
        for i in range(BLOCK):
            workspace[DEPTH, i] += per_mm * workspace[DISTANCE, i]
    else:
        for i in range(BLOCK):
            workspace[DEPTH, i] += attenuation[waves[first + i]] * workspace[DISTANCE, i]


@device
def absorb(ray, workspace):
    """Multiply weights by the internal transmittance of all glasses, exp(-depth) = exp(-depth / 256)^256.

    The Taylor polynomial is exact to rounding up to a depth of 64, where all light is absorbed; unlike math.exp, it is
    vectorised.
    """
    for i in range(BLOCK):
        x = -min(workspace[DEPTH, i], 64.0) * (1.0 / 256.0)
        p = 1.0 + x * (1.0 / 9.0) * (1.0 + x * (1.0 / 10.0) * (1.0 + x * (1.0 / 11.0)))
        p = 1.0 + x * (1.0 / 5.0) * (1.0 + x * (1.0 / 6.0) * (1.0 + x * (1.0 / 7.0) * (1.0 + x * (1.0 / 8.0) * p)))
        p = 1.0 + x * (1.0 + x * 0.5 * (1.0 + x * (1.0 / 3.0) * (1.0 + x * 0.25 * p)))
        p *= p
        p *= p
        p *= p
        p *= p
        p *= p
        p *= p
        p *= p
        p *= p
        ray[WEIGHT + i] *= p
