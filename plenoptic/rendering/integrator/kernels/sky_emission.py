"""Radiance of the sky along rays that hit nothing."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.vectors import row_vector
from plenoptic.core.kernels.wavelengths import one_channel, wavelength_index
from plenoptic.core.numba.jit import kernel
from plenoptic.scene.lights.kernels.sky import add_suns, map_angles, map_axes, texel_at, weight
from plenoptic.scene.lights.light_records import DELTA

_STRIP = 128
"""Rays whose angles are computed by one loop, which is vectorised."""


@kernel
def add_sky(radiance, queue, hits, sky, wavelengths):
    """Add the radiance of the background, suns and environment to the paths of rays without a hit.

    What light sampling can also reach is weighted by multiple importance sampling, as in `add_emission`.
    """
    rays, path_of = queue.rays, queue.path
    throughput = queue.throughput
    pdf = queue.pdf
    rough = queue.rough
    hit = hits.triangle
    background = sky.background
    suns = sky.suns
    sun_colors = sky.sun_colors
    environment = sky.environment
    texels = environment.texels
    texel_pdf = environment.pdf
    rotation = environment.rotation
    waves = wavelengths.number
    basis = wavelengths.basis
    channels = 1
    if background is not None:
        channels = background.size
    if sun_colors is not None:
        channels = sun_colors.shape[1]
    if texels is not None:
        channels = texels.shape[2]
    color = np.empty(channels)
    ray, direction, angles = np.empty(_STRIP, np.int64), np.empty((3, _STRIP)), np.empty((2, _STRIP))
    axes = map_axes(rotation)
    i = 0
    while i < hit.size:
        count = 0
        while i < hit.size and count < _STRIP:
            ray[count] = i
            sees_sky = hit[i] < 0
            if rough is not None:
                ray_pdf = DELTA if pdf is None else pdf[i]
                sees_sky = sees_sky and (rough[i] == 0 or ray_pdf >= 0.0)
            count += 1 if sees_sky else 0
            i += 1
        if texels is not None:
            for j in range(count):
                direction[0, j], direction[1, j], direction[2, j] = row_vector(rays, ray[j], 3)
            for j in range(count):
                angles[0, j], angles[1, j] = map_angles((direction[0, j], direction[1, j], direction[2, j]), axes)
        for j in range(count):
            k = ray[j]
            ray_pdf = DELTA if pdf is None else pdf[k]
            # A constant background is not sampled directly, and counts in full.
            for c in range(channels):
                color[c] = 0.0 if background is None else background[c]
            if suns is not None:
                add_suns(color, row_vector(rays, k, 3), ray_pdf, suns, sun_colors)
            if texels is not None:
                row, column = texel_at((angles[0, j], angles[1, j]), texels.shape[0], texels.shape[1])
                counts = weight(ray_pdf, environment.probability * texel_pdf[row, column])
                for c in range(channels):
                    color[c] += counts * texels[row, column, c]
            wave = wavelength_index(waves, path_of[k])
            for c in range(radiance.shape[1]):
                radiance[path_of[k], c] += one_channel(color, c, basis, wave) * (
                    1.0 if throughput is None else throughput[k, c]
                )
