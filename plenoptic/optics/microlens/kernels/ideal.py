"""Ideal microlenses, pinholes and thin lenses: the kernels."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.lens.kernels.trace import give_rays, take_rays
from plenoptic.optics.microlens.kernels.cell_lookup import AXIS_X, AXIS_Y, PLACE, POWER, find_cells, find_lenses
from plenoptic.optics.microlens.kernels.paths import give_places
from plenoptic.optics.microlens.kernels.to_lens import at_wavelength, distance_to_sensor, head_for, weigh
from plenoptic.optics.microlens.kernels.to_sensor import land, to_plane


@kernel
def fill_pinholes(blocks, sensor, z_plane):
    """Rays from the sensor straight through the centres of the cells in which they were aimed."""
    distance = sensor.distance
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        weigh(ray, distance, sensor.tilt)
        for i in range(BLOCK):
            h = distance_to_sensor(ray, i, distance, sensor.tilt)
            # The point aimed at less what leads there from the sensor is the point on the sensor.
            u = (ray[Z + i] - (ray[X + i] - ray[L + i])) / h
            v = (ray[N + i] - (ray[Y + i] - ray[M + i])) / h
            ray[X + i] = ray[Z + i]
            ray[Y + i] = ray[N + i]
            head_for(ray, i, (u, v), z_plane)


@kernel
def fill_thin(blocks, own, sensor, power, z_plane, power_factors, waves):
    """Aimed samples become rays towards the lens: slopes change by height over focal length (power = 1/f).

    `power_factors` are those of `ArrayRecord`, `waves` the numbers of the wavelengths that paths have drawn, or None.
    """
    distance = sensor.distance
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        weigh(ray, distance, sensor.tilt)
        for i in range(BLOCK):
            bend = power if own is None else own[b * BLOCK + i].power
            if power_factors is not None:
                bend *= at_wavelength(power_factors, waves, b * BLOCK + i)
            h = distance_to_sensor(ray, i, distance, sensor.tilt)
            u = ray[L + i] / h - (ray[X + i] - ray[Z + i]) * bend
            v = ray[M + i] / h - (ray[Y + i] - ray[N + i]) * bend
            head_for(ray, i, (u, v), z_plane)


@device
def _through_thin(ray, place, z_array, array, differs):
    """Rays behind the lens pass thin lenses in the plane z_array, from which z is measured then."""
    equal = array.lattice.powers[0]
    to_plane(ray, z_array)
    if differs is None:
        find_cells(ray, place, 0.0, array.lattice)
    else:
        find_lenses(ray, place, 0.0, True, array)
    for i in range(BLOCK):
        bend = equal if differs is None else place[POWER + i]
        before = ray[N + i]
        u = ray[L + i] / before - (ray[X + i] - place[AXIS_X + i]) * bend
        v = ray[M + i] / before - (ray[Y + i] - place[AXIS_Y + i]) * bend
        after = 1.0 / math.sqrt(1.0 + u * u + v * v)
        fraction = (after * after) / (before * before)
        ray[WEIGHT + i] *= fraction * fraction
        ray[L + i] = u * after
        ray[M + i] = v * after
        ray[N + i] = after


@kernel
def fill_thin_forward(blocks, z_array, sensor, array, differs):
    """Rays behind the lens land on the sensor.

    Equal lenses fill the cells of the lattice; those that differ are found in the `ArrayRecord`, which `differs` is
    too then, otherwise None.
    """
    place = np.empty(PLACE * BLOCK)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _through_thin(ray, place, z_array, array, differs)
        land(ray, place, sensor, array)


@kernel
def fill_thin_lenses(out, found, given, array, differs, first, last):
    """Rays `first` to `last` of `RayArrays` pass thin lenses at z = 0; which, gets `found`, a `FoundPaths`."""
    ray, place = np.zeros(RAY), np.zeros(PLACE * BLOCK)
    for start in range(first, last, BLOCK):
        end = min(start + BLOCK, last)
        take_rays(ray, given, start, end)
        _through_thin(ray, place, 0.0, array, differs)
        give_rays(out, ray, start, end)
        if differs is None:
            for i in range(BLOCK):
                place[POWER + i] = array.lattice.powers[0]
        give_places(found.lenses, place, start, end)
