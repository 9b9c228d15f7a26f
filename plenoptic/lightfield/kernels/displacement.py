"""Displacement of pixels from a model whose images are affine, by rays traced out of the lens."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, NOT_FINITE, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.lens.kernels.trace import trace_block

_MOST_STEPS, _TOLERANCE = 20, 1e-4
"""Steps towards a point in an object plane, and the distance to it, in pixels, before the last one."""


@device
def _start_rays(ray, frame):
    """Turn a block of local points (X, Y) of the array and slopes (L, M) to rays towards the scene, in lens axes."""
    r, s = frame, frame[:, 3]
    for i in range(BLOCK):
        x, y, a, b = ray[X + i], ray[Y + i], ray[L + i], ray[M + i]
        scale = -1.0 / math.sqrt(1.0 + a * a + b * b)
        ray[X + i] = r[0, 0] * x + r[0, 1] * y + s[0]
        ray[Y + i] = r[1, 0] * x + r[1, 1] * y + s[1]
        ray[Z + i] = r[2, 0] * x + r[2, 1] * y + s[2]
        ray[L + i] = scale * (r[0, 0] * a + r[0, 1] * b + r[0, 2])
        ray[M + i] = scale * (r[1, 0] * a + r[1, 1] * b + r[1, 2])
        ray[N + i] = scale * (r[2, 0] * a + r[2, 1] * b + r[2, 2])
        ray[WEIGHT + i] = 1.0
        ray[STATUS + i] = 0.0 if math.isfinite(x + y + a + b) else NOT_FINITE


@device
def _intersect_planes(points, ray, z):
    """Fill the intersections (4 BLOCK,) of a block of rays with two planes z: x and y of the first, then the second."""
    for k in range(2):
        x, y = points[2 * k * BLOCK :], points[(2 * k + 1) * BLOCK :]
        for i in range(BLOCK):
            distance = (z[k] - ray[Z + i]) / ray[N + i]
            x[i] = ray[X + i] + distance * ray[L + i]
            y[i] = ray[Y + i] + distance * ray[M + i]


@device
def _next(pixel, point, m):
    """Numbers of the ray after that through a point, of m, of a pixel."""
    return (pixel, point + 1) if point + 1 < m else (pixel + 1, 0)


@kernel
def fill_displacement(throughput, displacement, pixels, starts, points, lens, model):
    """Fraction (n,) of rays that a lens passes, and displacement (n, 2, 2) of their centroid's image, NaN without rays.

    `pixels` are the pixels (n, 2) and their microlenses (n, 2). Rays of a pixel pass its position (n, 2) on the array
    plus each of `points` (m, 2), with its slope (n, 2) plus its deviation (n,) times the point: these are `starts`.
    `model` has the frame (3, 4) from local axes to those of the lens, positions z and disparities (2,) of two planes,
    and maps (2, 2, 5) of 1, a point of the plane, and a microlens to a pixel. Displacement is given as coefficients of
    1 and disparity.
    """
    pixel, on_array = pixels
    position, slope, deviation = starts
    frame, z, disparity, maps = model
    ray, crossed, m = np.zeros(RAY), np.empty(4 * BLOCK), points.shape[0]
    n = position.shape[0]
    total, offset = np.zeros((n, 5)), np.empty((2, 2))
    for start in range(0, n * m, BLOCK):
        count = min(BLOCK, n * m - start)
        p, j = start // m, start % m
        for i in range(count):
            x, y = points[j, 0], points[j, 1]
            ray[X + i], ray[Y + i] = position[p, 0] + x, position[p, 1] + y
            ray[L + i], ray[M + i] = slope[p, 0] + deviation[p] * x, slope[p, 1] + deviation[p] * y
            p, j = _next(p, j, m)
        _start_rays(ray, frame)
        trace_block(ray, lens, None, 0, None, None, None)
        _intersect_planes(crossed, ray, z)
        p, j = start // m, start % m
        for i in range(count):
            if ray[STATUS + i] == 0.0:
                weight = ray[WEIGHT + i]
                total[p, 0] += weight
                for row in range(4):
                    total[p, row + 1] += weight * crossed[row * BLOCK + i]
            p, j = _next(p, j, m)
    for p in range(total.shape[0]):
        throughput[p] = total[p, 0] / m
        weight = total[p, 0] if total[p, 0] > 0.0 else math.nan
        for k in range(2):
            x, y = total[p, 2 * k + 1] / weight, total[p, 2 * k + 2] / weight
            for c in range(2):
                a = maps[k, c]
                image = a[0] + a[1] * x + a[2] * y + a[3] * on_array[p, 0] + a[4] * on_array[p, 1]
                offset[k, c] = pixel[p, c] - image
        for c in range(2):
            displacement[p, 1, c] = (offset[1, c] - offset[0, c]) / (disparity[1] - disparity[0])
            displacement[p, 0, c] = offset[0, c] - displacement[p, 1, c] * disparity[0]


@kernel
def fill_slopes_to_points(slope, starts, per_pixel, lens, model):
    """Slopes (n, 2) of rays that meet the points of planes which the pinhole model images at targets (n, 2), in pixels.

    `slope` has estimates of them, and NaN in the end where a ray is lost. `starts` are the positions (n, 2) of rays on
    the array, their microlenses (n, 2), the targets, and the disparities (n,) of the planes. `per_pixel` (2, 2) is the
    approximate change of slopes per row and column, and `model` is that of `fill_displacement`.

    By Anderson's iteration: each step extrapolates the line through the last two (D. G. Anderson, J. ACM 12 (1965),
    doi:10.1145/321296.321305).
    """
    position, on_array, target, disparity = starts
    frame, z, planes, maps = model
    ray, crossed, n = np.zeros(RAY), np.empty(4 * BLOCK), slope.shape[0]
    image, point, value, residual = (np.empty(2), np.empty((BLOCK, 2)), np.empty((BLOCK, 2)), np.empty((BLOCK, 2)))
    moving = np.empty(BLOCK, np.bool_)
    for start in range(0, n, BLOCK):
        count = min(BLOCK, n - start)
        point[:], moving[:] = 0.0, True
        for trial in range(_MOST_STEPS):
            n_moving = 0
            for i in range(count):
                p, (u, v) = start + i, (point[i, 0], point[i, 1])
                ray[X + i], ray[Y + i] = position[p, 0], position[p, 1]
                ray[L + i] = slope[p, 0] + per_pixel[0, 0] * u + per_pixel[0, 1] * v
                ray[M + i] = slope[p, 1] + per_pixel[1, 0] * u + per_pixel[1, 1] * v
                n_moving += moving[i]
            if n_moving == 0:
                break
            _start_rays(ray, frame)
            trace_block(ray, lens, None, 0, None, None, None)
            _intersect_planes(crossed, ray, z)
            for i in range(count):
                if not moving[i]:
                    continue
                p = start + i
                t = (disparity[p] - planes[0]) / (planes[1] - planes[0])
                change_squares, product, squares = 0.0, 0.0, 0.0
                for c in range(2):
                    image[c] = 0.0
                    for k in range(2):
                        a, x, y = maps[k, c], crossed[2 * k * BLOCK + i], crossed[(2 * k + 1) * BLOCK + i]
                        pixel = a[0] + a[1] * x + a[2] * y + a[3] * on_array[p, 0] + a[4] * on_array[p, 1]
                        image[c] += (t if k else 1.0 - t) * pixel
                    image[c] = target[p, c] - image[c]
                    change = image[c] - residual[i, c]
                    squares += image[c] * image[c]
                    product += change * image[c]
                    change_squares += change * change
                mixing = product / change_squares if trial > 0 and change_squares > 0.0 else 0.0
                for c in range(2):
                    new = point[i, c] + image[c]
                    point[i, c] = new - mixing * (new - value[i, c]) if trial > 0 else new
                    value[i, c], residual[i, c] = new, image[c]
                    if ray[STATUS + i] != 0.0:
                        point[i, c] = math.nan
                moving[i] = squares > _TOLERANCE * _TOLERANCE and ray[STATUS + i] == 0.0
        for i in range(count):
            p, (u, v) = start + i, (point[i, 0], point[i, 1])
            slope[p, 0] += per_pixel[0, 0] * u + per_pixel[0, 1] * v
            slope[p, 1] += per_pixel[1, 0] * u + per_pixel[1, 1] * v
