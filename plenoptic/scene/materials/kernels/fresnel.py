"""Fresnel's equations for unpolarised light: device functions.

M. Born and E. Wolf, Principles of Optics, 7th ed., sections 1.5.2 and 14.2.
"""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device


@device
def dielectric(cosine, eta):
    """Reflectance at a cosine of incidence, 0 to 1, and the cosine of refraction; `eta` is n behind over n before.

    1 and 0 where all light is reflected. The sine, not the cosine, is divided, so that grazing rays keep their digits.
    """
    sine2 = (1.0 - cosine * cosine) / (eta * eta)
    if sine2 >= 1.0:
        return 1.0, 0.0
    behind = math.sqrt(1.0 - sine2)
    s = (cosine - eta * behind) / (cosine + eta * behind)
    p = (eta * cosine - behind) / (eta * cosine + behind)
    return 0.5 * (s * s + p * p), behind


@device
def conductor(cosine, n, k):
    """Reflectance of a medium of index n + i k, seen from a medium of index 1, at a cosine of incidence of 0 to 1."""
    sine2 = 1.0 - cosine * cosine
    real = n * n - k * k - sine2
    length = math.sqrt(real * real + 4.0 * n * n * k * k)
    a2 = 0.5 * (length + real)
    a = math.sqrt(max(a2, 0.0))
    s = (length + cosine * cosine - 2.0 * cosine * a) / (length + cosine * cosine + 2.0 * cosine * a)
    across = length * cosine * cosine + sine2 * sine2
    along = 2.0 * a * cosine * sine2
    return 0.5 * s * (1.0 + (across - along) / (across + along))


@device
def schlick(normal, cosine):
    """Reflectance that rises from `normal` at normal incidence to 1 at grazing (C. Schlick, 1994)."""
    dark = 1.0 - cosine
    square = dark * dark
    return normal + (1.0 - normal) * square * square * dark
