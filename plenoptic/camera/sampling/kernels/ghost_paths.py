"""Paths of ghosts: kernels that aim rays at the discs of their pairs, and collect the rays of a pair in blocks."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y
from plenoptic.core.numba.jit import kernel


@kernel
def fill_aims(bundle, draws, aims, wide):
    """Aim rays at the discs of the pairs that they draw, or give up rays that miss them; see `GhostAims`.

    A fraction `wide` of rays, those of even draws, may pass all of the opening. Weights of redirected rays are over
    the density of both ways to aim, by the balance heuristic: E. Veach, L. J. Guibas, SIGGRAPH 1995, 419.
    """
    distance, radius = aims.distance, aims.radius
    for k in range(draws.size):
        i = k // BLOCK * RAY + k % BLOCK
        if bundle[STATUS + i] != 0.0:
            continue
        pair, narrow = draws[k] // 2, draws[k] % 2 == 1
        slope, scale = aims.slope[pair], aims.scale[pair]
        x, y, n = bundle[X + i], bundle[Y + i], bundle[N + i]
        end_x, end_y = x + distance / n * bundle[L + i], y + distance / n * bundle[M + i]
        if aims.redirects:
            if narrow:
                x, y = slope * end_x + scale * x, slope * end_y + scale * y
            in_disc = math.hypot(x - slope * end_x, y - slope * end_y) <= scale * radius
            across_x, across_y = x - end_x, y - end_y
            length = math.sqrt(across_x * across_x + across_y * across_y + distance * distance)
            cosines = distance / (length * n)
            density = wide + ((1.0 - wide) / (scale * scale) if in_disc else 0.0)
            bundle[WEIGHT + i] *= cosines * cosines * cosines * cosines / density
            bundle[X + i], bundle[Y + i] = x, y
            bundle[L + i], bundle[M + i], bundle[N + i] = across_x / length, across_y / length, -distance / length
            if not math.hypot(x, y) <= radius:
                bundle[STATUS + i] = MISSED
        elif not math.hypot(x - slope * end_x, y - slope * end_y) <= scale * radius:
            bundle[WEIGHT + i] *= 1.0 / wide
            if narrow:
                bundle[STATUS + i] = MISSED


@kernel
def fill_part(part, bundle, rays):
    """Copy rays of a bundle to the blocks of another one, whose other rays repeat the first."""
    for k in range(part.size // RAY * BLOCK):
        ray = rays[k if k < rays.size else 0]
        source, target = ray // BLOCK * RAY + ray % BLOCK, k // BLOCK * RAY + k % BLOCK
        for row in range(RAY // BLOCK):
            part[target + row * BLOCK] = bundle[source + row * BLOCK]


@kernel
def fill_back(bundle, part, rays):
    """Copy rays of `fill_part` to their places."""
    for k in range(rays.size):
        source, target = k // BLOCK * RAY + k % BLOCK, rays[k] // BLOCK * RAY + rays[k] % BLOCK
        for row in range(RAY // BLOCK):
            bundle[target + row * BLOCK] = part[source + row * BLOCK]
