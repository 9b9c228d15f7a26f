"""Ideal microlenses, pinholes and thin lenses: the kernels."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.lens.kernels.trace import give_rays, take_rays
from plenoptic.optics.microlens.kernels.cell_lookup import AXIS_X, AXIS_Y, LENS_ROWS, POWER, find_cells, find_lenses
from plenoptic.optics.microlens.kernels.path_length import store_lenses
from plenoptic.optics.microlens.kernels.to_lens import at_wavelength, distance_to_sensor, launch, weigh
from plenoptic.optics.microlens.kernels.to_sensor import reach_sensor, to_plane


@kernel
def fill_pinholes(blocks, sensor, z_plane):
    """Trace rays from the sensor straight through the centres of the cells at which they were aimed."""
    distance = sensor.distance
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        weigh(ray, distance, sensor.tilt)
        for i in range(BLOCK):
            h = distance_to_sensor(ray, i, distance, sensor.tilt)
            # The aim point minus its offset from the sensor is the point on the sensor.
            u = (ray[Z + i] - (ray[X + i] - ray[L + i])) / h
            v = (ray[N + i] - (ray[Y + i] - ray[M + i])) / h
            ray[X + i] = ray[Z + i]
            ray[Y + i] = ray[N + i]
            launch(ray, i, (u, v), z_plane)


@kernel
def fill_thin(blocks, lenslets, sensor, power, z_plane, power_factors, waves):
    """Turn aimed samples into rays towards the lens: slopes change by height over focal length (power = 1/f).

    `power_factors` are those of `ArrayRecord`, `waves` the numbers of the wavelengths sampled by paths, or None.
    """
    distance = sensor.distance
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        weigh(ray, distance, sensor.tilt)
        for i in range(BLOCK):
            ray_power = power if lenslets is None else lenslets[b * BLOCK + i].power
            if power_factors is not None:
                ray_power *= at_wavelength(power_factors, waves, b * BLOCK + i)
            h = distance_to_sensor(ray, i, distance, sensor.tilt)
            u = ray[L + i] / h - (ray[X + i] - ray[Z + i]) * ray_power
            v = ray[M + i] / h - (ray[Y + i] - ray[N + i]) * ray_power
            launch(ray, i, (u, v), z_plane)


@device
def _refract_thin(ray, lens_rows, z_array, array, differs):
    """Refract rays behind the lens by thin lenses in the plane z_array, which becomes the origin of z."""
    equal = array.lattice.powers[0]
    to_plane(ray, z_array)
    if differs is None:
        find_cells(ray, lens_rows, 0.0, array.lattice)
    else:
        find_lenses(ray, lens_rows, 0.0, True, array)
    for i in range(BLOCK):
        power = equal if differs is None else lens_rows[POWER + i]
        before = ray[N + i]
        u = ray[L + i] / before - (ray[X + i] - lens_rows[AXIS_X + i]) * power
        v = ray[M + i] / before - (ray[Y + i] - lens_rows[AXIS_Y + i]) * power
        after = 1.0 / math.sqrt(1.0 + u * u + v * v)
        fraction = (after * after) / (before * before)
        ray[WEIGHT + i] *= fraction * fraction
        ray[L + i] = u * after
        ray[M + i] = v * after
        ray[N + i] = after


@kernel
def fill_thin_forward(blocks, z_array, sensor, array, differs):
    """Trace rays behind the lens to the sensor.

    Equal lenses fill the cells of the lattice. If lenses differ, `differs` is the `ArrayRecord`, in which they are
    looked up; otherwise it is None.
    """
    lens_rows = np.empty(LENS_ROWS * BLOCK)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _refract_thin(ray, lens_rows, z_array, array, differs)
        reach_sensor(ray, lens_rows, sensor, array)


@kernel
def fill_thin_lenses(out, traced, rays, array, differs, first, last):
    """Refract rays `first` to `last` of `RayArrays` by thin lenses at z = 0; their lenses go to `traced`."""
    ray, lens_rows = np.zeros(RAY), np.zeros(LENS_ROWS * BLOCK)
    for start in range(first, last, BLOCK):
        end = min(start + BLOCK, last)
        take_rays(ray, rays, start, end)
        _refract_thin(ray, lens_rows, 0.0, array, differs)
        give_rays(out, ray, start, end)
        if differs is None:
            for i in range(BLOCK):
                lens_rows[POWER + i] = array.lattice.powers[0]
        store_lenses(traced.lenses, lens_rows, start, end)
