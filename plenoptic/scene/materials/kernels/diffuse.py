"""Matt surfaces, smooth and rough: device functions. See `bsdf` for directions and f."""

from __future__ import annotations

import math

from plenoptic.core.jit import device
from plenoptic.core.kernels.sincos import turn
from plenoptic.scene.materials.kernels.microfacets import nothing
from plenoptic.scene.materials.kernels.oren_nayar import multiple_albedo, oren_nayar_terms

OVER_PI = 1.0 / math.pi


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
    single, multiple, mean = oren_nayar_terms(o, i, roughness)
    for c in range(f.size):
        f[c] = (f[c] * single + multiple_albedo(f[c], mean) * multiple) * (i[2] * OVER_PI)
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
    single, multiple, mean = oren_nayar_terms(o, i, roughness)
    for c in range(f.size):
        f[c] = f[c] * single + multiple_albedo(f[c], mean) * multiple
    return i, i[2] * OVER_PI, 1.0
