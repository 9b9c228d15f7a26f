"""Kernels of the light of a point: start of its rays, and their arrival on the sensor."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.paths import BEND_SET, bend_at_pupil
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.polygons import area_of, point_in
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.kernels.sobol import sample, set_index, set_key, stream
from plenoptic.core.numba.jit import kernel
from plenoptic.optics.diffraction.kernels.far_field import sample_deflection


@kernel
def fill_source_rays(blocks, start, n, seed, task, z, ideal, facing):
    """Rays start ... start + n - 1 of a `Task` from its point to the plane z, which its polygon covers.

    WEIGHT is the projected solid angle that a ray would stand for if it were the only one, area cos^4 / height^2;
    before an `ideal` lens it is du dv = area / height^2 instead (see `microlens.kernels.to_sensor`). Both are for
    a unit of area across the z-axis; `facing` is the direction across which it lies instead, or None.
    """
    point, polygon, first = task.point, task.polygon, task.first + start
    area = area_of(polygon, 0, polygon.shape[1])
    key = set_key(stream(seed, task.number, task.replicate), 0)
    height = z - point[2]
    for k in range(n):
        ray = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY]
        i = k % BLOCK
        index = np.uint32(first + k)
        x, y = point_in(polygon, 0, polygon.shape[1], sample(index, 0, key) * area, sample(index, 1, key))
        u, v = (x - point[0]) / height, (y - point[1]) / height
        cos2 = 1.0 / (1.0 + u * u + v * v)
        cos = math.sqrt(cos2)
        ray[X + i], ray[Y + i], ray[Z + i] = x, y, z
        ray[L + i] = u * cos
        ray[M + i] = v * cos
        ray[N + i] = cos
        ray[STATUS + i] = 0.0
        ray[WEIGHT + i] = area * (1.0 if ideal else cos2 * cos2) / (height * height)
        if facing is not None:
            ray[WEIGHT + i] *= max(facing[0] * u + facing[1] * v + facing[2], 0.0)
    pad(blocks, n)


@kernel
def fill_bent(blocks, start, n, seed, task, bends):
    """Rays start ... start + n - 1 of a `Task` land elsewhere: they have bent at their microlenses, as `Bends` says."""
    key = set_key(stream(seed, task.number, task.replicate), BEND_SET)
    by = bends.by
    for k in range(n):
        base = (k // BLOCK) * RAY + k % BLOCK
        index = set_index(np.uint32(task.first + start + k), key, BEND_SET)
        by_x, by_y, _, _ = sample_deflection(bends.field, sample(index, 0, key), sample(index, 1, key))
        h = bends.distance + bends.tilt[0] * blocks[base + X] + bends.tilt[1] * blocks[base + Y]
        blocks[base + X] += h * (by[0, 0] * by_x + by[0, 1] * by_y)
        blocks[base + Y] += h * (by[1, 0] * by_x + by[1, 1] * by_y)


@kernel
def fill_bent_at_iris(blocks, start, n, seed, task, iris):
    """Rays start ... start + n - 1 of a `Task` on their way to the lens bend at the entrance pupil."""
    key = set_key(stream(seed, task.number, task.replicate), BEND_SET)
    wavelength = iris.wavelengths[0]
    for k in range(n):
        index = set_index(np.uint32(task.first + start + k), key, BEND_SET)
        by_x, by_y, _, _ = sample_deflection(iris.field, sample(index, 2, key), sample(index, 3, key))
        ray = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY]
        bend_at_pupil(ray, k % BLOCK, iris.z, (wavelength * by_x, wavelength * by_y))


@kernel
def fill_landed(landed, blocks, n, rows, columns, pitch, opening):
    """Write the light that arrives on the sensor as rows of HIT.

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
            hit = landed[found]
            hit.x, hit.y, hit.weight = x, y, blocks[base + WEIGHT]
            hit.first, hit.second = int(blocks[base + Z]), int(blocks[base + N])
            hit.row, hit.column = math.floor(row), math.floor(column)
            found += 1
        else:
            beside += 1
    return found, beside, shut


@kernel
def extent(landed):
    """First and last row, first and last column of the arriving light."""
    top = bottom = landed[0].row
    left = right = landed[0].column
    for k in range(landed.size):
        row, column = landed[k].row, landed[k].column
        top, bottom = min(top, row), max(bottom, row)
        left, right = min(left, column), max(right, column)
    return top, bottom, left, right


@kernel
def fill_crop(crop, moments, landed, row, column):
    """Add rows of `landed` to the pixels of a crop whose upper left pixel is given, and to sums of w, w x, w y."""
    for k in range(landed.size):
        hit = landed[k]
        w = hit.weight
        crop[hit.row - row, hit.column - column] += w
        moments[0] += w
        moments[1] += w * hit.x
        moments[2] += w * hit.y
