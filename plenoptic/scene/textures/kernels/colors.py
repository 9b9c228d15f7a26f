"""Colours of the surfaces that rays have met: kernels and device functions."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.scene.geometry.kernels.intersect import corners, interpolated_uv
from plenoptic.scene.materials.kernels.bsdf import one_channel, row_channel
from plenoptic.scene.textures.kernels.lookup import fill_texel


@device
def wave_of(waves, path):
    return 0 if waves is None else waves[path]


@kernel
def fill_base(base, lane_of, material_of, path_of, albedo, waves, basis):
    """Fill the base colour of each surface, as its path's channels see it."""
    for i in range(material_of.size):
        wave = wave_of(waves, path_of[lane_of[i]])
        for c in range(base.shape[1]):
            base[i, c] = row_channel(albedo, material_of[i], c, basis, wave)


@kernel
def fill_textured(
    base,
    surface,
    lane_of,
    material_of,
    path_of,
    channels,
    base_texture,
    roughness_texture,
    metallic_texture,
    texels,
    texture_rows,
    waves,
    basis,
):
    """Replace base colours, roughness and metallic by what textures say; `channels` is the number of the scene's."""
    texel, share = np.empty(channels), np.empty(1)
    for i in range(material_of.size):
        material = material_of[i]
        if base_texture is not None:
            texture = base_texture[material]
            if texture >= 0:
                fill_texel(texel, texels, texture_rows[texture], surface[i, 13], surface[i, 14])
                wave = wave_of(waves, path_of[lane_of[i]])
                for c in range(base.shape[1]):
                    base[i, c] = one_channel(texel, c, basis, wave)
        if roughness_texture is not None:
            texture = roughness_texture[material]
            if texture >= 0:
                fill_texel(share, texels, texture_rows[texture], surface[i, 13], surface[i, 14])
                surface[i, 11] = share[0]
        if metallic_texture is not None:
            texture = metallic_texture[material]
            if texture >= 0:
                fill_texel(share, texels, texture_rows[texture], surface[i, 13], surface[i, 14])
                surface[i, 12] = share[0]


@kernel
def fill_bent(
    surface,
    lane_of,
    material_of,
    hits,
    placed,
    rays,
    vertices,
    triangles,
    uv,
    matrices,
    normal_texture,
    texels,
    texture_rows,
):
    """Turn shading normals as normal maps say (glTF 2.0, section 3.9.3), unless they would face away from the ray."""
    bent = np.empty(3)
    for i in range(material_of.size):
        texture = normal_texture[material_of[i]]
        if texture < 0:
            continue
        lane = lane_of[i]
        row, ray, k = surface[i], rays[lane], hits[lane]
        place = -1 if placed is None else placed[lane]
        fill_texel(bent, texels, texture_rows[texture], row[13], row[14])
        ax, ay, az, bx, by, bz, cx, cy, cz = corners(vertices, triangles, k, matrices, place)
        p, q, r = uv[triangles[k, 0]], uv[triangles[k, 1]], uv[triangles[k, 2]]
        s1, t1, s2, t2 = q[0] - p[0], q[1] - p[1], r[0] - p[0], r[1] - p[1]
        area = s1 * t2 - s2 * t1
        if area == 0.0:
            continue
        # The direction in which s grows on the triangle; then perpendicular to the normal on the front.
        tx = ((bx - ax) * t2 - (cx - ax) * t1) / area
        ty = ((by - ay) * t2 - (cy - ay) * t1) / area
        tz = ((bz - az) * t2 - (cz - az) * t1) / area
        side = 1.0 if row[10] > 0.0 else -1.0
        nx, ny, nz = side * row[6], side * row[7], side * row[8]
        along = tx * nx + ty * ny + tz * nz
        tx, ty, tz = tx - along * nx, ty - along * ny, tz - along * nz
        length = math.sqrt(tx * tx + ty * ty + tz * tz)
        if not length > 0.0:
            continue
        tx, ty, tz = tx / length, ty / length, tz / length
        gx = (by - ay) * (cz - az) - (bz - az) * (cy - ay)
        gy = (bz - az) * (cx - ax) - (bx - ax) * (cz - az)
        gz = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        # Texture and triangle may wind in opposite senses, and a matrix may have mirrored the triangle.
        hand = 1.0 if area * (gx * nx + gy * ny + gz * nz) > 0.0 else -1.0
        ux, uy, uz = hand * (ny * tz - nz * ty), hand * (nz * tx - nx * tz), hand * (nx * ty - ny * tx)
        x, y, z = 2.0 * bent[0] - 1.0, 2.0 * bent[1] - 1.0, 2.0 * bent[2] - 1.0
        vx, vy, vz = x * tx + y * ux + z * nx, x * ty + y * uy + z * ny, x * tz + y * uz + z * nz
        length = math.sqrt(vx * vx + vy * vy + vz * vz)
        if not length > 0.0:
            continue
        vx, vy, vz = side * vx / length, side * vy / length, side * vz / length
        if vx * ray[3] + vy * ray[4] + vz * ray[5] < 0.0:
            row[6], row[7], row[8] = vx, vy, vz


@device
def opacity_at(share, material, k, u, v, triangles, uv, opacity, cutoff, opacity_texture, texels, texture_rows):
    """Share of paths for which triangle k is there; 0 or 1 with a cutoff."""
    share[0] = opacity[material]
    if opacity_texture is not None:
        texture = opacity_texture[material]
        if texture >= 0:
            s, t = interpolated_uv(uv, triangles, k, u, v)
            fill_texel(share, texels, texture_rows[texture], s, t)
    if cutoff[material] >= 0.0:
        return 1.0 if share[0] >= cutoff[material] else 0.0
    return share[0]
