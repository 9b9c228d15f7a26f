"""Scattering: BSDF sampling of the next rays of paths."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.sobol import random_number
from plenoptic.core.kernels.vectors import dot, fill_vector, frame_about, negate, row_vector, scale
from plenoptic.core.kernels.wavelengths import wavelength_index
from plenoptic.core.numba.jit import kernel
from plenoptic.rendering.integrator.kernels.local_frame import leaving_point, refracted_point, to_local
from plenoptic.scene.geometry.geometry_records import NORMAL, SHADING_NORMAL
from plenoptic.scene.materials.kernels.bsdf import sample, surface_at

_ROULETTE, _LOBE = np.uint64(311), np.uint64(312)


@kernel
def sample_bsdf(new, source, interactions, queue, bsdf, wavelengths, russian_roulette):
    """Sample the scattered rays from the BSDF and rows 2 and 3 of the random numbers; return their number.

    `source`, unless None, is the index of each ray's interaction; it is negative (-1 - index) for a transmitted ray.
    With Russian roulette, paths survive with the probability of their largest BSDF weight.
    """
    next_rays, next_path, next_throughput, next_pdf = (new.rays, new.path, new.throughput, new.pdf)
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
    n_rays = 0
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
                lobe = random_number(key, index, _LOBE)
        for c in range(channels):
            f[c] = base_color[i, c]
        direction, pdf, radiance_scale = sample(
            f, surface, to_viewer, (random[2, i], random[3, i], lobe), metal_index, coupling, basis
        )
        w = (
            direction[0] * frame[0][0] + direction[1] * frame[1][0] + direction[2] * normal[0],
            direction[0] * frame[0][1] + direction[1] * frame[1][1] + direction[2] * normal[1],
            direction[0] * frame[0][2] + direction[1] * frame[1][2] + direction[2] * normal[2],
        )
        cosine = dot(w, row_vector(rows, i, NORMAL))
        largest = 0.0
        for c in range(channels):
            largest = max(largest, f[c])
        if pdf == 0.0 or cosine * direction[2] <= 0.0 or not largest > 0.0:
            continue
        if russian_roulette and largest < 1.0:
            if random_number(key, index, _ROULETTE) >= largest:
                continue
            radiance_scale /= largest
        origin = leaving_point(rows, i, cosine)
        if glass_index is not None:
            if surface.eta > 0.0 and direction[2] * to_viewer[2] < 0.0:
                origin = refracted_point(rows, i, w, cosine)
        fill_vector(next_rays, n_rays, 0, origin)
        # One Newton step towards unit length, so that rounding errors do not accumulate over bounces.
        fill_vector(next_rays, n_rays, 3, scale(w, 1.5 - 0.5 * dot(w, w)))
        next_path[n_rays] = path
        for c in range(channels):
            through = 1.0 if throughput is None else throughput[ray, c]
            next_throughput[n_rays, c] = through * f[c] * radiance_scale
        next_pdf[n_rays] = pdf
        if source is not None:
            source[n_rays] = i if cosine > 0.0 else -1 - i
        n_rays += 1
    return n_rays
