"""Kernels: rays of many particles, the pixels that they reach, and sums over them."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.psf.kernels.source_rays import deflect_at_iris, deflect_on_sensor
from plenoptic.camera.sampling.kernels.path_numbers import DEFLECTION_SET
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.polygons import area_of, point_in
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.kernels.sobol import sample, set_index, set_key, stream
from plenoptic.core.numba.jit import device, kernel


@device
def _place(batch, k):
    """Row of the particle, replicate, and index in the replicate's net of ray k of a bundle."""
    number, index = k // batch.each, k % batch.each
    return number // batch.replicates, number % batch.replicates, index + batch.offset


@device
def _offset(dx, dy, dz, radius, u, v):
    """Point of a disc around the origin that faces the direction (dx, dy, dz), from a point of the unit square."""
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    # Directions towards the lens have dz > 0 (T. Duff et al., JCGT 6(1), 2017).
    a = -1.0 / (1.0 + dz)
    b = dx * dy * a
    r, phi = radius * math.sqrt(u), 2.0 * math.pi * v
    p, q = r * math.cos(phi), r * math.sin(phi)
    return p * (1.0 + dx * dx * a) + q * b, p * b + q * (1.0 + dy * dy * a), -p * dx - q * dy


@kernel
def fill_particle_rays(blocks, batch, seed, z, ideal, lengths):
    """Sample the rays of a `ParticleBatch` from their particles to the polygons on the plane z.

    WEIGHT is the solid angle of a single ray, area cos^3 / height^2; before an `ideal` lens it is du dv / cos, see
    `fill_source_rays`, whose emitters are flat. `lengths` (n,) get the paths to the plane in mm; or None.
    """
    n = batch.number.size * batch.replicates * batch.each
    key, area, corners = np.uint64(0), 0.0, batch.polygon.shape[2]
    for k in range(n):
        row, replicate, index = _place(batch, k)
        polygon, point, radius = batch.polygon[row], batch.point[row], batch.radius[row]
        if k % batch.each == 0:
            key = set_key(stream(seed, batch.number[row], replicate), 0)
            area = area_of(polygon, 0, corners)
        x, y = point_in(polygon, 0, corners, sample(index, 0, key) * area, sample(index, 1, key))
        dx, dy, dz = x - point[0], y - point[1], z - point[2]
        square, height = dx * dx + dy * dy + dz * dz, dz
        if radius > 0.0:
            ox, oy, oz = _offset(dx, dy, dz, radius, sample(index, 2, key), sample(index, 3, key))
            dx, dy, dz = dx - ox, dy - oy, dz - oz
        per_length = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
        ray, j = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY], k % BLOCK
        ray[X + j], ray[Y + j], ray[Z + j] = x, y, z
        ray[L + j], ray[M + j], ray[N + j] = dx * per_length, dy * per_length, dz * per_length
        ray[STATUS + j] = 0.0
        if lengths is not None:
            lengths[k] = 1.0 / per_length
        if ideal:
            ray[WEIGHT + j] = area * math.sqrt(square) / (height * height * height)
        else:
            ray[WEIGHT + j] = area * height / (square * math.sqrt(square))
    pad(blocks, n)


@kernel
def fill_particle_deflections(blocks, batch, seed, iris, deflection):
    """Deflect the rays of a bundle by diffraction, at the iris or between array and sensor; None for neither."""
    for k in range(batch.number.size * batch.replicates * batch.each):
        row, replicate, index = _place(batch, k)
        key = set_key(stream(seed, batch.number[row], replicate), DEFLECTION_SET)
        shuffled = set_index(np.uint32(index), key, DEFLECTION_SET)
        ray = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY]
        if iris is not None:
            deflect_at_iris(ray, k % BLOCK, shuffled, key, iris)
        if deflection is not None:
            deflect_on_sensor(ray, k % BLOCK, shuffled, key, deflection)


