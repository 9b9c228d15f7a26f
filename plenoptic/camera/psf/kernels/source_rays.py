"""Light of a point: where its rays start, and what arrives on the sensor. The kernels."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.paths import aim, pad
from plenoptic.core.jit import kernel
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.kernels.sobol import sample, set_key, stream

LANDED = 7
"""Numbers of a ray that arrives: x, y on the sensor, weight, lattice index of its microlens, row and column."""


@kernel
def fill_source_rays(blocks, first, n, seed, number, replicate, triangles, point, z, ideal, facing):
    """Rays first ... first + n - 1 of a replicate from a point to the plane z, which `triangles` cover.

    WEIGHT is the projected solid angle that a ray would stand for if it were the only one, area cos^4 / height^2;
    before an `ideal` lens it is du dv = area / height^2 instead (see `microlens.kernels.to_sensor`). Both are for
    a unit of area across the z-axis; `facing` is the direction across which it lies instead, or None.
    """
    key = set_key(stream(seed, number, replicate), 0)
    height = z - point[2]
    for k in range(n):
        ray = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY]
        i = k % BLOCK
        index = np.uint32(first + k)
        aim(ray, i, triangles, 0, triangles.shape[0], point[0], point[1], sample(index, 0, key), sample(index, 1, key))
        u, v = ray[L + i] / height, ray[M + i] / height
        cos2 = 1.0 / (1.0 + u * u + v * v)
        cos = math.sqrt(cos2)
        ray[Z + i] = z
        ray[L + i] = u * cos
        ray[M + i] = v * cos
        ray[N + i] = cos
        ray[WEIGHT + i] *= (1.0 if ideal else cos2 * cos2) / (height * height)
        if facing is not None:
            ray[WEIGHT + i] *= max(facing[0] * u + facing[1] * v + facing[2], 0.0)
    pad(blocks, n)


@kernel
def fill_landed(landed, blocks, n, rows, columns, pitch, opening):
    """What arrives on the sensor, as rows of LANDED numbers.

    Returns how many rays arrive, how many pass beside the sensor, and how many meet a pixel beside its `opening`: half
    its height and half its width over the pitch; None where pixels are open all over.
    """
    found = beside = shut = 0
    for k in range(n):
        base = (k // BLOCK) * RAY + k % BLOCK
        if blocks[base + STATUS] != 0.0:
            continue
        x, y = blocks[base + X], blocks[base + Y]
        column, row = 0.5 * columns - x / pitch, 0.5 * rows + y / pitch
        if 0.0 <= row < rows and 0.0 <= column < columns:
            if opening is not None:
                down, across = row - math.floor(row) - 0.5, column - math.floor(column) - 0.5
                if abs(down) > opening[0] or abs(across) > opening[1]:
                    shut += 1
                    continue
            out = landed[found]
            out[0], out[1], out[2], out[3], out[4] = x, y, blocks[base + WEIGHT], blocks[base + Z], blocks[base + N]
            out[5], out[6] = math.floor(row), math.floor(column)
            found += 1
        else:
            beside += 1
    return found, beside, shut


@kernel
def extent(landed):
    """First and last row, first and last column of what arrives."""
    top = left = math.inf
    bottom = right = -math.inf
    for k in range(landed.shape[0]):
        row, column = landed[k, 5], landed[k, 6]
        top, bottom = min(top, row), max(bottom, row)
        left, right = min(left, column), max(right, column)
    return int(top), int(bottom), int(left), int(right)


@kernel
def fill_crop(crop, moments, landed, row, column):
    """Add rows of `landed` to the pixels of a crop whose upper left pixel is given, and to sums of w, w x, w y."""
    for k in range(landed.shape[0]):
        w = landed[k, 2]
        crop[int(landed[k, 5]) - row, int(landed[k, 6]) - column] += w
        moments[0] += w
        moments[1] += w * landed[k, 0]
        moments[2] += w * landed[k, 1]
