"""Matt surfaces of grooves: device functions.

J. Portsmouth, P. Kutz and S. Hill, J. Comput. Graph. Tech. 14(1), 116 (2025): equations by number from there.
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device

_C1 = 0.5 - 2.0 / (3.0 * math.pi)
_C2 = 2.0 / 3.0 - 28.0 / (15.0 * math.pi)


@device
def _reflected_once(cosine, roughness):
    """Directional albedo of grooves of albedo 1 by single scattering (equation 31, exact)."""
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    part = sine * (math.acos(min(cosine, 1.0)) - sine * cosine)
    # (1 - sine^3) / cosine tends to 0 at grazing.
    rest = sine * (1.0 - sine * sine * sine) / cosine - sine if cosine > 1e-7 else -sine
    return (1.0 + roughness / math.pi * (part + 2.0 / 3.0 * rest)) / (1.0 + _C1 * roughness)


@device
def groove_terms(ox, oy, oz, ix, iy, iz, roughness):
    """Shape of single scattering, shape of multiple scattering, mean albedo of single scattering.

    The reflected radiance per irradiance is (rho single + rho_m multiple) / pi with rho_m from `groove_albedo`.
    """
    scale = 1.0 / (1.0 + _C1 * roughness)
    s = ox * ix + oy * iy
    t = max(oz, iz) if s > 0.0 else 1.0
    single = scale * (1.0 + roughness * s / t)
    mean = scale * (1.0 + _C2 * roughness)
    lost = max(1e-12, 1.0 - mean)
    multiple = max(0.0, 1.0 - _reflected_once(oz, roughness)) * max(0.0, 1.0 - _reflected_once(iz, roughness)) / lost
    return single, multiple, mean


@device
def groove_albedo(albedo, mean):
    """Albedo of what grooves scatter more than once."""
    return albedo * albedo * mean / (1.0 - albedo * (1.0 - mean))
