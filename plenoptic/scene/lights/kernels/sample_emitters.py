"""Points on lights, drawn by power: kernels and device functions.

Lights are one table: each item is a triangle that emits, a point, a sun or the environment, with a cumulative
probability. Its columns are those of `light_tables`; kinds that a scene has not are None.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.sincos import turn
from plenoptic.scene.geometry.kernels.interaction import mirrors
from plenoptic.scene.geometry.kernels.intersect import clearance, corners, interpolated_uv, reach_of
from plenoptic.scene.lights.kernels.environment import draw_environment, environment_texel
from plenoptic.scene.lights.kernels.sample_cdf import choose
from plenoptic.scene.lights.record import ENVIRONMENT, POINT, SUN, TRIANGLE
from plenoptic.scene.materials.kernels.bsdf import one_channel
from plenoptic.scene.textures.kernels.colors import opacity_at, wave_of
from plenoptic.scene.textures.kernels.lookup import fill_texel

WIDTH = 7
"""Numbers of a drawn light: unit direction to it, the point at which its shadow ray ends, the density."""
ALONE = -1.0
"""The density of light that comes from one direction only: that of a point, or of a sun without extent."""


@device
def across(nx, ny, nz):
    """Two unit vectors across a unit normal (T. Duff et al., J. Comput. Graph. Tech. 6(1), 2017)."""
    sign = math.copysign(1.0, nz)
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@device
def spot_share(sx, sy, sz, wx, wy, wz, cos_outer, cos_inner):
    """What a spot sends along -w, of what it sends along its axis s (KHR_lights_punctual)."""
    cosine = -(sx * wx + sy * wy + sz * wz)
    if cosine >= cos_inner:
        return 1.0
    if cosine <= cos_outer:
        return 0.0
    share = (cosine - cos_outer) / (cos_inner - cos_outer)
    return share * share


@device
def _to_triangle(drawn, i, px, py, pz, u, v, k, place, shines_back, density, vertices, triangles, matrices, middle):
    """Fill row i of `drawn` for a point of a triangle; 1 / density per sr, 0 where it shines away, and the point."""
    ax, ay, az, bx, by, bz, cx, cy, cz = corners(vertices, triangles, k, matrices, place)
    # Uniform over the triangle.
    root = math.sqrt(u)
    s, t = root * (1.0 - v), root * v
    e1x, e1y, e1z = bx - ax, by - ay, bz - az
    e2x, e2y, e2z = cx - ax, cy - ay, cz - az
    hx, hy, hz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    lx, ly, lz = ax + s * e1x + t * e2x, ay + s * e1y + t * e2y, az + s * e1z + t * e2z
    wx, wy, wz = lx - px, ly - py, lz - pz
    r2 = wx * wx + wy * wy + wz * wz
    # One division each: they take most of the time here.
    over_r, over_area = 1.0 / math.sqrt(r2), 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
    at_light = -(hx * wx + hy * wy + hz * wz) * over_area * over_r
    facing = 1.0 if at_light > 0.0 else -1.0
    front = facing > 0.0
    if matrices is not None:
        if place >= 0 and mirrors(matrices[place]):
            front = not front
    if not (front or shines_back) or not abs(at_light) > 0.0 or not r2 > 0.0:
        return 0.0, s, t
    over_area *= facing
    hx, hy, hz = hx * over_area, hy * over_area, hz * over_area
    reach = reach_of(matrices, place)
    off = clearance(lx, ly, lz, hx, hy, hz, ax, ay, az, bx, by, bz, cx, cy, cz, middle, reach)
    drawn[i, 0], drawn[i, 1], drawn[i, 2] = wx * over_r, wy * over_r, wz * over_r
    drawn[i, 3], drawn[i, 4], drawn[i, 5] = lx + off * hx, ly + off * hy, lz + off * hz
    drawn[i, 6] = density * r2 / abs(at_light)
    return 1.0 / drawn[i, 6], s, t


@device
def _to_point(drawn, i, px, py, pz, lamp):
    """Fill row i of `drawn` for a point light; what it sends here of its intensity, over the squared distance."""
    wx, wy, wz = lamp.x - px, lamp.y - py, lamp.z - pz
    r2 = wx * wx + wy * wy + wz * wz
    if not r2 > 0.0:
        return 0.0
    r = math.sqrt(r2)
    wx, wy, wz = wx / r, wy / r, wz / r
    drawn[i, 0], drawn[i, 1], drawn[i, 2], drawn[i, 3], drawn[i, 4], drawn[i, 5] = wx, wy, wz, lamp.x, lamp.y, lamp.z
    drawn[i, 6] = ALONE
    return spot_share(lamp.axis_x, lamp.axis_y, lamp.axis_z, wx, wy, wz, lamp.cos_outer, lamp.cos_inner) / r2


@device
def _to_sun(drawn, i, px, py, pz, u, v, sun, far):
    """Fill row i of `drawn` for a direction of a sun's disc; 1 / density, or 1 / probability without a disc."""
    wx, wy, wz = sun.x, sun.y, sun.z
    drawn[i, 6] = ALONE
    value = 1.0 / sun.pdf
    if sun.cap > 0.0:
        # sun.cap is 1 - cosine of the angular radius.
        high = u * sun.cap
        low = math.sqrt(high * (2.0 - high))
        c, s = turn(v)
        a, b, up = low * c, low * s, 1.0 - high
        x1, y1, z1, x2, y2, z2 = across(wx, wy, wz)
        wx, wy, wz = up * wx + a * x1 + b * x2, up * wy + a * y1 + b * y2, up * wz + a * z1 + b * z2
        drawn[i, 6] = sun.pdf / (2.0 * math.pi * sun.cap)
        value = 1.0 / drawn[i, 6]
    _send_far(drawn, i, px, py, pz, wx, wy, wz, far)
    return value


