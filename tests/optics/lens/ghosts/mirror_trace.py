"""Rays that are reflected twice in a lens, traced in its own frame, where light turns back; for centred lenses."""

import numpy as np

import plenoptic as pl


def fresnel(n_from, n_to, cos_from, cos_to):
    """Reflectance of both polarisations by angles: sin(a - b) and tan(a - b) over those of a + b."""
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b = np.arccos(np.minimum(cos_from, 1.0)), np.arccos(np.minimum(cos_to, 1.0))
        oblique = 0.5 * (np.sin(a - b) ** 2 / np.sin(a + b) ** 2 + np.tan(a - b) ** 2 / np.tan(a + b) ** 2)
    return np.where(a + b > 1e-4, oblique, ((n_from - n_to) / (n_from + n_to)) ** 2)


def meet(surface, z, p, d):
    """Intersection with a sphere or plane near its vertex, nan where rays miss it, and its unit normal towards +z."""
    c = 0.0 if np.isinf(surface.radius) else 1.0 / surface.radius
    q = p + ((z - p[:, 2]) / d[:, 2])[:, None] * d
    slope = d[:, 2] - c * (q[:, 0] * d[:, 0] + q[:, 1] * d[:, 1])
    height = c * (q[:, 0] ** 2 + q[:, 1] ** 2)
    with np.errstate(invalid="ignore"):
        root = np.sqrt(slope**2 - c * height)
    q = q + (height / (slope + np.copysign(root, slope)))[:, None] * d
    return q, np.column_stack([-c * q[:, 0], -c * q[:, 1], 1.0 - c * (q[:, 2] - z)])


def trace(lens, p, d, turns, *, sensor=None, wavelength=587.6):
    """Points and directions behind the last element, and the light, 0 if a rim clips it.

    `turns` are the surfaces that reflect, first and second; `sensor` is (z, reflectance) of a plane that has the next
    index.
    """
    vertices, n = lens.vertices, lens.indices(wavelength)
    p, d, light = np.array(p), np.array(d), np.ones(len(p))
    last, (first, second) = len(lens.elements) - 1, turns or (None, None)
    steps = [(k, 1, False) for k in range(last + 1)]
    if turns:
        steps = [(k, 1, k == first) for k in range(first + 1)]
        steps += [(k, -1, k == second) for k in range(first - 1, second - 1, -1)]
        steps += [(k, 1, False) for k in range(second + 1, last + 1)]
    for k, way, turns_back in steps:
        if k > last:
            t = (sensor[0] - p[:, 2]) / d[:, 2]
            p, d, light = p + t[:, None] * d, d * (1.0, 1.0, -1.0), light * sensor[1]
            continue
        element = lens.elements[k]
        if not isinstance(element, pl.Surface):
            t = (vertices[k] - p[:, 2]) / d[:, 2]
            p = p + t[:, None] * d
            light = np.where(np.hypot(p[:, 0], p[:, 1]) <= element.semi_diameter, light, 0.0)
            continue
        p, normal = meet(element, vertices[k], p, d)
        light = np.where(np.hypot(p[:, 0], p[:, 1]) <= element.semi_diameter, light, 0.0)
        before, behind = (n[k], n[k + 1]) if way > 0 else (n[k + 1], n[k])
        normal = way * normal
        cos_in = np.einsum("ij,ij->i", d, normal)
        sin2 = (before / behind) ** 2 * (1.0 - cos_in**2)
        cos_out = np.sqrt(np.maximum(1.0 - sin2, 0.0))
        reflected = np.where(sin2 < 1.0, fresnel(before, behind, cos_in, cos_out), 1.0)
        if turns_back:
            light, d = light * reflected, d - 2.0 * cos_in[:, None] * normal
        else:
            light = light * np.where(sin2 < 1.0, 1.0 - reflected, 0.0)
            d = before / behind * d + (cos_out - before / behind * cos_in)[:, None] * normal
    return p, d, np.where(np.isfinite(light), light, 0.0)


