"""Kernel: refraction at one sphere or plane."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import (
    BLOCK,
    CLIPPED,
    MISSED,
    NOT_FINITE,
    STATUS,
    TOTAL_REFLECTION,
    L,
    M,
    N,
    X,
    Y,
    Z,
)
from plenoptic.core.numba.jit import device

COS2, DISTANCE = 0, 1
"""Rows that `refract_sphere` stores for the losses of rays."""

UNLIMITED = math.inf, math.inf
"""Limits of a surface without rim and equator; see `refract_sphere`."""


@device
def _quotients(a, b, c, d):
    """a / b and c / d with one division; a Newton step for each restores the accuracy of two divisions."""
    inverse = 1.0 / (b * d)
    of_b, of_d = inverse * d, inverse * b
    x, y = a * of_b, c * of_d
    return x + (a - x * b) * of_b, y + (c - y * d) * of_d


@device
def refract_sphere(ray, c, index_ratio, index_ratios, limits, s, code, losses):
    """Refract rays at one sphere or plane of curvature c in 1/mm, whose vertex is the origin of the rays' z.

    The ray starts at its point closest to the vertex, so F and G suffer no cancellation on flat surfaces, tiny radii or
    distant origins. `s` is the direction of travel along the stack. `index_ratio` holds for all rays, unless
    `index_ratios` has one for each. `limits` are the squared semi-diameter and the largest c z of the surface: 1 at the
    equator. A ray whose only intersections lie deeper misses the surface. If not None, `losses` (2 or more, BLOCK) gets
    the squared cosine in the medium of the lower index, and the distance in mm to the intersection.
    """
    semi_diameter2, max_depth = limits
    for i in range(BLOCK):
        mu = index_ratio if index_ratios is None else index_ratios[i]
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        e = -(x * l + y * m + z * n)
        x += e * l
        y += e * m
        z += e * n
        f = c * (x * x + y * y + z * z) - 2.0 * z
        g = n - c * (x * l + y * m + z * n)
        q2 = g * g - c * f
        q = math.sqrt(max(q2, 0.0))
        along = s * g >= 0.0
        divisor = g + s * q if along else c
        cos2 = 1.0 - mu * mu * (1.0 - q2)
        cos_t = math.sqrt(max(cos2, 0.0))
        t, a = _quotients(f if along else g - s * q, divisor, s * (1.0 - mu * mu), cos_t + mu * q)
        if losses is not None:
            losses[COS2, i] = min(q2, cos2)
            losses[DISTANCE, i] = e + t
        x += t * l
        y += t * m
        z += t * n
        r2 = x * x + y * y
        ac = a * c
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = z
        ray[L + i] = mu * l - ac * x
        ray[M + i] = mu * m - ac * y
        ray[N + i] = mu * n + (a - ac * z)
        lost = 0.0 if cos2 >= 0.0 else code + TOTAL_REFLECTION
        lost = lost if r2 <= semi_diameter2 else code + CLIPPED
        lost = lost if r2 < math.inf else code + NOT_FINITE
        lost = code + MISSED if q2 <= 0.0 or (divisor == 0.0 and g == g) or c * z > max_depth else lost
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost
