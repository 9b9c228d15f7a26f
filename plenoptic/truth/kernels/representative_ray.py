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
def fill_probes(blocks, lanes, aims, pixels, triangles, first, details):
    """Aim PROBES rays from the centre of each pixel at its region; where they are aimed is kept in `aims`.

    Light that passes beside the openings of microlenses does not count.
    """
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
                if details is not None:
                    lanes[n] = details[chosen]
                    counts = 0.0 if details[chosen].clip < 0.0 else 1.0
            else:
                for row in range(8):
                    ray[row * BLOCK + i] = 0.0
                ray[STATUS + i] = MISSED
            aims[n, 0], aims[n, 1], aims[n, 2], aims[n, 3] = ray[X + i], ray[Y + i], ray[Z + i], ray[N + i]
            aims[n, 4], aims[n, 5] = chosen, counts
            n += 1
    pad(blocks, n)


@kernel
def fill_main_aims(blocks, lanes, cells, probes, aims, pixels, triangles, first, details):
    """From the traced probes, aim one ray a pixel at the lit centroid of the cell that passes most light.

    Probes run through the region in the order of its triangles, so that those of a cell are neighbours. Where all
    probes of a cell arrive, its centroid is that of its whole region. Pixels without light get a lost ray.
    `cells` (n, 3) gets the centre of that cell and the row of its microlens in the list of lenses.
    """
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
                    best_x, best_y = _centroid(triangles, details, first[p], first[p + 1], found)
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
            if details is not None:
                lanes[p] = details[found]
                cells[p, 0], cells[p, 1] = details[found].cell_x, details[found].cell_y
                cells[p, 2] = details[found].row
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


@kernel
def fill_points(depths, distances, positions, points, blocks, lane_of, reached, frame, rotation, position):
    """Where traced rays are at a distance, `reached`, along them; lanes without a hit keep what they have.

    `points` (n, 3) get the place in the lens's axes. Of the others, None where they are not wanted: -z in the camera's
    frame, the distance from its origin, and the place in the world. `frame` (12,) leads from the lens's axes to the
    camera's, `rotation` and `position` to the world's; None where they are the same.
    """
    for i in range(lane_of.size):
        if not reached[i] < math.inf:
            continue
        p = lane_of[i]
        base = (p // BLOCK) * RAY + p % BLOCK
        x = blocks[base + X] + reached[i] * blocks[base + L]
        y = blocks[base + Y] + reached[i] * blocks[base + M]
        z = blocks[base + Z] + reached[i] * blocks[base + N]
        points[p, 0], points[p, 1], points[p, 2] = x, y, z
        if positions is not None:
            if rotation is None:
                positions[p, 0], positions[p, 1], positions[p, 2] = x, y, z
            else:
                for axis in range(3):
                    positions[p, axis] = (
                        rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z + position[axis]
                    )
        if frame is not None:
            x, y, z = (
                frame[0] * x + frame[1] * y + frame[2] * z + frame[9],
                frame[3] * x + frame[4] * y + frame[5] * z + frame[10],
                frame[6] * x + frame[7] * y + frame[8] * z + frame[11],
            )
        if depths is not None:
            depths[p] = -z
        if distances is not None:
            distances[p] = math.sqrt(x * x + y * y + z * z)
