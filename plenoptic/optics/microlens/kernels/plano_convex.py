"""Plano-convex microlenses, exact or flat with the normals of a sphere: kernels for light in reverse.

A plate is a `PlateRecord`. Heights are from the lens's own axis, and z is from the next vertex on the ray.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import (
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
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.lens.kernels.spherical_refraction import COS2, DISTANCE, UNLIMITED, refract_sphere
from plenoptic.optics.microlens.kernels.plate_losses import LOSS_ROWS, absorb_in_plate, weaken_at_side
from plenoptic.optics.microlens.kernels.to_lens import at_wavelength, distance_to_sensor, is_open, weigh


@device
def refract_flat_block(ray, c, mu, mus, s):
    """Refract rays at a plane with the normals of a sphere of curvature c at the same distance from the axis.

    `mu` is the ratio of indices of all rays, unless `mus` holds one for each.
    """
    factor = 1.0 - mu * mu
    for i in range(BLOCK):
        ratio, ray_factor = mu, factor
        if mus is not None:
            ratio = mus[i]
            ray_factor = 1.0 - ratio * ratio
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        t = -ray[Z + i] / n
        x = ray[X + i] + t * l
        y = ray[Y + i] + t * m
        up = 1.0 - c * c * (x * x + y * y)
        nx, ny, nz = -c * x, -c * y, math.sqrt(max(up, 0.0))
        cos_i = s * (nx * l + ny * m + nz * n)
        cos2 = 1.0 - ratio * ratio * (1.0 - cos_i * cos_i)
        cos_t = math.sqrt(max(cos2, 0.0))
        a = s * (ray_factor / (cos_t + ratio * cos_i))
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = 0.0
        ray[L + i] = ratio * l + a * nx
        ray[M + i] = ratio * m + a * ny
        ray[N + i] = ratio * n + a * nz
        lost = 0.0 if cos2 >= 0.0 else TOTAL_REFLECTION
        lost = lost if up >= 0.0 and cos_i > 0.0 else MISSED
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _keep_inside(ray, lenslets, centre, edges):
    """Lose rays that meet the curved side outside of the cell or opening of their microlens.

    x, y are from the optical axis; `centre` holds the axes.
    """
    if lenslets is None:
        cell = edges.cell
        for k in range(cell.shape[0]):
            nx, ny, apothem = cell[k, 0], cell[k, 1], cell[k, 2]
            for i in range(BLOCK):
                inside = nx * ray[X + i] + ny * ray[Y + i] <= apothem
                was = ray[STATUS + i]
                ray[STATUS + i] = was if was != 0.0 or inside else OUTSIDE_MICROLENS
    else:
        for i in range(BLOCK):
            lens = lenslets[i]
            x = ray[X + i] + centre[i] - lens.centre_x
            y = ray[Y + i] + centre[BLOCK + i] - lens.centre_y
            inside = lens.clip == 0.0 or is_open(x, y, edges.radius2, edges.opening) == (lens.clip > 0.0)
            x, y = x + lens.centre_x - lens.cell_x, y + lens.centre_y - lens.cell_y
            cell = edges.cell if edges.cells is None else edges.cells[lens.row]
            inside = inside and is_open(x, y, math.inf, cell)
            was = ray[STATUS + i]
            ray[STATUS + i] = was if was != 0.0 or inside else OUTSIDE_MICROLENS


@device
def _refract_lenslets(ray, lenslets, flat, bow, mu, mus, losses):
    """Refract rays at the curved sides of lenses that differ: curvature sign * power * scale, `bow` (sign, scale).

    `losses` as of `refract_sphere`.
    """
    sign, scale = bow
    factor = 1.0 - mu * mu
    for i in range(BLOCK):
        ratio, ray_factor = mu, factor
        if mus is not None:
            ratio = mus[i]
            ray_factor = 1.0 - ratio * ratio
        c = sign * lenslets[i].power * scale
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        if flat:
            t = -z / n
            x, y, z = x + t * l, y + t * m, 0.0
            up = 1.0 - c * c * (x * x + y * y)
            nx, ny, nz = -c * x, -c * y, math.sqrt(max(up, 0.0))
            q = -(nx * l + ny * m + nz * n)
            q2 = up if q > 0.0 else -1.0
        else:
            # As in `sphere.refract_sphere`, towards the scene.
            e = -(x * l + y * m + z * n)
            x, y, z = x + e * l, y + e * m, z + e * n
            f = c * (x * x + y * y + z * z) - 2.0 * z
            g = n - c * (x * l + y * m + z * n)
            q2 = g * g - c * f
            q = math.sqrt(max(q2, 0.0))
            t = f / (g - q) if g <= 0.0 else (g + q) / c
            x, y, z = x + t * l, y + t * m, z + t * n
            nx, ny, nz = -c * x, -c * y, 1.0 - c * z
            q2 = q2 if nz > 0.0 else -1.0
        cos2 = 1.0 - ratio * ratio * (1.0 - q * q)
        if losses is not None and not flat:
            losses[COS2, i] = min(q * q, cos2)
            losses[DISTANCE, i] = e + t
        a = -(ray_factor / (math.sqrt(max(cos2, 0.0)) + ratio * q))
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = z
        ray[L + i] = ratio * l + a * nx
        ray[M + i] = ratio * m + a * ny
        ray[N + i] = ratio * n + a * nz
        lost = 0.0 if cos2 >= 0.0 else TOTAL_REFLECTION
        lost = lost if q2 > 0.0 else MISSED
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _refract_curved_side(ray, lenslets, power, flat, bow, mu, mus, losses):
    """Refract rays at the curved side, or at the plane that stands for it."""
    if lenslets is not None:
        _refract_lenslets(ray, lenslets, flat, bow, mu, mus, losses)
    elif flat:
        refract_flat_block(ray, bow[0] * power * bow[1], mu, mus, -1.0)
    else:
        refract_sphere(ray, bow[0] * power * bow[1], mu, mus, UNLIMITED, -1.0, 0.0, losses)


@device
def _fill_ratios(entering, leaving, indices, waves, b):
    """Ratios of indices of a block of paths, for entering the plate and for leaving it."""
    for i in range(BLOCK):
        leaving[i] = at_wavelength(indices, waves, b * BLOCK + i)
        entering[i] = 1.0 / leaving[i]


@kernel
def fill_plano_convex(blocks, lenslets, sensor, plate, power, edges, z_array, waves):
    """Turn aimed samples into rays towards the lens; rays that meet the curved side outside of their lens are lost.

    `edges` is an `EdgesRecord`, `z_array` the front principal plane, `waves` the numbers of the wavelengths sampled by
    paths, or None.
    """
    distance, index, thickness = sensor.distance, plate.refractive_index, plate.thickness
    # Light that travels in reverse meets the side towards the sensor first.
    curved_first, flat = not plate.towards_scene, plate.flat
    centre = np.empty(2 * BLOCK)
    entering = None if plate.indices is None else np.empty(BLOCK)
    leaving = None if plate.indices is None else np.empty(BLOCK)
    losses = None if plate.losses is None else np.empty((LOSS_ROWS, BLOCK))
    scale = 1.0 / (index - 1.0)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        lenses = None if lenslets is None else lenslets[b * BLOCK : (b + 1) * BLOCK]
        if plate.indices is not None:
            _fill_ratios(entering, leaving, plate.indices, waves, b)
        weigh(ray, distance, sensor.tilt)
        for i in range(BLOCK):
            h = distance_to_sensor(ray, i, distance, sensor.tilt)
            cx, cy = ray[Z + i], ray[N + i]
            centre[i] = cx
            centre[BLOCK + i] = cy
            u, v = ray[L + i], ray[M + i]
            n = 1.0 / math.sqrt(u * u + v * v + h * h)
            ray[X + i] = ray[X + i] - u - cx
            ray[Y + i] = ray[Y + i] - v - cy
            ray[Z + i] = h if curved_first else h - thickness / index
            ray[L + i] = u * n
            ray[M + i] = v * n
            ray[N + i] = -h * n
        if curved_first:
            _refract_curved_side(ray, lenses, power, flat, (-1.0, scale), 1.0 / index, entering, losses)
            _keep_inside(ray, lenses, centre, edges)
        else:
            refract_sphere(ray, 0.0, 1.0 / index, entering, UNLIMITED, -1.0, 0.0, losses)
        if plate.losses is not None:
            weaken_at_side(ray, plate.losses, waves, b * BLOCK, losses)
        for i in range(BLOCK):
            ray[Z + i] += thickness
        if curved_first:
            refract_sphere(ray, 0.0, index, leaving, UNLIMITED, -1.0, 0.0, losses)
        else:
            _refract_curved_side(ray, lenses, power, flat, (1.0, scale), index, leaving, losses)
            _keep_inside(ray, lenses, centre, edges)
        if plate.losses is not None:
            weaken_at_side(ray, plate.losses, waves, b * BLOCK, losses)
            if plate.losses.attenuation is not None:
                absorb_in_plate(ray, plate.losses, waves, b * BLOCK, losses)
        # From the last vertex, the front one, the front principal plane is at 0 or thickness / index.
        z_front = z_array - (thickness / index if curved_first else 0.0)
        for i in range(BLOCK):
            ray[X + i] += centre[i]
            ray[Y + i] += centre[BLOCK + i]
            ray[Z + i] += z_front
            if lenslets is not None:
                ray[WEIGHT + i] *= lenslets[b * BLOCK + i].transmission
