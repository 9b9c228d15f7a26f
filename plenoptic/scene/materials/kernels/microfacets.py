"""Small mirrors whose normals have the GGX distribution, in a frame whose z is the surface's normal: device functions.

B. Walter et al., EGSR 2007; E. Heitz, J. Comput. Graph. Tech. 3(2), 48 (2014): equations by number from there.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.sincos import turn
from plenoptic.core.kernels.vectors import add, dot, scale
from plenoptic.core.numba.jit import device


@device
def distribution(h, alpha):
    """D of a normal, z > 0, per steradian (equation 84)."""
    t = (h[0] * h[0] + h[1] * h[1]) / (alpha * alpha) + h[2] * h[2]
    return 1.0 / (math.pi * alpha * alpha * t * t)


@device
def smith_lambda(w, alpha):
    """Smith's Lambda of a direction (equation 86): hidden over visible area."""
    return 0.5 * (math.sqrt(1.0 + alpha * alpha * (w[0] * w[0] + w[1] * w[1]) / (w[2] * w[2])) - 1.0)


@device
def visible_normal(w, alpha, u, v):
    """Sample a normal from those visible from a direction, z > 0 (J. Dupuy and A. Benyoub, 2023)."""
    x, y, z = alpha * w[0], alpha * w[1], w[2]
    over = 1.0 / math.sqrt(x * x + y * y + z * z)
    x, y, z = x * over, y * over, z * over
    # A point of the spherical cap that the stretched direction sees, then the normal half-way to it.
    cap = (1.0 - v) * (1.0 + z) - z
    radius = math.sqrt(max(0.0, 1.0 - cap * cap))
    c, s = turn(u)
    hx, hy, hz = alpha * (radius * c + x), alpha * (radius * s + y), cap + z
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    if not length > 0.0:
        return 0.0, 0.0, 1.0
    over = 1.0 / length
    return hx * over, hy * over, hz * over


@device
def half_way(o, i, alpha):
    """Cosine between a direction and the normal half-way between both, and D of that normal; 0 where there is none."""
    h = add(o, i)
    length = math.sqrt(dot(h, h))
    if not length > 0.0 or not h[2] > 0.0:
        return 0.0, 0.0
    h = scale(h, 1.0 / length)
    return min(dot(o, h), 1.0), distribution(h, alpha)


@device
def reflect(o, h, cosine):
    """A direction mirrored at a facet on which it falls at a cosine."""
    return 2.0 * cosine * h[0] - o[0], 2.0 * cosine * h[1] - o[1], 2.0 * cosine * h[2] - o[2]


@device
def sample_reflection(o, alpha, u, v):
    """The direction reflected by a facet that is seen, the cosine at the facet, and the density of the direction."""
    h = visible_normal(o, alpha, u, v)
    cosine = min(max(dot(o, h), 0.0), 1.0)
    pdf = distribution(h, alpha) / (4.0 * o[2] * (1.0 + smith_lambda(o, alpha)))
    return reflect(o, h, cosine), cosine, pdf


@device
def nothing(f):
    """Fill f with zeros; returns density 0, for light that is not scattered."""
    for c in range(f.size):
        f[c] = 0.0
    return 0.0
