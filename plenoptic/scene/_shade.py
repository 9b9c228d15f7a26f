"""What paths bring back from the scene: emission, direct light, and the next ray.

Rays are rows of origin and direction; `path_of` says which path of the bundle a ray belongs to, `radiance`
(paths, channels) is what each has collected so far, `throughput` (rays, channels) what of it gets through.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic._jit import device, kernel
from plenoptic._sobol import sample, set_index, set_key
from plenoptic.scene._hit import clearance, distance_and_facing, interpolated_normal, meet, texel_weights
from plenoptic.scene._lights import choose, point_on_triangle


@device
def _channel(colour, c, basis, wave):
    """Channel c of a colour of the scene or, with a basis (wavelengths, 3), what the colour is at a wavelength."""
    if basis is None or colour.size == 1:
        return colour[c]
    return colour[0] * basis[wave, 0] + colour[1] * basis[wave, 1] + colour[2] * basis[wave, 2]


@device
def _wave(waves, path):
    return 0 if waves is None else waves[path]


@kernel
def fill_emitted(
    radiance,
    throughput,
    path_of,
    hits,
    rays,
    vertices,
    triangles,
    triangle_material,
    emission,
    two_sided,
    background,
    waves,
    basis,
):
    """Add what the surfaces that rays meet emit, and the background where they meet nothing.

    `throughput` is None for rays straight from the camera, `emission` None where nothing emits or
    lights are drawn directly instead, `background` None where the world is black. With a `basis`, paths have one
    channel each, at the wavelength that `waves` names.
    """
    for i in range(path_of.size):
        k = hits[i]
        path = path_of[i]
        if k < 0:
            if background is not None:
                for c in range(radiance.shape[1]):
                    seen_there = _channel(background, c, basis, _wave(waves, path))
                    radiance[path, c] += seen_there * (1.0 if throughput is None else throughput[i, c])
        elif emission is not None:
            material = triangle_material[k]
            seen = two_sided[material] != 0
            if not seen:
                _, seen = distance_and_facing(rays[i], vertices, triangles, k)
            if seen:
                for c in range(radiance.shape[1]):
                    emitted = _channel(emission[material], c, basis, _wave(waves, path))
                    radiance[path, c] += emitted * (1.0 if throughput is None else throughput[i, c])


@device
def _across(nx, ny, nz):
    """Two unit vectors across a unit normal (T. Duff et al., J. Comput. Graph. Tech. 6(1), 2017)."""
    sign = math.copysign(1.0, nz)
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@device
def _fill_albedo(
    colour, texel, k, u, v, albedo, material, triangles, uv, material_texture, texels, texture_shape, basis, wave
):
    """Fill `colour` (channels,) with the albedo at a hit; returns its largest channel. `texel` is room for one."""
    largest = 0.0
    for c in range(colour.shape[0]):
        colour[c] = _channel(albedo, c, basis, wave)
    if texels is not None:
        row = material_texture[material]
        if row >= 0:
            p00, p01, p10, p11, fx, fy = texel_weights(uv, triangles, k, u, v, texture_shape[row])
            for c in range(texels.shape[1]):
                top = texels[p00, c] + fx * (texels[p01, c] - texels[p00, c])
                bottom = texels[p10, c] + fx * (texels[p11, c] - texels[p10, c])
                texel[c] = top + fy * (bottom - top)
            for c in range(colour.shape[0]):
                colour[c] = _channel(texel, c, basis, wave)
    for c in range(colour.shape[0]):
        largest = max(largest, colour[c])
    return largest


@kernel
def fill_scattered(
    next_rays,
    next_path,
    next_throughput,
    shadow_rays,
    shadow_path,
    shadow_radiance,
    hits,
    rays,
    path_of,
    throughput,
    path_key,
    path_index,
    bounce,
    vertices,
    triangles,
    triangle_material,
    normals,
    uv,
    albedo,
    material_texture,
    texels,
    texture_shape,
    emission,
    two_sided,
    light_triangles,
    light_cdf,
    light_area_pdf,
    middle,
    waves,
    basis,
):
    """Lambertian scattering: one shadow ray towards a light and one ray onwards for each ray that hits.

    Returns the numbers of shadow rays and of rays onwards. `next_rays` is None where none are wanted,
    `light_triangles` None where there are no lights, `throughput` None for rays straight from the camera.
    Direct light is emission albedo / pi cos cos / distance^2 / density; a ray onwards is drawn by its cosine, so that
    its weight is the albedo. Secondary rays start in front of the surface by the clearance that float32 needs; direct
    light's geometry is that of the hit itself.
    """
    channels = shadow_radiance.shape[1]
    colour, texel = np.empty(channels), np.empty(albedo.shape[1])
    shadows = 0
    onwards = 0
    for i in range(path_of.size):
        k = hits[i]
        if k < 0:
            continue
        material = triangle_material[k]
        ray = rays[i]
        t, u, v, gx, gy, gz = meet(ray, vertices, triangles, k)
        if not t > 0.0 or not t < math.inf:
            continue
        wave = _wave(waves, path_of[i])
        largest = _fill_albedo(
            colour,
            texel,
            k,
            u,
            v,
            albedo[material],
            material,
            triangles,
            uv,
            material_texture,
            texels,
            texture_shape,
            basis,
            wave,
        )
        if not largest > 0.0:
            continue
        # The geometric normal towards the side that the ray comes from; the shading normal beside it.
        scale = 1.0 / math.sqrt(gx * gx + gy * gy + gz * gz)
        if gx * ray[3] + gy * ray[4] + gz * ray[5] > 0.0:
            scale = -scale
        gx, gy, gz = gx * scale, gy * scale, gz * scale
        nx, ny, nz = gx, gy, gz
        if normals is not None:
            sx, sy, sz = interpolated_normal(normals, triangles, k, u, v)
            side = 1.0 if sx * gx + sy * gy + sz * gz >= 0.0 else -1.0
            sx, sy, sz = side * sx, side * sy, side * sz
            if sx * ray[3] + sy * ray[4] + sz * ray[5] < 0.0:
                nx, ny, nz = sx, sy, sz
        px, py, pz = ray[0] + t * ray[3], ray[1] + t * ray[4], ray[2] + t * ray[5]
        off = clearance(px, py, pz, gx, gy, gz, vertices, triangles, k, middle)
        qx, qy, qz = px + off * gx, py + off * gy, pz + off * gz
        path = path_of[i]
        key = set_key(path_key[path], bounce + 1)
        index = set_index(path_index[path], key, bounce + 1)
        if light_triangles is not None:
            light, stretched = choose(light_cdf, sample(index, 0, key))
            lit = light_triangles[light]
            lx, ly, lz, hx, hy, hz = point_on_triangle(vertices, triangles, lit, stretched, sample(index, 1, key))
            wx, wy, wz = lx - px, ly - py, lz - pz
            r2 = wx * wx + wy * wy + wz * wz
            source = triangle_material[lit]
            at_light = -(hx * wx + hy * wy + hz * wz)
            facing = 1.0 if at_light > 0.0 else -1.0
            at_surface = nx * wx + ny * wy + nz * wz
            visible = (facing > 0.0 or two_sided[source] != 0) and gx * wx + gy * wy + gz * wz > 0.0
            if visible and at_surface > 0.0 and at_light != 0.0 and r2 > 0.0:
                twice_area = math.sqrt(hx * hx + hy * hy + hz * hz)
                geometry = at_surface * abs(at_light) / (twice_area * r2 * r2 * math.pi * light_area_pdf[light])
                hx, hy, hz = facing * hx / twice_area, facing * hy / twice_area, facing * hz / twice_area
                off = clearance(lx, ly, lz, hx, hy, hz, vertices, triangles, lit, middle)
                row = shadow_rays[shadows]
                row[0], row[1], row[2] = qx, qy, qz
                row[3], row[4], row[5] = lx + off * hx - qx, ly + off * hy - qy, lz + off * hz - qz
                shadow_path[shadows] = path
                for c in range(channels):
                    through = 1.0 if throughput is None else throughput[i, c]
                    emitted = _channel(emission[source], c, basis, wave)
                    shadow_radiance[shadows, c] = through * colour[c] * emitted * geometry
                shadows += 1
        if next_rays is not None:
            radius = math.sqrt(sample(index, 2, key))
            angle = 2.0 * math.pi * sample(index, 3, key)
            a, b = radius * math.cos(angle), radius * math.sin(angle)
            up = math.sqrt(max(0.0, 1.0 - radius * radius))
            ax, ay, az, bx, by, bz = _across(nx, ny, nz)
            dx, dy, dz = a * ax + b * bx + up * nx, a * ay + b * by + up * ny, a * az + b * bz + up * nz
            if dx * gx + dy * gy + dz * gz > 0.0:
                row = next_rays[onwards]
                row[0], row[1], row[2] = qx, qy, qz
                row[3], row[4], row[5] = dx, dy, dz
                next_path[onwards] = path
                for c in range(channels):
                    through = 1.0 if throughput is None else throughput[i, c]
                    next_throughput[onwards, c] = through * colour[c]
                onwards += 1
    return shadows, onwards


@kernel
def fill_direct(radiance, blocked, shadow_path, shadow_radiance):
    """Add what unblocked lights contribute."""
    for i in range(shadow_path.size):
        if blocked[i] == 0:
            for c in range(radiance.shape[1]):
                radiance[shadow_path[i], c] += shadow_radiance[i, c]


@kernel
def fill_distances(distances, hits, rays, vertices, triangles):
    """Distance along each ray to the triangle it meets, in float64 from the float64 vertices; inf without one."""
    for i in range(hits.size):
        distances[i] = math.inf
        if hits[i] >= 0:
            t, _ = distance_and_facing(rays[i], vertices, triangles, hits[i])
            if t > 0.0:
                distances[i] = t
