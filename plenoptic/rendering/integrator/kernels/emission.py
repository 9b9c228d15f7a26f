"""Emission at the hits of rays."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.vectors import dot, row_vector
from plenoptic.core.kernels.wavelengths import one_channel, wavelength_index
from plenoptic.core.numba.jit import kernel
from plenoptic.scene.geometry.kernels.intersect import corners, interpolate_uv, intersect_triangle, is_reflection
from plenoptic.scene.lights.kernels.sky import weight
from plenoptic.scene.lights.light_records import DELTA
from plenoptic.scene.textures.kernels.lookup import fill_texel


@kernel
def add_emission(radiance, queue, hits, geometry, emission, wavelengths):
    """Add the emission of the surfaces that rays hit.

    `queue.pdf` is the density by which a ray's direction was sampled, None for rays from the camera: emission that
    light sampling can also reach is weighted by multiple importance sampling. With `queue.rough` (1 for paths scattered
    by a rough surface), specular paths from rough surfaces to lights (caustics) do not count.
    """
    rays, path_of = queue.rays, queue.path
    throughput = queue.throughput
    pdf = queue.pdf
    rough = queue.rough
    hit = hits.triangle
    instances = hits.instance
    travelled = hits.travelled
    vertices = geometry.vertices
    triangles = geometry.triangles
    triangle_material = geometry.triangle_material
    instance_to_world = geometry.instance_to_world
    uv = geometry.uv
    emitted = emission.radiance
    two_sided = emission.two_sided
    area_pdf = emission.pdf
    texture_row = emission.texture.row
    texels = emission.texture.texels
    textures = emission.texture.textures
    waves = wavelengths.number
    basis = wavelengths.basis
    channels = emitted.shape[1]
    emission_at_hit = np.empty(channels)
    for i in range(hit.size):
        k = hit[i]
        if k < 0:
            continue
        path = path_of[i]
        ray_pdf = DELTA if pdf is None else pdf[i]
        if rough is not None:
            if rough[i] != 0 and ray_pdf < 0.0:
                continue
        material = triangle_material[k]
        brightest = 0.0
        for c in range(channels):
            emission_at_hit[c] = emitted[material, c]
            brightest = max(brightest, emission_at_hit[c])
        if not brightest > 0.0:
            continue
        direction = row_vector(rays, i, 3)
        instance = -1 if instances is None else instances[i]
        triangle = corners(vertices, triangles, k, instance_to_world, instance)
        t, u, v, normal = intersect_triangle(row_vector(rays, i, 0), direction, triangle)
        normal_component = dot(normal, direction)
        front = (normal_component < 0.0) != is_reflection(instance_to_world, instance)
        if (not front and two_sided[material] == 0) or not t > 0.0:
            continue
        if texture_row is not None:
            texture = texture_row[material]
            if texture >= 0:
                tu, tv = interpolate_uv(uv, triangles, k, u, v)
                fill_texel(emission_at_hit, texels, textures[texture], tu, tv)
        if area_pdf is not None and ray_pdf > 0.0:
            path_length = t if travelled is None else t + travelled[i]
            cosine = abs(normal_component) / math.sqrt(dot(normal, normal))
            mis_weight = weight(ray_pdf, area_pdf[material] * path_length * path_length / cosine)
            for c in range(channels):
                emission_at_hit[c] *= mis_weight
        wave = wavelength_index(waves, path)
        for c in range(radiance.shape[1]):
            radiance[path, c] += one_channel(emission_at_hit, c, basis, wave) * (
                1.0 if throughput is None else throughput[i, c]
            )
