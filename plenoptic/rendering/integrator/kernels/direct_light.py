"""Direct light: contributions of sampled lights."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.vectors import dot, fill_vector, frame_about, negate, row_vector, sub
from plenoptic.core.kernels.wavelengths import wavelength_index
from plenoptic.core.numba.jit import kernel
from plenoptic.rendering.integrator.kernels.local_frame import leaving_point, to_local
from plenoptic.scene.geometry.geometry_records import FRONT, NORMAL, SHADING_NORMAL
from plenoptic.scene.lights.kernels.sky import weight
from plenoptic.scene.lights.light_records import DIRECTION, END, PDF
from plenoptic.scene.materials.kernels.bsdf import evaluate, surface_at
from plenoptic.scene.materials.material_records import INSIDE, OUTSIDE


@kernel
def eval_direct(shadow, interactions, drawn, queue, bsdf, wavelengths):
    """Evaluate the sampled lights at the interactions; return the number of shadow rays.

    Lights that BSDF sampling can also hit are weighted by multiple importance sampling.
    """
    shadow_rays, shadow_path, shadow_radiance = shadow.rays, shadow.path, shadow.radiance
    rows, ray_of, path_of = interactions.rows, interactions.ray, interactions.path
    material_of, base_color = interactions.material, interactions.base_color
    lights, radiance = drawn.rows, drawn.radiance
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
    n_shadow = 0
    for i in range(material_of.size):
        max_radiance = 0.0
        for c in range(channels):
            max_radiance = max(max_radiance, radiance[i, c])
        if not max_radiance > 0.0:
            continue
        material, path, ray = material_of[i], path_of[i], ray_of[i]
        normal = row_vector(rows, i, SHADING_NORMAL)
        frame = frame_about(normal)
        w = row_vector(lights, i, DIRECTION)
        to_light = to_local(w, frame, normal)
        cosine = dot(w, row_vector(rows, i, NORMAL))
        if not cosine * to_light[2] > 0.0:
            continue
        to_viewer = to_local(negate(row_vector(rays, ray, 3)), frame, normal)
        surface = surface_at(
            rows, i, material, wavelength_index(waves, path), kind, glass_index, pane_index, extra_shares
        )
        for c in range(channels):
            f[c] = base_color[i, c]
        pdf = evaluate(f, surface, to_viewer, to_light, metal_index, coupling, basis)
        mis_weight = 1.0 if lights[i, PDF] < 0.0 else weight(lights[i, PDF], pdf)
        if glass_index is not None:
            if to_light[2] < 0.0:
                eta = glass_index[material, INSIDE] / glass_index[material, OUTSIDE]
                mis_weight *= 1.0 / (eta * eta) if rows[i, FRONT] > 0.0 else eta * eta
        brightest = 0.0
        for c in range(channels):
            through = 1.0 if throughput is None else throughput[ray, c]
            shadow_radiance[n_shadow, c] = through * f[c] * radiance[i, c] * mis_weight
            brightest = max(brightest, shadow_radiance[n_shadow, c])
        if brightest > 0.0:
            origin = leaving_point(rows, i, cosine)
            fill_vector(shadow_rays, n_shadow, 0, origin)
            fill_vector(shadow_rays, n_shadow, 3, sub(row_vector(lights, i, END), origin))
            shadow_path[n_shadow] = path
            n_shadow += 1
    return n_shadow


@kernel
def add_direct(radiance, blocked, shadow):
    """Add the contributions of unblocked lights."""
    path_of, shadow_radiance = shadow.path, shadow.radiance
    for i in range(blocked.size):
        if blocked[i] == 0:
            for c in range(radiance.shape[1]):
                radiance[path_of[i], c] += shadow_radiance[i, c]
