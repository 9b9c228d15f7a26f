"""Rays through a plane, and through a thick lens without aberrations: the kernels."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device


@device
def to_plane(ray):
    """Move rays along themselves to the plane z = 0."""
    for i in range(BLOCK):
        t = -ray[Z + i] / ray[N + i]
        ray[X + i] += t * ray[L + i]
        ray[Y + i] += t * ray[M + i]
        ray[Z + i] = 0.0


@device
def refract_ideal(ray, power, relative_powers, separation):
    """A thick lens without aberrations: slopes change by height times power between the two principal planes.

    `relative_powers` is how much stronger the lens is for each ray than `power`; None: no ray differs.
    """
    to_plane(ray)
    for i in range(BLOCK):
        bend = power if relative_powers is None else power * relative_powers[i]
        # The slope is per length of travel, and so is the bend towards the axis.
        ahead = abs(ray[N + i])
        u = ray[L + i] / ahead - ray[X + i] * bend
        v = ray[M + i] / ahead - ray[Y + i] * bend
        cos = 1.0 / math.sqrt(1.0 + u * u + v * v)
        ray[Z + i] = separation
        ray[L + i] = u * cos
        ray[M + i] = v * cos
        ray[N + i] = math.copysign(cos, ray[N + i])
