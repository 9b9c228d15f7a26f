"""Materials at interactions: base colour, roughness, metallic and shading normals, with textures."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.vectors import add, cross, dot, fill_vector, row_vector, scale, sub
from plenoptic.core.kernels.wavelengths import one_channel, row_channel, wavelength_index
from plenoptic.core.numba.jit import device, kernel
from plenoptic.scene.geometry.geometry_records import (
    FRONT,
    INTERACTION_COLUMNS,
    METALLIC,
    ROUGHNESS,
    SHADING_NORMAL,
    UV,
)
from plenoptic.scene.geometry.kernels.intersect import corners
from plenoptic.scene.textures.kernels.lookup import fill_texel


@kernel
def fill_parameters(interactions, bsdf, wavelengths):
    """Fill base colour, roughness and metallic of each interaction, as its path's channels see them."""
    rows, base_color = interactions.rows, interactions.base_color
    path, material = interactions.path, interactions.material
    colors = bsdf.base_color
    roughness = bsdf.roughness
    metallic = bsdf.metallic
    extra = bsdf.extra_shares
    waves = wavelengths.number
    basis = wavelengths.basis
    for i in range(material.size):
        wave = wavelength_index(waves, path[i])
        for c in range(base_color.shape[1]):
            base_color[i, c] = row_channel(colors, material[i], c, basis, wave)
        if roughness is not None:
            rows[i, ROUGHNESS] = roughness[material[i]]
        if metallic is not None:
            rows[i, METALLIC] = metallic[material[i]]
        if extra is not None:
            for k in range(extra.shape[1]):
                rows[i, INTERACTION_COLUMNS + k] = extra[material[i], k]


@kernel
def apply_textures(interactions, textures, channels, wavelengths):
    """Replace base colours, roughness and metallic by those of textures; `channels` is the number of the scene's."""
    rows, base_color = interactions.rows, interactions.base_color
    path, material = interactions.path, interactions.material
    waves = wavelengths.number
    basis = wavelengths.basis
    texel, number = np.empty(channels), np.empty(1)
    for i in range(material.size):
        s, t = rows[i, UV], rows[i, UV + 1]
        if textures.base_color is not None:
            texture = textures.base_color.row[material[i]]
            if texture >= 0:
                fill_texel(texel, textures.base_color.texels, textures.base_color.textures[texture], s, t)
                wave = wavelength_index(waves, path[i])
                for c in range(base_color.shape[1]):
                    base_color[i, c] = one_channel(texel, c, basis, wave)
        if textures.roughness is not None:
            texture = textures.roughness.row[material[i]]
            if texture >= 0:
                fill_texel(number, textures.roughness.texels, textures.roughness.textures[texture], s, t)
                rows[i, ROUGHNESS] = number[0]
        if textures.metallic is not None:
            texture = textures.metallic.row[material[i]]
            if texture >= 0:
                fill_texel(number, textures.metallic.texels, textures.metallic.textures[texture], s, t)
                rows[i, METALLIC] = number[0]
        if textures.extra_shares is not None:
            for k in range(textures.extra_shares.row.shape[1]):
                texture = textures.extra_shares.row[material[i], k]
                if texture >= 0:
                    fill_texel(number, textures.extra_shares.texels, textures.extra_shares.textures[texture], s, t)
                    rows[i, INTERACTION_COLUMNS + k] = number[0]


@kernel
def apply_normal_map(interactions, hits, rays, geometry, texture):
    """Turn shading normals as normal maps say (glTF 2.0, section 3.9.3), unless they would face away from the ray."""
    rows, ray_of, material = interactions.rows, interactions.ray, interactions.material
    vertices, triangles, uv = geometry.vertices, geometry.triangles, geometry.uv
    instance_to_world = geometry.instance_to_world
    instances = hits.instance
    texel = np.empty(3)
    for i in range(material.size):
        number = texture.row[material[i]]
        if number < 0:
            continue
        ray = ray_of[i]
        k = hits.triangle[ray]
        instance = -1 if instances is None else instances[ray]
        fill_texel(texel, texture.texels, texture.textures[number], rows[i, UV], rows[i, UV + 1])
        triangle = corners(vertices, triangles, k, instance_to_world, instance)
        side = 1.0 if rows[i, FRONT] > 0.0 else -1.0
        n = scale(row_vector(rows, i, SHADING_NORMAL), side)
        has_tangents, tangent, bitangent = _tangents(triangle, n, uv, triangles, k)
        if not has_tangents:
            continue
        x, y, z = 2.0 * texel[0] - 1.0, 2.0 * texel[1] - 1.0, 2.0 * texel[2] - 1.0
        v = add(add(scale(tangent, x), scale(bitangent, y)), scale(n, z))
        length = math.sqrt(dot(v, v))
        if not length > 0.0:
            continue
        v = (side * v[0] / length, side * v[1] / length, side * v[2] / length)
        if dot(v, row_vector(rays, ray, 3)) < 0.0:
            fill_vector(rows, i, SHADING_NORMAL, v)


@device
def _tangents(triangle, n, uv, triangles, k):
    """True if there are tangents, and the directions across a normal in which texture coordinates grow."""
    a, b, c = triangle
    p, q, r = triangles[k, 0], triangles[k, 1], triangles[k, 2]
    s1, t1, s2, t2 = uv[q, 0] - uv[p, 0], uv[q, 1] - uv[p, 1], uv[r, 0] - uv[p, 0], uv[r, 1] - uv[p, 1]
    area = s1 * t2 - s2 * t1
    e1, e2 = sub(b, a), sub(c, a)
    none = (0.0, 0.0, 0.0)
    if area == 0.0:
        return False, none, none
    # The direction in which s grows on the triangle; then perpendicular to the normal on the front.
    t = ((e1[0] * t2 - e2[0] * t1) / area, (e1[1] * t2 - e2[1] * t1) / area, (e1[2] * t2 - e2[2] * t1) / area)
    t = sub(t, scale(n, dot(t, n)))
    length = math.sqrt(dot(t, t))
    if not length > 0.0:
        return False, none, none
    t = (t[0] / length, t[1] / length, t[2] / length)
    # Texture and triangle may wind in opposite senses, and a matrix may have mirrored the triangle.
    hand = 1.0 if area * dot(cross(e1, e2), n) > 0.0 else -1.0
    return True, t, scale(cross(n, t), hand)
