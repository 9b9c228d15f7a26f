"""What paths bring back from the scene: emission, direct light, and the next ray.

Rays are rows of origin and direction; `path_of` says which path of the bundle a ray belongs to, `radiance`
(paths, channels) is what each has collected so far, `throughput` (rays, channels) what of it gets through.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic._jit import device, kernel
from plenoptic._sobol import mix, sample
from plenoptic.scene._bsdf import EXACT, draw, evaluate, one_channel
from plenoptic.scene._colours import wave_of
from plenoptic.scene._hit import corners, interpolated_uv, meet
from plenoptic.scene._lights import across, fill_sky, weight
from plenoptic.scene._surfaces import mirrors
from plenoptic.scene._textures import fill_texel

_LOTTERY, _LOBE = np.uint64(311), np.uint64(312)
_UNIT_53 = 2.0**-53


@kernel
def fill_emitted(
    radiance,
    throughput,
    density,
    rough,
    path_of,
    hits,
    placed,
    rays,
    vertices,
    triangles,
    triangle_material,
    uv,
    matrices,
    emission,
    two_sided,
    emission_texture,
    texels,
    texture_rows,
    material_density,
    background,
    suns,
    sun_colours,
    environment_texels,
    environment_densities,
    environment_rotation,
    environment_share,
    travelled,
    waves,
    basis,
):
    """Add what the surfaces that rays meet emit, and the world where they meet nothing.

    `throughput` and `density` are None for rays straight from the camera, `emission` None where nothing emits.
    `density` is that by which the ray's direction was drawn: what could have been drawn as a light too counts in part.
    Where `rough` is given (1 for paths that a rough surface has scattered), what mirrors throw on rough surfaces does
    not count.
    """
    channels = 1
    if emission is not None:
        channels = emission.shape[1]
    if background is not None:
        channels = background.size
    if sun_colours is not None:
        channels = sun_colours.shape[1]
    if environment_texels is not None:
        channels = environment_texels.shape[2]
    seen = np.empty(channels)
    for i in range(path_of.size):
        k = hits[i]
        path = path_of[i]
        drawn = EXACT if density is None else density[i]
        ray = rays[i]
        if rough is not None:
            if rough[i] != 0 and drawn < 0.0:
                continue
        if k < 0:
            if background is None and suns is None and environment_texels is None:
                continue
            fill_sky(
                seen,
                ray[3],
                ray[4],
                ray[5],
                drawn,
                background,
                suns,
                sun_colours,
                environment_texels,
                environment_densities,
                environment_rotation,
                environment_share,
            )
        else:
            if emission is None:
                continue
            material = triangle_material[k]
            brightest = 0.0
            for c in range(channels):
                seen[c] = emission[material, c]
                brightest = max(brightest, seen[c])
            if not brightest > 0.0:
                continue
            place = -1 if placed is None else placed[i]
            t, u, v, nx, ny, nz = meet(ray, *corners(vertices, triangles, k, matrices, place))
            along = nx * ray[3] + ny * ray[4] + nz * ray[5]
            front = along < 0.0
            if matrices is not None:
                if place >= 0 and mirrors(matrices[place]):
                    front = not front
            if (not front and two_sided[material] == 0) or not t > 0.0:
                continue
            if emission_texture is not None:
                texture = emission_texture[material]
                if texture >= 0:
                    tu, tv = interpolated_uv(uv, triangles, k, u, v)
                    fill_texel(seen, texels, texture_rows[texture], tu, tv)
            if material_density is not None and drawn > 0.0:
                far = t if travelled is None else t + travelled[i]
                cosine = abs(along) / math.sqrt(nx * nx + ny * ny + nz * nz)
                counts = weight(drawn, material_density[material] * far * far / cosine)
                for c in range(channels):
                    seen[c] *= counts
        wave = wave_of(waves, path)
        for c in range(radiance.shape[1]):
            radiance[path, c] += one_channel(seen, c, basis, wave) * (1.0 if throughput is None else throughput[i, c])


@device
def _number(key, index, salt):
    """A random number in [0, 1) beside those of the Sobol points."""
    return np.float64(mix(mix(key, salt), np.uint64(index)) >> np.uint64(11)) * _UNIT_53


@kernel
def fill_scattered(
    next_rays,
    next_path,
    next_throughput,
    next_density,
    next_from,
    shadow_rays,
    shadow_path,
    shadow_radiance,
    surface,
    base,
    lane_of,
    material_of,
    rays,
    path_of,
    throughput,
    set_keys,
    set_indices,
    lottery,
    kinds,
    metal_index,
    glass_index,
    pane_index,
    coupling,
    coupling_mean,
    drawn,
    lit,
    waves,
    basis,
):
    """Weigh the lights that were drawn and draw the rays onwards; returns how many shadow rays and rays there are.

    `next_rays` is None where none are wanted, `drawn` None where there are no lights, `throughput` None for rays
    straight from the camera, `kinds` None where all materials are Lambertian. `next_from` names the surface each ray
    comes from, and is negative (-1 - surface) where the ray has gone through it. With `lottery`, paths go on with a
    probability of what their surface gives back.
    """
    channels = base.shape[1]
    f = np.empty(channels)
    shadows = 0
    onwards = 0
    for i in range(material_of.size):
        row, ray, material = surface[i], rays[lane_of[i]], material_of[i]
        path = path_of[lane_of[i]]
        gx, gy, gz, nx, ny, nz = row[3], row[4], row[5], row[6], row[7], row[8]
        ax, ay, az, bx, by, bz = across(nx, ny, nz)
        dx, dy, dz = -ray[3], -ray[4], -ray[5]
        ox, oy, oz = dx * ax + dy * ay + dz * az, dx * bx + dy * by + dz * bz, dx * nx + dy * ny + dz * nz
        kind = 0
        roughness, metallic, front, wave = 0.0, 0.0, True, 0
        if kinds is not None:
            kind = kinds[material]
            roughness, metallic, front = row[12], row[13], row[11] > 0.0
            wave = wave_of(waves, path)
        if drawn is not None:
            light, bright = drawn[i], 0.0
            for c in range(channels):
                bright = max(bright, lit[i, c])
            if bright > 0.0:
                wx, wy, wz = light[0], light[1], light[2]
                ix, iy, iz = wx * ax + wy * ay + wz * az, wx * bx + wy * by + wz * bz, wx * nx + wy * ny + wz * nz
                beyond = wx * gx + wy * gy + wz * gz
                if beyond * iz > 0.0:
                    chance = evaluate(
                        f,
                        kind,
                        base[i],
                        roughness,
                        metallic,
                        front,
                        material,
                        ox,
                        oy,
                        oz,
                        ix,
                        iy,
                        iz,
                        basis,
                        wave,
                        metal_index,
                        glass_index,
                        coupling,
                        coupling_mean,
                    )
                    counts = 1.0 if light[6] < 0.0 else weight(light[6], chance)
                    spread = 1.0
                    if glass_index is not None:
                        if iz < 0.0:
                            eta = glass_index[material, 0] / glass_index[material, 1]
                            spread = 1.0 / (eta * eta) if front else eta * eta
                    brightest = 0.0
                    for c in range(channels):
                        through = 1.0 if throughput is None else throughput[lane_of[i], c]
                        shadow_radiance[shadows, c] = through * f[c] * lit[i, c] * counts * spread
                        brightest = max(brightest, shadow_radiance[shadows, c])
                    if brightest > 0.0:
                        off = row[9] if beyond > 0.0 else -row[9]
                        qx, qy, qz = row[0] + off * gx, row[1] + off * gy, row[2] + off * gz
                        out = shadow_rays[shadows]
                        out[0], out[1], out[2] = qx, qy, qz
                        out[3], out[4], out[5] = light[3] - qx, light[4] - qy, light[5] - qz
                        shadow_path[shadows] = path
                        shadows += 1
        if next_rays is not None:
            key, index = set_keys[i], set_indices[i]
            lobe = 0.0
            if glass_index is not None:
                if glass_index[material, 0] > 0.0 and roughness > 0.0:
                    lobe = _number(key, index, _LOBE)
            ix, iy, iz, chance, spread = draw(
                f,
                kind,
                base[i],
                roughness,
                metallic,
                front,
                material,
                ox,
                oy,
                oz,
                sample(index, 2, key),
                sample(index, 3, key),
                lobe,
                basis,
                wave,
                metal_index,
                glass_index,
                pane_index,
                coupling,
                coupling_mean,
            )
            wx, wy, wz = ix * ax + iy * bx + iz * nx, ix * ay + iy * by + iz * ny, ix * az + iy * bz + iz * nz
            beyond = wx * gx + wy * gy + wz * gz
            largest = 0.0
            for c in range(channels):
                largest = max(largest, f[c])
            if chance == 0.0 or beyond * iz <= 0.0 or not largest > 0.0:
                continue
            if lottery and largest < 1.0:
                if _number(key, index, _LOTTERY) >= largest:
                    continue
                spread /= largest
            off = row[9] if beyond > 0.0 else -row[9]
            # Rays stay at unit length however often they turn.
            scale = 1.0 / math.sqrt(wx * wx + wy * wy + wz * wz)
            out = next_rays[onwards]
            out[0], out[1], out[2] = row[0] + off * gx, row[1] + off * gy, row[2] + off * gz
            out[3], out[4], out[5] = wx * scale, wy * scale, wz * scale
            next_path[onwards] = path
            for c in range(channels):
                through = 1.0 if throughput is None else throughput[lane_of[i], c]
                next_throughput[onwards, c] = through * f[c] * spread
            if next_density is not None:
                next_density[onwards] = chance
            if next_from is not None:
                next_from[onwards] = i if beyond > 0.0 else -1 - i
            onwards += 1
    return shadows, onwards


@kernel
def fill_direct(radiance, blocked, shadow_path, shadow_radiance):
    """Add what unblocked lights contribute."""
    for i in range(shadow_path.size):
        if blocked[i] == 0:
            for c in range(radiance.shape[1]):
                radiance[shadow_path[i], c] += shadow_radiance[i, c]
