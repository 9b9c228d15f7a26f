"""Kernels: deflection of rays by diffraction at the iris."""

from __future__ import annotations

import math

from plenoptic.camera.sampling.kernels.path_numbers import DEFLECTION_SET, path_indices
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.kernels.sobol import sample, set_index, set_key, stream
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.diffraction.kernels.far_field import sample_deflection
from plenoptic.optics.microlens.kernels.to_lens import at_wavelength


@device
def deflect_at_pupil(ray, i, z, by):
    """Deflect a ray by direction cosines at a plane z; its new start is its intersection with its previous start plane.

    A ray deflected by more than a right angle is lost.
    """
    t = (z - ray[Z + i]) / ray[N + i]
    x, y = ray[X + i] + t * ray[L + i], ray[Y + i] + t * ray[M + i]
    l, m = ray[L + i] + by[0], ray[M + i] + by[1]
    n = math.copysign(math.sqrt(max(1.0 - l * l - m * m, 0.0)), ray[N + i])
    if n != 0.0:
        t = (ray[Z + i] - z) / n
        ray[X + i], ray[Y + i] = x + t * l, y + t * m
        ray[L + i], ray[M + i], ray[N + i] = l, m, n
    elif ray[STATUS + i] == 0.0:
        ray[WEIGHT + i], ray[STATUS + i] = 0.0, MISSED


@kernel
def fill_iris_deflections(blocks, start, n, batch, number, waves, iris):
    """Deflect paths start ... start + n - 1 of a batch at the entrance pupil; `number`: numbers of the pixels."""
    for k in range(n):
        pixel, replicate, index = path_indices(start + k, batch.samples, batch.streams)
        key = set_key(stream(batch.seed, number[pixel], batch.first_stream + replicate), DEFLECTION_SET)
        point = set_index(batch.first_index + index, key, DEFLECTION_SET)
        wavelength = at_wavelength(iris.wavelengths, waves, k)
        by_x, by_y, _, _ = sample_deflection(iris.field, sample(point, 2, key), sample(point, 3, key))
        ray = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY]
        deflect_at_pupil(ray, k % BLOCK, iris.z, (wavelength * by_x, wavelength * by_y))
