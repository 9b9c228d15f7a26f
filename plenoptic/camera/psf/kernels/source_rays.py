"""Rays of point sources: their start, deflection, arrival on the sensor and sums of light. The kernels."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.diffraction_deflection import deflect_at_pupil
from plenoptic.camera.sampling.kernels.path_numbers import DEFLECTION_SET
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.polygons import area_of, point_in
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.kernels.sobol import mix, reversed_point, sample, scramble_bits, set_index, set_key, stream, to_unit
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.diffraction.kernels.far_field import sample_deflection


@device
def _fill_rays(ray, lanes, key, point, polygon, z, ideal, facing):
    """Sample n rays from the ray `first` of a replicate on; see `fill_source_rays`. `lanes` are n and `first`.

    `ray` begins at the first one in its block. Separate loops, from 0 on, are vectorised.
    """
    n, first = lanes
    seed_u, seed_v = np.uint32(mix(key, np.uint64(0))), np.uint32(mix(key, np.uint64(1)))
    x, y = ray[X : X + n], ray[Y : Y + n]
    for j in range(n):
        x[j] = to_unit(scramble_bits(reversed_point(first + j, 0), seed_u))
        y[j] = to_unit(scramble_bits(reversed_point(first + j, 1), seed_v))
    corners = polygon.shape[1]
    area = area_of(polygon, 0, corners)
    for j in range(n):
        x[j], y[j] = point_in(polygon, 0, corners, x[j] * area, y[j])
    height = z - point[2]
    for j in range(n):
        u, v = (x[j] - point[0]) / height, (y[j] - point[1]) / height
        cos2 = 1.0 / (1.0 + u * u + v * v)
        cos = math.sqrt(cos2)
        ray[Z + j], ray[L + j], ray[M + j], ray[N + j] = z, u * cos, v * cos, cos
        ray[STATUS + j] = 0.0
        ray[WEIGHT + j] = area * (1.0 if ideal else cos2 * cos2) / (height * height)
        if facing is not None:
            ray[WEIGHT + j] *= max(facing[0] * u + facing[1] * v + facing[2], 0.0)


@kernel
def fill_source_rays(blocks, start, n, seed, task, z, ideal, facing):
    """Sample rays start ... start + n - 1 of a `RayTask` from its point to its polygon on the plane z.

    WEIGHT is the projected solid angle of a single ray, area cos^4 / height^2; before an `ideal` lens it is
    du dv = area / height^2 (see `microlens.kernels.to_sensor`). Both are for a source whose normal is the z-axis;
    `facing` is another normal, or None.
    """
    key = set_key(stream(seed, task.number, task.replicate), 0)
    for k in range(0, n, BLOCK):
        ray, end, first = blocks[k // BLOCK * RAY : (k // BLOCK + 1) * RAY], min(n - k, BLOCK), task.first + start + k
        _fill_rays(ray, (end, first), key, task.point, task.polygon, z, ideal, facing)
    pad(blocks, n)


@kernel
def fill_rays_of_points(blocks, first, n, points, each, z, ideal, facing):
    """Sample rays first ... first + n - 1 of `PointRays`: for each point, `each` rays of each replicate.

    The bits of the coordinates of a point are the seed of its random numbers.
    """
    k = 0
    while k < n:
        number, index, i = (first + k) // each, (first + k) % each, k % BLOCK
        row, replicate = number // points.replicates, number % points.replicates
        # Each coordinate is added to a state that is mixed: opposite points have other seeds.
        seed = mix(mix(mix(np.uint64(0), points.bits[row, 0]), points.bits[row, 1]), points.bits[row, 2])
        key = set_key(stream(seed, 0, replicate), 0)
        ray, end = blocks[k // BLOCK * RAY + i :], min(n - k, each - index, BLOCK - i)
        _fill_rays(ray, (end, index), key, points.point[row], points.polygon[row].T, z, ideal, facing)
        k += end
    pad(blocks, n)


@device
def deflect_on_sensor(ray, j, index, key, deflection):
    """Displace ray j of a block on the sensor by diffraction at its microlens, by the point `index` of a set."""
    to_sensor_axes = deflection.to_sensor_axes
    by_x, by_y, _, _ = sample_deflection(deflection.field, sample(index, 0, key), sample(index, 1, key))
    h = deflection.distance + deflection.tilt[0] * ray[X + j] + deflection.tilt[1] * ray[Y + j]
    ray[X + j] += h * (to_sensor_axes[0, 0] * by_x + to_sensor_axes[0, 1] * by_y)
    ray[Y + j] += h * (to_sensor_axes[1, 0] * by_x + to_sensor_axes[1, 1] * by_y)


@device
def deflect_at_iris(ray, j, index, key, iris):
    """Deflect ray j of a block at the entrance pupil, by the point `index` of a set."""
    wavelength = iris.wavelengths[0]
    by_x, by_y, _, _ = sample_deflection(iris.field, sample(index, 2, key), sample(index, 3, key))
    deflect_at_pupil(ray, j, iris.z, (wavelength * by_x, wavelength * by_y))


@kernel
def fill_deflections(blocks, start, n, seed, task, deflection):
    """Displace rays start ... start + n - 1 of a `RayTask` on the sensor by diffraction at their microlenses."""
    key = set_key(stream(seed, task.number, task.replicate), DEFLECTION_SET)
    for k in range(n):
        index = set_index(np.uint32(task.first + start + k), key, DEFLECTION_SET)
        ray = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY]
        deflect_on_sensor(ray, k % BLOCK, index, key, deflection)


@kernel
def fill_iris_deflections(blocks, start, n, seed, task, iris):
    """Deflect rays start ... start + n - 1 of a `RayTask` at the entrance pupil."""
    key = set_key(stream(seed, task.number, task.replicate), DEFLECTION_SET)
    for k in range(n):
        index = set_index(np.uint32(task.first + start + k), key, DEFLECTION_SET)
        deflect_at_iris(blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY], k % BLOCK, index, key, iris)


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


@kernel
def fill_centroids(centroid, error, moments):
    """Centroids (n, 2) from moments (n, replicates, 3), and their standard errors by the jackknife over replicates."""
    count = moments.shape[1]
    for k in range(centroid.shape[0]):
        light = 0.0
        for i in range(count):
            light += moments[k, i, 0]
        for axis in range(2):
            total = 0.0
            for i in range(count):
                total += moments[k, i, axis + 1]
            centroid[k, axis] = total / light
            # About the centroid, so that the squares do not cancel.
            sum_, squares = 0.0, 0.0
            for i in range(count):
                without = (total - moments[k, i, axis + 1]) / (light - moments[k, i, 0]) - centroid[k, axis]
                sum_ += without
                squares += without * without
            error[k, axis] = math.sqrt(max(squares - sum_ * sum_ / count, 0.0) * (count - 1) / count)
