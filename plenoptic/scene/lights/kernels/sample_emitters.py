"""Points on lights, drawn by power.

Lights are one table of triangles that emit, points, sheets, suns and the environment, with cumulative probabilities.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.sincos import turn
from plenoptic.core.kernels.vectors import add, dot, fill_vector, frame_about, row_vector, scale, sub
from plenoptic.core.kernels.wavelengths import one_channel, wavelength_index
from plenoptic.core.numba.jit import device, kernel
from plenoptic.scene.geometry.geometry_records import POINT as INTERACTION_POINT
from plenoptic.scene.geometry.kernels.intersect import interpolate_uv
from plenoptic.scene.lights.kernels.sky import sample_cdf, sample_environment
from plenoptic.scene.lights.light_records import (
    CORNER,
    DELTA,
    DIRECTION,
    EDGE_1,
    EDGE_2,
    END,
    ENVIRONMENT,
    FRONT_NORMAL,
    PDF,
    POINT,
    SHADOW_OFFSET,
    SHEET,
    SUN,
    TRIANGLE,
)
from plenoptic.scene.textures.kernels.lookup import fill_texel, opacity_at


@device
def _spot_fraction(light, w):
    """Intensity of a spot along -w, relative to that along its axis (KHR_lights_punctual)."""
    cosine = -(light.axis_x * w[0] + light.axis_y * w[1] + light.axis_z * w[2])
    if cosine >= light.cos_inner:
        return 1.0
    if cosine <= light.cos_outer:
        return 0.0
    fraction = (cosine - light.cos_outer) / (light.cos_inner - light.cos_outer)
    return fraction * fraction


@device
def _fill_triangle_sample(rows, i, point, st, area, both_sides, pdf):
    """Fill row i with the direction to a point of a triangle, s and t along its edges; returns 1 / pdf in sr.

    It returns 0 if the point does not emit towards the receiver. `area` is `Lights.areas` and a row of it, whose points
    are drawn with the probability `pdf` per mm^2.
    """
    areas, k = area
    on_edges = add(scale(row_vector(areas, k, EDGE_1), st[0]), scale(row_vector(areas, k, EDGE_2), st[1]))
    light = add(row_vector(areas, k, CORNER), on_edges)
    normal = row_vector(areas, k, FRONT_NORMAL)
    w = sub(light, point)
    r2 = dot(w, w)
    # One division: they take most of the time here.
    over_r = 1.0 / math.sqrt(r2)
    cos_light = -dot(normal, w) * over_r
    if not (cos_light > 0.0 or both_sides) or not abs(cos_light) > 0.0 or not r2 > 0.0:
        return 0.0
    fill_vector(rows, i, DIRECTION, scale(w, over_r))
    offset = areas[k, SHADOW_OFFSET]
    fill_vector(rows, i, END, add(light, scale(normal, offset if cos_light > 0.0 else -offset)))
    rows[i, PDF] = pdf * r2 / abs(cos_light)
    return 1.0 / rows[i, PDF]


@device
def _fill_point_sample(rows, i, point, light):
    """Fill row i for a point light with its intensity in this direction over the squared distance."""
    place = (light.x, light.y, light.z)
    w = sub(place, point)
    r2 = dot(w, w)
    if not r2 > 0.0:
        return 0.0
    r = math.sqrt(r2)
    w = (w[0] / r, w[1] / r, w[2] / r)
    fill_vector(rows, i, DIRECTION, w)
    fill_vector(rows, i, END, place)
    rows[i, PDF] = DELTA
    return _spot_fraction(light, w) / r2


@device
def _fill_sun_sample(rows, i, point, u, v, sun, far):
    """Fill row i for a direction of a sun's disc; 1 / density, or 1 / probability without a disc."""
    w = (sun.x, sun.y, sun.z)
    rows[i, PDF] = DELTA
    value = 1.0 / sun.pdf
    if sun.cap > 0.0:
        high = u * sun.cap
        low = math.sqrt(high * (2.0 - high))
        c, s = turn(v)
        p, q = frame_about(w)
        w = add(add(scale(w, 1.0 - high), scale(p, low * c)), scale(q, low * s))
        rows[i, PDF] = sun.pdf / (2.0 * math.pi * sun.cap)
        value = 1.0 / rows[i, PDF]
    _fill_distant_sample(rows, i, point, w, far)
    return value


@device
def _fill_sheet_sample(rows, i, point, sheet, far):
    """Fill row i for a sheet with its irradiance on a surface that faces its rays, 1 in the middle of its waist."""
    along = (sheet.along_x, sheet.along_y, sheet.along_z)
    across = (sheet.across_x, sheet.across_y, sheet.across_z)
    offset = sub(point, (sheet.x, sheet.y, sheet.z))
    s, a = dot(offset, along), dot(offset, across)
    if s < sheet.start:
        return 0.0
    width = math.hypot(sheet.waist, s * sheet.tangent)
    slope = a / width * (s * sheet.tangent / width) * sheet.tangent
    stretch = math.hypot(1.0, slope)
    w = scale(add(along, scale(across, slope)), -1.0 / stretch)
    _fill_distant_sample(rows, i, point, w, far if sheet.start == -math.inf else (s - sheet.start) * stretch)
    rows[i, PDF] = DELTA
    return sheet.waist / width * math.exp(-2.0 * (a / width) ** 2) * stretch


