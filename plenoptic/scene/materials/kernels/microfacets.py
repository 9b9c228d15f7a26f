"""Small mirrors whose normals have the GGX distribution, in a frame whose z is the surface's normal: device functions.

B. Walter et al., EGSR 2007; E. Heitz, J. Comput. Graph. Tech. 3(2), 48 (2014): equations by number from there.
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device
from plenoptic.core.kernels.sincos import turn


@device
def distribution(x, y, z, alpha):
    """D of a normal (x, y, z), z > 0, per steradian (equation 84)."""
    t = (x * x + y * y) / (alpha * alpha) + z * z
    return 1.0 / (math.pi * alpha * alpha * t * t)


@device
def hidden(x, y, z, alpha):
    """Smith's Lambda of a direction (equation 86): what is hidden over what is seen."""
    return 0.5 * (math.sqrt(1.0 + alpha * alpha * (x * x + y * y) / (z * z)) - 1.0)


@device
def visible_normal(x, y, z, alpha, u, v):
    """A normal drawn from those that the direction (x, y, z), z > 0, sees (J. Dupuy and A. Benyoub, 2023)."""
    x, y = alpha * x, alpha * y
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
