"""Which ray stands for a pixel: from its centre through the lit centroid of its brightest microlens."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.paths import aim
from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z

PROBES = 16
"""Rays that look for the lit part of the microlenses over a pixel."""

_U = (np.arange(PROBES) + 0.5) / PROBES
_V = np.array([int(f"{i:04b}"[::-1], 2) for i in range(PROBES)]) / PROBES + 0.5 / PROBES


AIM = 6
"""Numbers of a probe: the point aimed at, the optical axis of its microlens, its triangle, and whether it counts."""


@kernel
def fill_probes(blocks, lanes, aims, pixels, regions):
    """Aim PROBES rays from the centre of each pixel at its region; where they are aimed is kept in `aims`.

    Light that passes beside the openings of microlenses does not count.
    """
    triangles, first = regions.triangles, regions.first
    n = 0
    for p in range(pixels.shape[0]):
        for k in range(PROBES):
            base = (n // BLOCK) * RAY
            ray = blocks[base : base + RAY]
            i = n % BLOCK
            chosen, counts = -1, 1.0
            if first[p + 1] > first[p]:
                start = pixels[p, 0], pixels[p, 1]
                chosen = aim(ray, i, triangles, (first[p], first[p + 1]), start, (_U[k], _V[k]))
                if regions.details is not None:
                    lanes[n] = regions.details[chosen]
                    counts = 0.0 if regions.details[chosen].clip < 0.0 else 1.0
            else:
                for row in range(8):
                    ray[row * BLOCK + i] = 0.0
                ray[STATUS + i] = MISSED
            aims[n, 0], aims[n, 1], aims[n, 2], aims[n, 3] = ray[X + i], ray[Y + i], ray[Z + i], ray[N + i]
            aims[n, 4], aims[n, 5] = chosen, counts
            n += 1
    pad(blocks, n)


@kernel
def fill_representative_rays(blocks, lanes, cells, probes, aims, pixels, regions):
    """From the traced probes, aim one ray a pixel at the lit centroid of the cell that passes most light.

    Probes run through the region in the order of its triangles, so that those of a cell are neighbours. Where all
    probes of a cell arrive, its centroid is that of its whole region. Pixels without light get a lost ray.
    `cells` (n, 3) gets the centre of that cell and the row of its microlens in the list of lenses.
    """
    triangles, first = regions.triangles, regions.first
    for p in range(pixels.shape[0]):
        best, best_x, best_y, found = 0.0, 0.0, 0.0, 0
        k = 0
        while k < PROBES:
            start = p * PROBES + k
            light, sum_x, sum_y, lit, seen = 0.0, 0.0, 0.0, 0, 0
            while k < PROBES and _same_cell(aims, p * PROBES + k, start):
                n = p * PROBES + k
                base = (n // BLOCK) * RAY + n % BLOCK
                if probes[base + STATUS] == 0.0 and aims[n, 5] > 0.0:
                    light += probes[base + WEIGHT]
                    sum_x += aims[n, 0]
                    sum_y += aims[n, 1]
                    lit += 1
                seen += 1
                k += 1
            if light > best:
                best, found = light, int(aims[start, 4])
                best_x, best_y = sum_x / lit, sum_y / lit
                if lit == seen:
                    best_x, best_y = _centroid(triangles, regions.details, first[p], first[p + 1], found)
        base = (p // BLOCK) * RAY
        ray = blocks[base : base + RAY]
        i = p % BLOCK
        ray[X + i], ray[Y + i] = best_x, best_y
        ray[L + i], ray[M + i] = best_x - pixels[p, 0], best_y - pixels[p, 1]
        ray[Z + i] = ray[N + i] = 0.0
        cells[p, 0], cells[p, 1], cells[p, 2] = math.nan, math.nan, math.nan
        if best > 0.0:
            ray[Z + i], ray[N + i] = triangles[found].axis_x, triangles[found].axis_y
            cells[p, 0], cells[p, 1], cells[p, 2] = ray[Z + i], ray[N + i], -1.0
            if regions.details is not None:
                lanes[p] = regions.details[found]
                cells[p, 0], cells[p, 1] = regions.details[found].cell_x, regions.details[found].cell_y
                cells[p, 2] = regions.details[found].row
        ray[WEIGHT + i] = 1.0
        ray[STATUS + i] = 0.0 if best > 0.0 else MISSED
    pad(blocks, pixels.shape[0])


@device
def _same_cell(aims, n, start):
    return aims[n, 2] == aims[start, 2] and aims[n, 3] == aims[start, 3] and aims[n, 5] == aims[start, 5]


@device
def _centroid(triangles, details, low, high, found):
    """Centroid of the triangles of the cell to which triangle `found` belongs."""
    area, sum_x, sum_y = 0.0, 0.0, 0.0
    for k in range(low, high):
        same = triangles[k].axis_x == triangles[found].axis_x and triangles[k].axis_y == triangles[found].axis_y
        if details is not None:
            same = same and details[k].clip == details[found].clip
        if same:
            triangle = triangles[k]
            a = triangle.area - (triangles[k - 1].area if k > low else 0.0)
            area += a
            sum_x += a * (triangle.x + (triangle.ax + triangle.bx) / 3.0)
            sum_y += a * (triangle.y + (triangle.ay + triangle.by) / 3.0)
    return sum_x / area, sum_y / area