@device
def _fill_distant_sample(rows, i, point, w, far):
    """A direction, and the end of its shadow ray, `far` mm away."""
    fill_vector(rows, i, DIRECTION, w)
    fill_vector(rows, i, END, add(point, scale(w, far)))


@device
def _fill_row(color, colors, k):
    """Fill a colour with a row of colours."""
    for c in range(color.size):
        color[c] = colors[k, c]


@device
def _probability(cdf, k):
    """Probability with which light k is drawn."""
    return cdf[k] - (cdf[k - 1] if k > 0 else 0.0)


@kernel
def sample_emitters(drawn, interactions, geometry, emission, alpha, lights, takes_light, wavelengths):
    """Draw one light for each interaction by rows 0 and 1 of its random numbers.

    The radiance is 0 where the light shines the other way, or where the material takes no light that is drawn directly.
    """
    rows, radiance = drawn.rows, drawn.radiance
    points_at, path = interactions.rows, interactions.path
    material_of, random = interactions.material, interactions.random
    triangles, triangle_material, uv = geometry.triangles, geometry.triangle_material, geometry.uv
    emitted = emission.radiance
    two_sided = emission.two_sided
    area_pdf = emission.pdf
    glow_row = emission.texture.row
    glow_texels = emission.texture.texels
    glow_textures = emission.texture.textures
    opacity = alpha.opacity
    cutoff = alpha.cutoff
    alpha_row = alpha.texture.row
    alpha_texels = alpha.texture.texels
    alpha_textures = alpha.texture.textures
    cdf, items, areas, far = lights.cdf, lights.items, lights.areas, lights.far
    points = lights.points
    point_colors = lights.point_colors
    sheets = lights.sheets
    sheet_colors = lights.sheet_colors
    suns = lights.sky.suns
    sun_colors = lights.sky.sun_colors
    environment = lights.sky.environment
    environment_texels = environment.texels
    environment_pdf = environment.pdf
    waves = wavelengths.number
    basis = wavelengths.basis
    channels = 1
    if emitted is not None:
        channels = emitted.shape[1]
    if point_colors is not None:
        channels = point_colors.shape[1]
    if sheet_colors is not None:
        channels = sheet_colors.shape[1]
    if sun_colors is not None:
        channels = sun_colors.shape[1]
    if environment_texels is not None:
        channels = environment_texels.shape[2]
    color, number = np.empty(channels), np.empty(1)
    for i in range(material_of.size):
        for c in range(radiance.shape[1]):
            radiance[i, c] = 0.0
        if takes_light[material_of[i]] == 0:
            continue
        light, u = sample_cdf(cdf, random[0, i])
        v = random[1, i]
        point = row_vector(points_at, i, INTERACTION_POINT)
        kind = np.uint8(TRIANGLE)
        if points is not None or sheets is not None or suns is not None or environment_texels is not None:
            kind = items[light].kind
        row = items[light].row
        value = 0.0
        if emitted is not None and kind == TRIANGLE:
            source = triangle_material[row]
            # Uniform over the triangle.
            root = math.sqrt(u)
            s, t = root * (1.0 - v), root * v
            value = _fill_triangle_sample(
                rows, i, point, (s, t), (areas, light), two_sided[source] != 0, area_pdf[source]
            )
            _fill_row(color, emitted, source)
            if glow_row is not None:
                texture = glow_row[source]
                if texture >= 0:
                    tu, tv = interpolate_uv(uv, triangles, row, s, t)
                    fill_texel(color, glow_texels, glow_textures[texture], tu, tv)
            if opacity is not None:
                if opacity[source] < 1.0:
                    texture = -1 if alpha_row is None else alpha_row[source]
                    st = interpolate_uv(uv, triangles, row, s, t)
                    value *= opacity_at(
                        number, opacity[source], cutoff[source], texture, st, alpha_texels, alpha_textures
                    )
        if points is not None and kind == POINT:
            value = _fill_point_sample(rows, i, point, points[row]) / _probability(cdf, light)
            _fill_row(color, point_colors, row)
        if sheets is not None and kind == SHEET:
            value = _fill_sheet_sample(rows, i, point, sheets[row], far) / _probability(cdf, light)
            _fill_row(color, sheet_colors, row)
        if suns is not None and kind == SUN:
            value = _fill_sun_sample(rows, i, point, u, v, suns[row], far)
            _fill_row(color, sun_colors, row)
        if environment_texels is not None and kind == ENVIRONMENT:
            w, at_row, at_column = sample_environment(u, v, environment)
            _fill_distant_sample(rows, i, point, w, far)
            rows[i, PDF] = environment.probability * environment_pdf[at_row, at_column]
            value = 1.0 / rows[i, PDF] if rows[i, PDF] > 0.0 else 0.0
            _fill_row(color, environment_texels[at_row], at_column)
        if not value > 0.0:
            continue
        wave = wavelength_index(waves, path[i])
        for c in range(radiance.shape[1]):
            radiance[i, c] = one_channel(color, c, basis, wave) * value
