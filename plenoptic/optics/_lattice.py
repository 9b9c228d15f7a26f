"""Rays through one microlens each: the kernels between sensor and main lens.

On entry a block of rays (see `_trace`) holds, for each ray, the point on the array's rear principal plane
at which it is aimed (X, Y), that point minus the point on the sensor (L, M), the centre of the microlens
(Z, N) and the area that the sample stands for (WEIGHT). On exit it holds rays as `_trace` wants them,
travelling towards the scene, and WEIGHT is the projected solid angle that the sample stands for.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic._jit import device, kernel
from plenoptic.optics._blocks import (
    BLOCK,
    MISSED,
    OUTSIDE_MICROLENS,
    RAY,
    STATUS,
    TOTAL_REFLECTION,
    WEIGHT,
    L,
    M,
    N,
    X,
    Y,
    Z,
)
from plenoptic.optics._trace import refract_block


@device
def _weigh(ray, distance):
    """Projected solid angle: area cos^4 / distance^2 on a plane parallel to the sensor."""
    d2 = distance * distance
    for i in range(BLOCK):
        r2 = ray[L + i] * ray[L + i] + ray[M + i] * ray[M + i] + d2
        ray[WEIGHT + i] *= d2 / (r2 * r2)


@kernel
def fill_straight(blocks, distance, z_plane):
    """No microlenses: rays from the sensor straight through points of a plane at z_plane."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _weigh(ray, distance)
        for i in range(BLOCK):
            u, v = ray[L + i] / distance, ray[M + i] / distance
            n = 1.0 / math.sqrt(1.0 + u * u + v * v)
            ray[Z + i] = z_plane
            ray[L + i] = u * n
            ray[M + i] = v * n
            ray[N + i] = -n


@kernel
def fill_thin(blocks, distance, power, z_plane):
    """Ideal thin lenses: slopes change by height over focal length (power = 1/f)."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _weigh(ray, distance)
        for i in range(BLOCK):
            u = ray[L + i] / distance - (ray[X + i] - ray[Z + i]) * power
            v = ray[M + i] / distance - (ray[Y + i] - ray[N + i]) * power
            n = 1.0 / math.sqrt(1.0 + u * u + v * v)
            ray[Z + i] = z_plane
            ray[L + i] = u * n
            ray[M + i] = v * n
            ray[N + i] = -n


@kernel
def fill_pinholes(blocks, distance, z_plane):
    """Pinholes: rays from the sensor straight through the centres of the cells in which they were aimed."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _weigh(ray, distance)
        for i in range(BLOCK):
            # The point aimed at less what leads there from the sensor is the point on the sensor.
            u = (ray[Z + i] - (ray[X + i] - ray[L + i])) / distance
            v = (ray[N + i] - (ray[Y + i] - ray[M + i])) / distance
            n = 1.0 / math.sqrt(1.0 + u * u + v * v)
            ray[X + i] = ray[Z + i]
            ray[Y + i] = ray[N + i]
            ray[Z + i] = z_plane
            ray[L + i] = u * n
            ray[M + i] = v * n
            ray[N + i] = -n


@device
def refract_flat_block(ray, c, mu, s):
    """Through a plane with the normals of a sphere of curvature c, taken at the same distance from the axis."""
    bend = 1.0 - mu * mu
    for i in range(BLOCK):
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        t = -ray[Z + i] / n
        x = ray[X + i] + t * l
        y = ray[Y + i] + t * m
        up = 1.0 - c * c * (x * x + y * y)
        nx, ny, nz = -c * x, -c * y, math.sqrt(max(up, 0.0))
        cos_i = s * (nx * l + ny * m + nz * n)
        cos2 = 1.0 - mu * mu * (1.0 - cos_i * cos_i)
        cos_t = math.sqrt(max(cos2, 0.0))
        a = s * (bend / (cos_t + mu * cos_i))
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = 0.0
        ray[L + i] = mu * l + a * nx
        ray[M + i] = mu * m + a * ny
        ray[N + i] = mu * n + a * nz
        lost = 0.0 if cos2 >= 0.0 else TOTAL_REFLECTION
        lost = lost if up >= 0.0 and cos_i > 0.0 else MISSED
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _keep_inside(ray, edges):
    """Status of rays that meet the curved surface outside their own cell; x, y are from its centre."""
    for k in range(edges.shape[0]):
        nx, ny, apothem = edges[k, 0], edges[k, 1], edges[k, 2]
        for i in range(BLOCK):
            inside = nx * ray[X + i] + ny * ray[Y + i] <= apothem
            was = ray[STATUS + i]
            ray[STATUS + i] = was if was != 0.0 or inside else OUTSIDE_MICROLENS


@device
def _refract_curved(ray, c, mu, flat):
    """Through the curved side, or through the plane that stands for it."""
    if flat:
        refract_flat_block(ray, c, mu, -1.0)
    else:
        refract_block(ray, c, mu, math.inf, math.inf, -1.0, 0.0)


@kernel
def fill_plano_convex(blocks, distance, z_array, curved_first, flat, curvature, thickness, index, edges):
    """Plano-convex lenses: a plane and a sphere of the given (signed) curvature.

    `curved_first`: the curved side faces the sensor, so that light travelling in reverse meets it first. `flat`: the
    sphere gives its normals only. `z_array` is the front principal plane; `edges` the cell's edge normals and
    distances from its centre.
    """
    centre = np.empty(2 * BLOCK)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _weigh(ray, distance)
        # Heights from the lens's own centre, z from the first vertex in the order of travel.
        behind = distance if curved_first else distance - thickness / index
        for i in range(BLOCK):
            cx, cy = ray[Z + i], ray[N + i]
            centre[i] = cx
            centre[BLOCK + i] = cy
            u, v = ray[L + i], ray[M + i]
            n = 1.0 / math.sqrt(u * u + v * v + distance * distance)
            ray[X + i] = ray[X + i] - u - cx
            ray[Y + i] = ray[Y + i] - v - cy
            ray[Z + i] = behind
            ray[L + i] = u * n
            ray[M + i] = v * n
            ray[N + i] = -distance * n
        if curved_first:
            _refract_curved(ray, curvature, 1.0 / index, flat)
            _keep_inside(ray, edges)
        else:
            refract_block(ray, 0.0, 1.0 / index, math.inf, math.inf, -1.0, 0.0)
        for i in range(BLOCK):
            ray[Z + i] += thickness
        if curved_first:
            refract_block(ray, 0.0, index, math.inf, math.inf, -1.0, 0.0)
        else:
            _refract_curved(ray, curvature, index, flat)
            _keep_inside(ray, edges)
        # Vertex met last: the front vertex, from which the front principal plane lies 0 or thickness/index.
        z_front = z_array - (thickness / index if curved_first else 0.0)
        for i in range(BLOCK):
            ray[X + i] += centre[i]
            ray[Y + i] += centre[BLOCK + i]
            ray[Z + i] += z_front
