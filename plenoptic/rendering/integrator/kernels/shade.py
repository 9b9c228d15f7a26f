"""What paths bring back from the scene: emission, direct light, and the next ray.

Rays are rows of origin and direction; `path_of` says which path of the bundle a ray belongs to, `radiance`
(paths, channels) is what each has collected so far, `throughput` (rays, channels) what of it gets through.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.sobol import mix
from plenoptic.scene.geometry.kernels.interaction import mirrors
from plenoptic.scene.geometry.kernels.intersect import corners, interpolated_uv, meet
from plenoptic.scene.lights.kernels.sample_emitters import across, fill_sky, weight
from plenoptic.scene.materials.kernels.bsdf import EXACT, draw, evaluate, one_channel
from plenoptic.scene.textures.kernels.colors import wave_of
from plenoptic.scene.textures.kernels.lookup import fill_texel

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
        if rough is not None:
            if rough[i] != 0 and drawn < 0.0:
                continue
        if k < 0:
            if background is None and suns is None and environment_texels is None:
                continue
            fill_sky(
                seen,
                rays[i, 3],
                rays[i, 4],
                rays[i, 5],
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
            t, u, v, nx, ny, nz = meet(rays, i, *corners(vertices, triangles, k, matrices, place))
            along = nx * rays[i, 3] + ny * rays[i, 4] + nz * rays[i, 5]
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


@device
def _seen(surface, i, rays, lane):
    """Two unit vectors across a surface's shading normal, and the direction to the viewer along them and it."""
    nx, ny, nz = surface[i, 6], surface[i, 7], surface[i, 8]
    ax, ay, az, bx, by, bz = across(nx, ny, nz)
    dx, dy, dz = -rays[lane, 3], -rays[lane, 4], -rays[lane, 5]
    along_a, along_b = dx * ax + dy * ay + dz * az, dx * bx + dy * by + dz * bz
    return ax, ay, az, bx, by, bz, along_a, along_b, dx * nx + dy * ny + dz * nz


@device
def _kind_of(kinds, material, surface, i, waves, path):
    """Kind, roughness, share of metal, whether the front is seen, and the wavelength; all Lambertian without kinds."""
    if kinds is None:
        return 0, 0.0, 0.0, True, wave_of(waves, path)
    return kinds[material], surface[i, 11], surface[i, 12], surface[i, 10] > 0.0, wave_of(waves, path)


