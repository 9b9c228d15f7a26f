"""Transmission of a centred lens for all rays from a plane behind it, as a polynomial."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.lens_record import LensRecord
from plenoptic.optics.lens.trace import trace_record

_RAYS, _RAYS_PER_TERM, _CHECKED, _DEGREES = 4096, 3, 1024, range(2, 9)
"""Rays that are traced, those of a fit over its coefficients, most rays that check it, and degrees that are tried."""

_TOLERANCE = 1e-6
"""Largest error at rays without part in the fit, over the largest transmission: that of the tables of few surfaces."""


class TransmissionFit(NamedTuple):
    """Polynomial in q^2, p . q and p^2 of the points q and p of a ray in two planes, over the radii of their discs."""

    z_q: float
    """z of the plane of q in mm."""
    z_p: float
    """z of the plane of p in mm."""
    per_q: float
    """1 / radius of the disc of q, 1/mm."""
    per_p: float
    """1 / radius of the disc of p, 1/mm."""
    degree: int
    """Largest sum of the exponents."""
    coefficients: Floats
    """(terms,) in the order of `_exponents`."""


def _exponents(degree: int) -> list[tuple[int, int, int]]:
    """Exponents of q^2, p . q and p^2 in the order of Horner's scheme: that of p^2 falls first, that of q^2 last."""
    down = range(degree, -1, -1)
    return [(i, j, k) for k in down for j in down for i in down if i + j + k <= degree]


def transmission_fit(
    lens: LensRecord, start: tuple[float, float], pupil: tuple[float, float]
) -> TransmissionFit | None:
    """Fit to the transmission of rays that pass a lens with losses towards the scene.

    `start` and `pupil` are z and the radius in mm of discs on the axis, through which the rays go. None if an element
    has a placement or no rotational symmetry, or no fit is good enough.
    """
    if lens.frames is not None or lens.freeform is not None:
        return None
    u, (z_q, radius_q), (z_p, radius_p) = np.random.default_rng(0).random((3, _RAYS)), start, pupil
    q, p, angle = np.sqrt(u[0]), np.sqrt(u[1]), math.pi * u[2]
    origin = np.column_stack([radius_q * q, np.zeros(_RAYS), np.full(_RAYS, z_q)])
    through = np.column_stack([radius_p * p * np.cos(angle), radius_p * p * np.sin(angle), np.full(_RAYS, z_p)])
    behind = trace_record(lens, RayBundle(origin, through - origin), threads=1)
    passes = behind.status == 0
    light, variables = behind.weight[passes], np.stack([q * q, q * p * np.cos(angle), p * p])[:, passes]
    powers = variables[:, np.newaxis] ** np.arange(_DEGREES.stop)[:, np.newaxis]
    for degree in _DEGREES:
        i, j, k = np.array(_exponents(degree)).T
        n = _RAYS_PER_TERM * len(i)
        if 2 * n > len(light):
            break
        terms = (powers[0, i, : n + _CHECKED] * powers[1, j, : n + _CHECKED] * powers[2, k, : n + _CHECKED]).T
        coefficients = np.linalg.lstsq(terms[:n], light[:n])[0]
        if np.abs(terms[n:] @ coefficients - light[n : n + _CHECKED]).max() <= _TOLERANCE * light.max():
            return TransmissionFit(z_q, z_p, 1.0 / radius_q, 1.0 / radius_p, degree, coefficients)
    return None
