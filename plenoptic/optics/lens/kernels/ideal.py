"""Kernels: rays to a plane, and through an aberration-free thick lens."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device


@device
def to_plane(ray):
    """Propagate rays to the plane z = 0."""
    for i in range(BLOCK):
        t = -ray[Z + i] / ray[N + i]
        ray[X + i] += t * ray[L + i]
        ray[Y + i] += t * ray[M + i]
        ray[Z + i] = 0.0


@device
def refract_ideal(ray, power, index_ratio, relative_powers, separation):
    """Refract rays by an aberration-free thick lens: the slope times `index_ratio`, minus height times power.

    `index_ratio` is the index before over that behind the lens, `power` the inverse of the focal length behind it in
    1/mm, `separation` that of the principal planes in mm. `relative_powers` (BLOCK,) are the power for each
    ray over `power`; None if all are 1.
    """
    to_plane(ray)
    inverse_ratio = 1.0 / index_ratio
    for i in range(BLOCK):
        ray_power = power if relative_powers is None else power * relative_powers[i]
        # Slopes are per unit of travel along the axis, in either direction.
        ahead = abs(ray[N + i]) * inverse_ratio
        u = ray[L + i] / ahead - ray[X + i] * ray_power
        v = ray[M + i] / ahead - ray[Y + i] * ray_power
        cos = 1.0 / math.sqrt(1.0 + u * u + v * v)
        ray[Z + i] = separation
        ray[L + i] = u * cos
        ray[M + i] = v * cos
        ray[N + i] = math.copysign(cos, ray[N + i])
