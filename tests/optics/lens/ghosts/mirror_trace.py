"""Rays that are reflected twice in a lens, traced in its own frame, where light turns back; for centred lenses."""

import numpy as np

import plenoptic as pl


def fresnel(n_from, n_to, cos_from, cos_to):
    """Reflectance of both polarisations by angles: sin(a - b) and tan(a - b) over those of a + b."""
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b = np.arccos(np.minimum(cos_from, 1.0)), np.arccos(np.minimum(cos_to, 1.0))
        oblique = 0.5 * (np.sin(a - b) ** 2 / np.sin(a + b) ** 2 + np.tan(a - b) ** 2 / np.tan(a + b) ** 2)
    return np.where(a + b > 1e-4, oblique, ((n_from - n_to) / (n_from + n_to)) ** 2)


def _meet(surface, z, p, d):
    """Intersection with a sphere or plane near its vertex by Newton's method, and its normal."""
    c = 0.0 if np.isinf(surface.radius) else 1.0 / surface.radius
    t = (z - p[:, 2]) / d[:, 2]
    for _ in range(12):
        q = p + t[:, None] * d
        x, y, w = q[:, 0], q[:, 1], q[:, 2] - z
        f = w - 0.5 * c * (x * x + y * y + w * w)
        slope = d[:, 2] - c * (x * d[:, 0] + y * d[:, 1] + w * d[:, 2])
        t = t - f / slope
    t = np.where(np.abs(f) < 1e-9, t, np.nan)  # rays that miss the sphere do not converge
    q = p + t[:, None] * d
    normal = np.column_stack([-c * q[:, 0], -c * q[:, 1], 1.0 - c * (q[:, 2] - z)])
    return q, normal / np.linalg.norm(normal, axis=1, keepdims=True)


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
        p, normal = _meet(element, vertices[k], p, d)
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
