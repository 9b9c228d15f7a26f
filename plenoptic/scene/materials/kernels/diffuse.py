"""Matt surfaces, smooth and of grooves: device functions. See `bsdf` for directions and f.

J. Portsmouth, P. Kutz and S. Hill, J. Comput. Graph. Tech. 14(1), 116 (2025): equations by number from there.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.sincos import turn
from plenoptic.core.numba.jit import device
from plenoptic.scene.materials.kernels.microfacets import nothing

OVER_PI = 1.0 / math.pi
_C1 = 0.5 - 2.0 / (3.0 * math.pi)
_C2 = 2.0 / 3.0 - 28.0 / (15.0 * math.pi)


@device
def eval_lambertian(f, i):
    """See `bsdf.evaluate`."""
    if i[2] <= 0.0:
        return nothing(f)
    for c in range(f.size):
        f[c] *= i[2] * OVER_PI
    return i[2] * OVER_PI


@device
def eval_oren_nayar(f, o, i, roughness):
    """See `bsdf.evaluate`."""
    if i[2] <= 0.0:
        return nothing(f)
    single, multiple, mean = _oren_nayar_terms(o, i, roughness)
    for c in range(f.size):
        f[c] = (f[c] * single + _multiple_albedo(f[c], mean) * multiple) * (i[2] * OVER_PI)
    return i[2] * OVER_PI


@device
def sample_cosine(u, v):
    """A direction drawn by the cosine."""
    radius = math.sqrt(u)
    c, s = turn(v)
    return radius * c, radius * s, math.sqrt(max(0.0, 1.0 - u))


@device
def sample_lambertian(u, v):
    """See `bsdf.sample`; f is the base colour already."""
    i = sample_cosine(u, v)
    return i, i[2] * OVER_PI, 1.0


@device
def sample_oren_nayar(f, o, roughness, u, v):
    """See `bsdf.sample`."""
    i = sample_cosine(u, v)
    single, multiple, mean = _oren_nayar_terms(o, i, roughness)
    for c in range(f.size):
        f[c] = f[c] * single + _multiple_albedo(f[c], mean) * multiple
    return i, i[2] * OVER_PI, 1.0


@device
def _reflected_once(cosine, roughness):
    """Directional albedo of grooves of albedo 1 by single scattering (equation 31, exact)."""
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    part = sine * (math.acos(min(cosine, 1.0)) - sine * cosine)
    # (1 - sine^3) / cosine tends to 0 at grazing.
    grazing_term = sine * (1.0 - sine * sine * sine) / cosine - sine if cosine > 1e-7 else -sine
    return (1.0 + roughness / math.pi * (part + 2.0 / 3.0 * grazing_term)) / (1.0 + _C1 * roughness)


@device
def _oren_nayar_terms(o, i, roughness):
    """Shape of single scattering, shape of multiple scattering, mean albedo of single scattering.

    The reflected radiance per irradiance is (rho single + rho_m multiple) / pi with rho_m from `_multiple_albedo`.
    """
    scale = 1.0 / (1.0 + _C1 * roughness)
    s = o[0] * i[0] + o[1] * i[1]
    t = max(o[2], i[2]) if s > 0.0 else 1.0
    single = scale * (1.0 + roughness * s / t)
    mean = scale * (1.0 + _C2 * roughness)
    lost = max(1e-12, 1.0 - mean)
    multiple = (
        max(0.0, 1.0 - _reflected_once(o[2], roughness)) * max(0.0, 1.0 - _reflected_once(i[2], roughness)) / lost
    )
    return single, multiple, mean


@device
def _multiple_albedo(albedo, mean):
    """Albedo of multiple scattering in grooves."""
    return albedo * albedo * mean / (1.0 - albedo * (1.0 - mean))