@kernel
def fill_lit(
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
    """Weigh the lights that were drawn for surfaces; returns how many shadow rays there are to follow.

    `throughput` is None for rays straight from the camera, `kinds` None where all materials are Lambertian. Light that
    the ray onwards could have found too counts in part.
    """
    channels = base.shape[1]
    f = np.empty(channels)
    shadows = 0
    for i in range(material_of.size):
        bright = 0.0
        for c in range(channels):
            bright = max(bright, lit[i, c])
        if not bright > 0.0:
            continue
        material = material_of[i]
        path = path_of[lane_of[i]]
        wx, wy, wz = drawn[i, 0], drawn[i, 1], drawn[i, 2]
        ax, ay, az, bx, by, bz, ox, oy, oz = _seen(surface, i, rays, lane_of[i])
        ix, iy, iz = (
            wx * ax + wy * ay + wz * az,
            wx * bx + wy * by + wz * bz,
            wx * surface[i, 6] + wy * surface[i, 7] + wz * surface[i, 8],
        )
        beyond = wx * surface[i, 3] + wy * surface[i, 4] + wz * surface[i, 5]
        if not beyond * iz > 0.0:
            continue
        kind, roughness, metallic, front, wave = _kind_of(kinds, material, surface, i, waves, path)
        chance = evaluate(
            f,
            kind,
            base,
            i,
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
        counts = 1.0 if drawn[i, 6] < 0.0 else weight(drawn[i, 6], chance)
        if glass_index is not None:
            if iz < 0.0:
                eta = glass_index[material, 0] / glass_index[material, 1]
                counts *= 1.0 / (eta * eta) if front else eta * eta
        brightest = 0.0
        for c in range(channels):
            through = 1.0 if throughput is None else throughput[lane_of[i], c]
            shadow_radiance[shadows, c] = through * f[c] * lit[i, c] * counts
            brightest = max(brightest, shadow_radiance[shadows, c])
        if brightest > 0.0:
            _leave(shadow_rays, shadows, surface, i, beyond)
            for axis in range(3):
                shadow_rays[shadows, 3 + axis] = drawn[i, 3 + axis] - shadow_rays[shadows, axis]
            shadow_path[shadows] = path
            shadows += 1
    return shadows


@device
def _leave(out, k, surface, i, beyond):
    """Where a ray leaves a surface: off it on the side where `beyond`, its direction along the normal, is positive."""
    off = surface[i, 9] if beyond > 0.0 else -surface[i, 9]
    for axis in range(3):
        out[k, axis] = surface[i, axis] + off * surface[i, 3 + axis]


@kernel
def fill_onward(
    next_rays,
    next_path,
    next_throughput,
    next_density,
    next_from,
    surface,
    base,
    lane_of,
    material_of,
    rays,
    path_of,
    throughput,
    random,
    set_keys,
    set_indices,
    lottery,
    kinds,
    metal_index,
    glass_index,
    pane_index,
    coupling,
    coupling_mean,
    waves,
    basis,
):
    """Draw the rays onwards by what materials scatter and rows 2 and 3 of `random`; returns how many there are.

    `throughput` is None for rays straight from the camera, `kinds` None where all materials are Lambertian.
    `next_from`, where it is wanted, names the surface each ray comes from, and is negative (-1 - surface) where the ray
    has gone through it. With `lottery`, paths go on with a probability of what their surface gives back.
    """
    channels = base.shape[1]
    f = np.empty(channels)
    onwards = 0
    for i in range(material_of.size):
        material = material_of[i]
        path = path_of[lane_of[i]]
        ax, ay, az, bx, by, bz, ox, oy, oz = _seen(surface, i, rays, lane_of[i])
        kind, roughness, metallic, front, wave = _kind_of(kinds, material, surface, i, waves, path)
        key, index = set_keys[i], set_indices[i]
        lobe = 0.0
        if glass_index is not None:
            if glass_index[material, 0] > 0.0 and roughness > 0.0:
                lobe = _number(key, index, _LOBE)
        ix, iy, iz, chance, spread = draw(
            f,
            kind,
            base,
            i,
            roughness,
            metallic,
            front,
            material,
            ox,
            oy,
            oz,
            random[2, i],
            random[3, i],
            lobe,
            basis,
            wave,
            metal_index,
            glass_index,
            pane_index,
            coupling,
            coupling_mean,
        )
        wx, wy, wz = (
            ix * ax + iy * bx + iz * surface[i, 6],
            ix * ay + iy * by + iz * surface[i, 7],
            ix * az + iy * bz + iz * surface[i, 8],
        )
        beyond = wx * surface[i, 3] + wy * surface[i, 4] + wz * surface[i, 5]
        largest = 0.0
        for c in range(channels):
            largest = max(largest, f[c])
        if chance == 0.0 or beyond * iz <= 0.0 or not largest > 0.0:
            continue
        if lottery and largest < 1.0:
            if _number(key, index, _LOTTERY) >= largest:
                continue
            spread /= largest
        _leave(next_rays, onwards, surface, i, beyond)
        # A step of Newton's towards unit length, so that it stays however often a path turns.
        scale = 1.5 - 0.5 * (wx * wx + wy * wy + wz * wz)
        next_rays[onwards, 3], next_rays[onwards, 4], next_rays[onwards, 5] = wx * scale, wy * scale, wz * scale
        next_path[onwards] = path
        for c in range(channels):
            through = 1.0 if throughput is None else throughput[lane_of[i], c]
            next_throughput[onwards, c] = through * f[c] * spread
        next_density[onwards] = chance
        if next_from is not None:
            next_from[onwards] = i if beyond > 0.0 else -1 - i
        onwards += 1
    return onwards


@kernel
def fill_direct(radiance, blocked, shadow_path, shadow_radiance):
    """Add what unblocked lights contribute."""
    for i in range(shadow_path.size):
        if blocked[i] == 0:
            for c in range(radiance.shape[1]):
                radiance[shadow_path[i], c] += shadow_radiance[i, c]
