"""The next rays of paths."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.frames import frame_about
from plenoptic.core.kernels.sobol import mix
from plenoptic.core.kernels.vectors import dot, fill_vector, negate, row_vector, scale
from plenoptic.core.kernels.wavelengths import wavelength_index
from plenoptic.core.numba.jit import device, kernel
from plenoptic.rendering.integrator.kernels.local_frame import leaving_point, to_local
from plenoptic.scene.geometry.record import NORMAL, SHADING_NORMAL
from plenoptic.scene.materials.kernels.bsdf import sample, surface_at

_ROULETTE, _LOBE = np.uint64(311), np.uint64(312)
_UNIT_53 = 2.0**-53


@device
def _number(key, index, salt):
    """A random number in [0, 1) beside those of the Sobol points."""
    return np.float64(mix(mix(key, salt), np.uint64(index)) >> np.uint64(11)) * _UNIT_53


@kernel
def sample_bsdf(onward, source, interactions, queue, bsdf, wavelengths, russian_roulette):
    """Sample scattered rays by the BSDFs and rows 2 and 3 of random numbers; returns the number of rays.

    `source`, where it is wanted, names the interaction each ray comes from, and is negative (-1 - interaction) where
    the ray has gone through it. With Russian roulette, paths go on with a probability of their surface's albedo.
    """
    next_rays, next_path, next_throughput, next_pdf = onward.rays, onward.path, onward.throughput, onward.pdf
    rows, ray_of, path_of = interactions.rows, interactions.ray, interactions.path
    material_of, base_color, random = interactions.material, interactions.base_color, interactions.random
    rays = queue.rays
    throughput = queue.throughput
    kind = bsdf.kind
    metal_index = bsdf.metal_index
    glass_index = bsdf.glass_index
    pane_index = bsdf.pane_index
    coupling = bsdf.coupling
    extra_shares = bsdf.extra_shares
    waves = wavelengths.number
    basis = wavelengths.basis
    channels = base_color.shape[1]
    f = np.empty(channels)
    onwards = 0
    for i in range(material_of.size):
        path, ray = path_of[i], ray_of[i]
        normal = row_vector(rows, i, SHADING_NORMAL)
        frame = frame_about(normal)
        to_viewer = to_local(negate(row_vector(rays, ray, 3)), frame, normal)
        surface = surface_at(
            rows, i, material_of[i], wavelength_index(waves, path), kind, glass_index, pane_index, extra_shares
        )
        key, index = interactions.key[i], interactions.number[i]
        lobe = 0.0
        if glass_index is not None:
            if surface.eta > 0.0 and surface.roughness > 0.0:
                lobe = _number(key, index, _LOBE)
        for c in range(channels):
            f[c] = base_color[i, c]
        drawn, pdf, spread = sample(
            f, surface, to_viewer, (random[2, i], random[3, i], lobe), metal_index, coupling, basis
        )
        w = (
            drawn[0] * frame[0][0] + drawn[1] * frame[1][0] + drawn[2] * normal[0],
            drawn[0] * frame[0][1] + drawn[1] * frame[1][1] + drawn[2] * normal[1],
            drawn[0] * frame[0][2] + drawn[1] * frame[1][2] + drawn[2] * normal[2],
        )
        beyond = dot(w, row_vector(rows, i, NORMAL))
        largest = 0.0
        for c in range(channels):
            largest = max(largest, f[c])
        if pdf == 0.0 or beyond * drawn[2] <= 0.0 or not largest > 0.0:
            continue
        if russian_roulette and largest < 1.0:
            if _number(key, index, _ROULETTE) >= largest:
                continue
            spread /= largest
        fill_vector(next_rays, onwards, 0, leaving_point(rows, i, beyond))
        # A step of Newton's towards unit length, so that it stays however often a path turns.
        fill_vector(next_rays, onwards, 3, scale(w, 1.5 - 0.5 * dot(w, w)))
        next_path[onwards] = path
        for c in range(channels):
            through = 1.0 if throughput is None else throughput[ray, c]
            next_throughput[onwards, c] = through * f[c] * spread
        next_pdf[onwards] = pdf
        if source is not None:
            source[onwards] = i if beyond > 0.0 else -1 - i
        onwards += 1
    return onwards
