"""Rays of point sources: their start, deflection, arrival on the sensor and sums of light. The kernels."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.diffraction_deflection import deflect_at_pupil
from plenoptic.camera.sampling.kernels.path_numbers import DEFLECTION_SET
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.polygons import area_of, point_in
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.kernels.sobol import sample, set_index, set_key, stream
from plenoptic.core.numba.jit import kernel
from plenoptic.optics.diffraction.kernels.far_field import sample_deflection


@kernel
def fill_source_rays(blocks, start, n, seed, task, z, ideal, facing):
    """Sample rays start ... start + n - 1 of a `RayTask` from its point to its polygon on the plane z.

    WEIGHT is the projected solid angle of a single ray, area cos^4 / height^2; before an `ideal` lens it is
    du dv = area / height^2 (see `microlens.kernels.to_sensor`). Both are for a source whose normal is the z-axis;
    `facing` is another normal, or None.
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
def fill_deflections(blocks, start, n, seed, task, deflection):
    """Displace rays start ... start + n - 1 of a `RayTask` on the sensor by diffraction at their microlenses."""
    key = set_key(stream(seed, task.number, task.replicate), DEFLECTION_SET)
    to_sensor_axes = deflection.to_sensor_axes
    for k in range(n):
        base = (k // BLOCK) * RAY + k % BLOCK
        index = set_index(np.uint32(task.first + start + k), key, DEFLECTION_SET)
        by_x, by_y, _, _ = sample_deflection(deflection.field, sample(index, 0, key), sample(index, 1, key))
        h = deflection.distance + deflection.tilt[0] * blocks[base + X] + deflection.tilt[1] * blocks[base + Y]
        blocks[base + X] += h * (to_sensor_axes[0, 0] * by_x + to_sensor_axes[0, 1] * by_y)
        blocks[base + Y] += h * (to_sensor_axes[1, 0] * by_x + to_sensor_axes[1, 1] * by_y)


@kernel
def fill_iris_deflections(blocks, start, n, seed, task, iris):
    """Deflect rays start ... start + n - 1 of a `RayTask` at the entrance pupil."""
    key = set_key(stream(seed, task.number, task.replicate), DEFLECTION_SET)
    wavelength = iris.wavelengths[0]
    for k in range(n):
        index = set_index(np.uint32(task.first + start + k), key, DEFLECTION_SET)
        by_x, by_y, _, _ = sample_deflection(iris.field, sample(index, 2, key), sample(index, 3, key))
        ray = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY]
        deflect_at_pupil(ray, k % BLOCK, iris.z, (wavelength * by_x, wavelength * by_y))


@kernel
def fill_sensor_hits(hits, blocks, n, rows, columns, pitch, opening):
    """Fill rows of HIT for rays that reach the sensor.

    Returns the number of these rays, of rays beside the sensor, and of rays on a pixel but outside its `opening`: half
    its height and half its width over the pitch; None for a fill factor of 1.
    """
    landed_rays = beside_sensor = beside_opening = 0
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
                    beside_opening += 1
                    continue
            hit = hits[landed_rays]
            hit.x, hit.y, hit.weight = x, y, blocks[base + WEIGHT]
            hit.first, hit.second = int(blocks[base + Z]), int(blocks[base + N])
            hit.row, hit.column = math.floor(row), math.floor(column)
            landed_rays += 1
        else:
            beside_sensor += 1
    return landed_rays, beside_sensor, beside_opening


@kernel
def fill_crop(crop, moments, hits, row, column):
    """Add hits to the pixels of a crop with its upper left pixel at (row, column), and to the sums of w, w x, w y."""
    for k in range(hits.size):
        hit = hits[k]
        w = hit.weight
        crop[hit.row - row, hit.column - column] += w
        moments[0] += w
        moments[1] += w * hit.x
        moments[2] += w * hit.y