@device
def _send_far(drawn, i, px, py, pz, wx, wy, wz, far):
    """A direction, and an end of its shadow ray beyond the scene."""
    drawn[i, 0], drawn[i, 1], drawn[i, 2] = wx, wy, wz
    drawn[i, 3], drawn[i, 4], drawn[i, 5] = px + far * wx, py + far * wy, pz + far * wz


@kernel
def fill_drawn_lights(
    drawn,
    lit,
    surface,
    lane_of,
    material_of,
    takes_light,
    path_of,
    random,
    vertices,
    triangles,
    triangle_material,
    uv,
    matrices,
    middle,
    channels,
    emission,
    two_sided,
    emission_texture,
    opacity,
    cutoff,
    opacity_texture,
    texels,
    texture_rows,
    light_cdf,
    items,
    material_density,
    points,
    point_colours,
    suns,
    sun_colours,
    environment_texels,
    environment_rows,
    environment_columns,
    environment_densities,
    environment_rotation,
    environment_share,
    far,
    waves,
    basis,
):
    """Draw one light for each surface by rows 0 and 1 of `random`; `lit` is its radiance over its density.

    0 where the light shines the other way, or where the material takes no light that is drawn directly. For lights from
    one direction only, `lit` is their irradiance over the probability, and the density ALONE. `light_kind` and what
    belongs to kinds is None where all lights are triangles. `channels` is the number of the scene's.
    """
    colour, share = np.empty(channels), np.empty(1)
    for i in range(material_of.size):
        for c in range(lit.shape[1]):
            lit[i, c] = 0.0
        if takes_light[material_of[i]] == 0:
            continue
        path = path_of[lane_of[i]]
        light, u = choose(light_cdf, random[0, i])
        v = random[1, i]
        px, py, pz = surface[i, 0], surface[i, 1], surface[i, 2]
        kind = TRIANGLE
        if points is not None or suns is not None or environment_texels is not None:
            kind = items[light].kind
        value = 0.0
        if emission is not None and kind == TRIANGLE:
            k = items[light].row
            place = -1 if matrices is None else items[light].instance
            source = triangle_material[k]
            shines_back = two_sided[source] != 0
            density = material_density[source]
            value, s, t = _to_triangle(
                drawn, i, px, py, pz, u, v, k, place, shines_back, density, vertices, triangles, matrices, middle
            )
            for c in range(colour.size):
                colour[c] = emission[source, c]
            if emission_texture is not None:
                texture = emission_texture[source]
                if texture >= 0:
                    tu, tv = interpolated_uv(uv, triangles, k, s, t)
                    fill_texel(colour, texels, texture_rows[texture], tu, tv)
            if opacity is not None:
                if opacity[source] < 1.0:
                    value *= opacity_at(
                        share, source, k, s, t, triangles, uv, opacity, cutoff, opacity_texture, texels, texture_rows
                    )
        if points is not None and kind == POINT:
            chance = light_cdf[light] - (light_cdf[light - 1] if light > 0 else 0.0)
            value = _to_point(drawn, i, px, py, pz, points[items[light].row]) / chance
            for c in range(colour.size):
                colour[c] = point_colours[items[light].row, c]
        if suns is not None and kind == SUN:
            value = _to_sun(drawn, i, px, py, pz, u, v, suns[items[light].row], far)
            for c in range(colour.size):
                colour[c] = sun_colours[items[light].row, c]
        if environment_texels is not None and kind == ENVIRONMENT:
            wx, wy, wz, r0, c0 = draw_environment(u, v, environment_rows, environment_columns, environment_rotation)
            _send_far(drawn, i, px, py, pz, wx, wy, wz, far)
            drawn[i, 6] = environment_share * environment_densities[r0, c0]
            value = 1.0 / drawn[i, 6] if drawn[i, 6] > 0.0 else 0.0
            for c in range(colour.size):
                colour[c] = environment_texels[r0, c0, c]
        if not value > 0.0:
            continue
        wave = wave_of(waves, path)
        for c in range(lit.shape[1]):
            lit[i, c] = one_channel(colour, c, basis, wave) * value


@device
def weight(density, other):
    """How much a direction counts that was drawn by `density` and could have been by `other` (power heuristic)."""
    if density < 0.0 or other <= 0.0:
        return 1.0
    if not density > 0.0:
        return 0.0
    ratio = other / density
    return 1.0 / (1.0 + ratio * ratio)


@device
def fill_sky(
    colour,
    dx,
    dy,
    dz,
    density,
    background,
    suns,
    sun_colours,
    environment_texels,
    environment_densities,
    environment_rotation,
    environment_share,
):
    """Fill `colour` with what a ray sees that meets nothing.

    `density` is that of its direction, ALONE if it is certain. A constant background is not drawn directly, and counts
    in full.
    """
    for c in range(colour.size):
        colour[c] = 0.0 if background is None else background[c]
    if suns is not None:
        for s in range(suns.shape[0]):
            sun = suns[s]
            if sun.cap > 0.0:
                x, y, z = dx - sun.x, dy - sun.y, dz - sun.z
                # |d - s|^2 = 2 (1 - cos), without the cancellation of 1 - cos.
                if 0.5 * (x * x + y * y + z * z) < sun.cap:
                    counts = weight(density, sun.pdf / (2.0 * math.pi * sun.cap))
                    for c in range(colour.size):
                        colour[c] += counts * sun_colours[s, c]
    if environment_texels is not None:
        row, column = environment_texel(
            dx, dy, dz, environment_texels.shape[0], environment_texels.shape[1], environment_rotation
        )
        counts = weight(density, environment_share * environment_densities[row, column])
        for c in range(colour.size):
            colour[c] += counts * environment_texels[row, column, c]