def chance(lens, p, d, random, *, sensor=None, most=2, probability=0.25, wavelength=587.6):
    """Rays from behind the lens that reflect at surfaces by chance: directions and points where they leave towards the
    scene, their light over its probability, 0 without, and the number of their reflections.

    `sensor` is (z on the axis, reflectance, unit normal), or a function of points and directions that gives those of
    rays behind it and weights: paths that return to it go on by that weight. Paths of more than `most` reflections are
    given up.
    """
    n, count, index = len(lens.elements), len(p), lens.indices(wavelength)
    p, d, light, turns = np.array(p), np.array(d), np.ones(count), np.zeros(count, dtype=int)
    gap, way, active = np.full(count, n), np.full(count, -1), np.ones(count, dtype=bool)
    while active.any():
        for k in range(-1, n + 1):
            for sign in (-1, 1):
                # Rays in gap g, in front of element g, that go to the scene meet element g - 1.
                (rays,) = np.nonzero(active & (way == sign) & (gap == (k + 1 if sign < 0 else k)))
                if not len(rays):
                    continue
                if k == -1:
                    active[rays] = False
                elif k == n:
                    if sensor is None:
                        active[rays], light[rays] = False, 0.0
                        continue
                    way[rays], turns[rays] = -1, turns[rays] + 1
                    if callable(sensor):
                        p[rays], d[rays], weight = sensor(p[rays], d[rays])
                        light[rays] *= weight
                        continue
                    z, _, normal = sensor
                    with np.errstate(divide="ignore", invalid="ignore"):
                        t = ((np.array([0.0, 0.0, z]) - p[rays]) @ normal) / (d[rays] @ normal)
                    p[rays] += t[:, None] * d[rays]
                    d[rays] -= 2.0 * (d[rays] @ normal)[:, None] * normal
                    light[rays] *= sensor[1]
                else:
                    _interact(
                        lens.elements[k],
                        float(lens.vertices[k]),
                        (index[k], index[k + 1])[::sign],
                        rays,
                        sign,
                        (p, d, light, turns, gap, way),
                        random,
                        probability,
                    )
        light[turns > most] = 0.0
        light[~np.isfinite(light)] = 0.0
        active &= light > 0
    return p, d, light, turns


def _interact(element, z, indices, rays, sign, state, random, probability):
    p, d, light, turns, gap, way = state
    if not isinstance(element, pl.Surface):
        t = (z - p[rays, 2]) / d[rays, 2]
        p[rays] += t[:, None] * d[rays]
        light[rays] *= np.hypot(p[rays, 0], p[rays, 1]) <= element.semi_diameter
        gap[rays] += sign
        return
    before, behind = indices
    p[rays], normal = meet(element, z, p[rays], d[rays])
    normal = sign * normal
    light[rays] *= np.hypot(p[rays, 0], p[rays, 1]) <= element.semi_diameter
    cos_in = np.einsum("ij,ij->i", d[rays], normal)
    sin2 = (before / behind) ** 2 * (1.0 - cos_in**2)
    cos_out = np.sqrt(np.maximum(1.0 - sin2, 0.0))
    if isinstance(element.coating, pl.optics.Reflectance):
        reflectance = np.where(sin2 < 1.0, float(element.coating.reflectance[0, 0]), 1.0)
    else:
        reflectance = np.where(sin2 < 1.0, fresnel(before, behind, cos_in, cos_out), 1.0)
    turned = random.random(len(rays)) < probability
    bounced, passed = rays[turned], rays[~turned]
    d[bounced] -= 2.0 * (cos_in[:, None] * normal)[turned]
    light[bounced] *= reflectance[turned] / probability
    way[bounced], turns[bounced] = -sign, turns[bounced] + 1
    ratio = before / behind
    d[passed] = ratio * d[passed] + ((cos_out - ratio * cos_in)[:, None] * normal)[~turned]
    light[passed] *= (1.0 - reflectance[~turned]) / (1.0 - probability)
    gap[passed] += sign