@kernel
def weaken_rays(blocks, transmission):
    """Weigh rays by the fractions (n,) of light that surfaces of the scene pass; those without light are lost."""
    for k in range(transmission.size):
        ray, j = (k // BLOCK) * RAY, k % BLOCK
        blocks[ray + WEIGHT + j] *= transmission[k]
        if transmission[k] <= 0.0:
            blocks[ray + STATUS + j] = MISSED


@kernel
def fill_pixels(pixel, weight, moments, blocks, batch, screen, opening, transmission):
    """Pixels of the rays of a bundle, -1 beside the sensor or an `opening`, and their weights (n, channels).

    `moments` (particles, replicates, 3) get sums of w, w x, w y with w the mean over the channels, x and y in mm.
    `screen` is rows, columns and pitch of the sensor; `transmission` (n, channels) is that of media, or None.
    """
    rows, columns, pitch = screen
    for k in range(pixel.size):
        ray, j = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY], k % BLOCK
        pixel[k] = -1
        if ray[STATUS + j] != 0.0:
            continue
        x, y = ray[X + j], ray[Y + j]
        column, row = 0.5 * columns - x / pitch, 0.5 * rows + y / pitch
        if not (0.0 <= row < rows and 0.0 <= column < columns):
            continue
        i, c = math.floor(row), math.floor(column)
        if opening is not None and (abs(row - i - 0.5) > opening[0] or abs(column - c - 0.5) > opening[1]):
            continue
        particle, replicate, _ = _place(batch, k)
        pixel[k], mean = i * columns + c, 0.0
        for channel in range(weight.shape[1]):
            w = ray[WEIGHT + j] * batch.colour[particle, channel]
            if transmission is not None:
                w *= transmission[k, channel]
            weight[k, channel] = w
            mean += w / weight.shape[1]
        sums = moments[particle, replicate]
        sums[0] += mean
        sums[1] += mean * x
        sums[2] += mean * y


@kernel
def fill_entries(entries, counts, pixel, weight, table, sums, each):
    """Sum the rays of each particle over pixels: `entries` are pixels (m,), weights and their errors (m, channels).

    `counts` (particles,) gets the number of pixels of each, in the order in which rays reach them; `pixel` is (passes,
    particles, replicates, rays), `weight` has channels as a last dimension. `table` is a hash table with a power of two
    of slots, more than twice the rays of a particle; `sums` (rays, replicates, channels) is a workspace. Returns the
    number of entries.
    """
    end, mask = 0, table.size - 1
    passes, _, replicates, rays = pixel.shape
    channels = weight.shape[4]
    for p in range(counts.size):
        table[:] = -1
        first = end
        for s in range(passes):
            for r in range(replicates):
                for j in range(rays):
                    number = pixel[s, p, r, j]
                    if number < 0:
                        continue
                    slot = (number * 7919) & mask
                    while table[slot] >= 0 and entries[0][table[slot]] != number:
                        slot = (slot + 1) & mask
                    if table[slot] < 0:
                        table[slot] = end
                        entries[0][end] = number
                        sums[end - first] = 0.0
                        end += 1
                    for c in range(channels):
                        sums[table[slot] - first, r, c] += weight[s, p, r, j, c]
        counts[p] = end - first
        for e in range(first, end):
            for c in range(channels):
                mean = 0.0
                for r in range(replicates):
                    mean += sums[e - first, r, c]
                mean /= replicates * each
                squares = 0.0
                for r in range(replicates):
                    step = sums[e - first, r, c] / each - mean
                    squares += step * step
                entries[1][e, c] = mean
                entries[2][e, c] = math.sqrt(squares / (replicates * (replicates - 1)))
    return end


@kernel
def add_entries(image, variance, counts, entries, intensity):
    """Add particles to an image and its variance, (pixels, channels), by `entries` as of `fill_entries`.

    `intensity` is (particles, 1) or (particles, channels); weights may have one channel for all.
    """
    e = 0
    pixels, weights, errors = entries
    for p in range(counts.size):
        for _ in range(counts[p]):
            for c in range(image.shape[1]):
                light = intensity[p, c if intensity.shape[1] > 1 else 0]
                w = c if weights.shape[1] > 1 else 0
                image[pixels[e], c] += light * weights[e, w]
                variance[pixels[e], c] += (light * errors[e, w]) ** 2
            e += 1
