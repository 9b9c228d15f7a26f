"""Which ray stands for a pixel: from its centre through the lit centroid of its brightest microlens."""

from __future__ import annotations

import numpy as np

from plenoptic._jit import device, kernel
from plenoptic.camera._sample import aim, pad
from plenoptic.optics._blocks import BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z

PROBES = 16
"""Rays that look for the lit part of the microlenses over a pixel."""

_U = (np.arange(PROBES) + 0.5) / PROBES
_V = np.array([int(f"{i:04b}"[::-1], 2) for i in range(PROBES)]) / PROBES + 0.5 / PROBES


@kernel
def fill_probes(blocks, aims, pixels, triangles, first):
    """Aim PROBES rays from the centre of each pixel at its region; their points and cells are kept in `aims`."""
    n = 0
    for p in range(pixels.shape[0]):
        for k in range(PROBES):
            base = (n // BLOCK) * RAY
            ray = blocks[base : base + RAY]
            i = n % BLOCK
            if first[p + 1] > first[p]:
                aim(ray, i, triangles, first[p], first[p + 1], pixels[p, 0], pixels[p, 1], _U[k], _V[k])
            else:
                for row in range(8):
                    ray[row * BLOCK + i] = 0.0
                ray[STATUS + i] = MISSED
            aims[n, 0], aims[n, 1], aims[n, 2], aims[n, 3] = ray[X + i], ray[Y + i], ray[Z + i], ray[N + i]
            n += 1
    pad(blocks, n)


@kernel
def fill_main_aims(blocks, probes, aims, pixels, triangles, first):
    """From the traced probes, aim one ray a pixel at the lit centroid of the cell that passes most light.

    Probes run through the region in the order of its triangles, so that those of a cell are neighbours. Where all
    probes of a cell arrive, its centroid is that of its whole region. Pixels without light get a lost ray.
    """
    for p in range(pixels.shape[0]):
        best, best_x, best_y, best_cx, best_cy = 0.0, 0.0, 0.0, 0.0, 0.0
        k = 0
        while k < PROBES:
            n = p * PROBES + k
            cx, cy = aims[n, 2], aims[n, 3]
            light, sum_x, sum_y, lit, seen = 0.0, 0.0, 0.0, 0, 0
            while k < PROBES and aims[p * PROBES + k, 2] == cx and aims[p * PROBES + k, 3] == cy:
                n = p * PROBES + k
                base = (n // BLOCK) * RAY + n % BLOCK
                if probes[base + STATUS] == 0.0:
                    light += probes[base + WEIGHT]
                    sum_x += aims[n, 0]
                    sum_y += aims[n, 1]
                    lit += 1
                seen += 1
                k += 1
            if light > best:
                best, best_cx, best_cy = light, cx, cy
                best_x, best_y = sum_x / lit, sum_y / lit
                if lit == seen:
                    best_x, best_y = _centroid(triangles, first[p], first[p + 1], cx, cy)
        base = (p // BLOCK) * RAY
        ray = blocks[base : base + RAY]
        i = p % BLOCK
        ray[X + i], ray[Y + i] = best_x, best_y
        ray[L + i], ray[M + i] = best_x - pixels[p, 0], best_y - pixels[p, 1]
        ray[Z + i], ray[N + i] = best_cx, best_cy
        ray[WEIGHT + i] = 1.0
        ray[STATUS + i] = 0.0 if best > 0.0 else MISSED
    pad(blocks, pixels.shape[0])


@device
def _centroid(triangles, low, high, cx, cy):
    """Centroid of the triangles of one cell."""
    area, sum_x, sum_y = 0.0, 0.0, 0.0
    for k in range(low, high):
        if triangles[k, 7] == cx and triangles[k, 8] == cy:
            a = triangles[k, 6] - (triangles[k - 1, 6] if k > low else 0.0)
            area += a
            sum_x += a * (triangles[k, 0] + (triangles[k, 2] + triangles[k, 4]) / 3.0)
            sum_y += a * (triangles[k, 1] + (triangles[k, 3] + triangles[k, 5]) / 3.0)
    return sum_x / area, sum_y / area


@kernel
def fill_depths(depths, blocks, lane_of, distances):
    """-z in the camera's frame at a distance along traced rays; lanes without a hit keep what they have."""
    for i in range(lane_of.size):
        base = (lane_of[i] // BLOCK) * RAY + lane_of[i] % BLOCK
        depths[lane_of[i]] = -(blocks[base + Z] + distances[i] * blocks[base + N])
