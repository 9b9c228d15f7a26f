"""Transmission of a centred lens for all rays from a plane behind it, as polynomials."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.values import Floats
from plenoptic.optics.element_record import ARCS, CIRCLE, MASK, POLYGON, RING, STAR
from plenoptic.optics.lens.kernels.trace import fill_through_lens
from plenoptic.optics.lens.lens_record import LensRecord

_DRAWN, _RAYS, _DISPERSED_RAYS = 8192, 4096, 1024
"""Rays that are drawn, whole blocks, and most of them that are traced at one or at many wavelengths: half for the fit,
half to check it."""
_RAYS_PER_TERM, _DEGREES, _MOST_PARTS = 3, range(1, 9), 12
"""Fewest rays of a fit over its coefficients, degrees of polynomials, and most of these."""
_TOLERANCE, _SHARE = 1e-6, 0.25
"""Largest error at rays without part in the fit, over the largest transmission: that of the tables of few surfaces; and
the part of it that one of several polynomials may bring."""


class TransmissionFit(NamedTuple):
    """Polynomials in q^2, p . q and p^2 of the points q and p of a ray in two planes, over the radii of their discs.

    The transmission is a constant by wavelength and a sum of products of a factor by wavelength and a polynomial. Few
    are enough, as coatings and glass take nearly the same part of all rays, and low degrees for all but the first,
    which are small.
    """

    z_q: float
    """z of the plane of q in mm."""
    z_p: float
    per_q: float
    """One over the radius in mm of the disc in which the points q lie."""
    per_p: float
    degrees: NDArray[np.int64]
    """(parts,) largest sum of the exponents of each polynomial."""
    coefficients: Floats
    """Those of all polynomials; see `_padded`."""
    factors: Floats
    """(wavelengths, 1 + parts): the constant and the factor of each part."""


def _exponents(degree: int) -> list[tuple[int, int, int]]:
    """Exponents of the three variables by decreasing ones of the last, the second and the first: Horner's order."""
    falling = range(degree, -1, -1)
    return [(i, j, k) for k in falling for j in falling for i in falling if i + j + k <= degree]


def _padded(coefficients: Floats, degree: int) -> Floats:
    """Coefficients in the order of `_exponents`, after zeros where powers of q^2 are no multiple of four."""
    groups = np.split(coefficients, [n for n, (i, _, _) in enumerate(_exponents(degree), 1) if i == 0][:-1])
    return np.concatenate([np.append(np.zeros(-len(group) % 4), group) for group in groups])


def transmission_fit(
    lens: LensRecord, start: tuple[float, float], pupil: tuple[float, float]
) -> TransmissionFit | None:
    """Fit to the transmission of rays that pass a lens with losses towards the scene.

    `start` and `pupil` are z and the radius in mm of discs on the axis, through which the rays go. `lens` is of one
    wavelength, or of those of rays. None if an element has a placement or no rotational symmetry, or no fit is good
    enough.
    """
    if lens.frames is not None or lens.freeform is not None:
        return None
    lens = _with_round_stops(lens)
    u, (z_q, radius_q), (z_p, radius_p) = np.random.default_rng(0).random((3, _DRAWN)), start, pupil
    q, p, angle = np.sqrt(u[0]), np.sqrt(u[1]), math.pi * u[2]
    origin = np.column_stack([radius_q * q, np.zeros(_DRAWN), np.full(_DRAWN, z_q)])
    through = np.column_stack([radius_p * p * np.cos(angle), radius_p * p * np.sin(angle), np.full(_DRAWN, z_p)])
    wavelengths, most = (1, _RAYS) if lens.index_ratios is None else (lens.index_ratios.shape[1], _DISPERSED_RAYS)
    rays = np.flatnonzero(_transmitted(lens, origin, through, 1)[0] > 0.0)[:most]
    rays = rays[: len(rays) // BLOCK * BLOCK]
    light = _transmitted(lens, origin[rays], through[rays], wavelengths)
    passes = (light > 0.0).all(axis=0)
    parts = _fitted_parts(light[:, passes], np.stack([q * q, q * p * np.cos(angle), p * p])[:, rays[passes]])
    return None if parts is None else TransmissionFit(z_q, z_p, 1.0 / radius_q, 1.0 / radius_p, *parts)


def _fitted_parts(light: Floats, variables: Floats) -> tuple[NDArray[np.int64], Floats, Floats] | None:
    """Degrees, coefficients and factors of a fit to light (wavelengths, rays) by variables (3, rays)."""
    half = light.shape[1] // 2
    if half == 0:
        return None
    factors, tolerance = [light.mean(axis=1)], _TOLERANCE * light.max()
    of_part = tolerance if len(light) == 1 else _SHARE * tolerance
    rest = light - factors[0][:, np.newaxis]
    vectors = np.linalg.eigh(rest @ rest.T)[1][:, ::-1].T  # by falling share of the light
    degrees, coefficients = [], [np.zeros(0)]
    for factor in vectors[:_MOST_PARTS]:
        if np.abs(rest[:, half:]).max() <= tolerance:
            break
        found = _polynomial(factor @ rest, variables, of_part / np.abs(factor).max())
        if found is None:
            return None
        degree, numbers, values = found
        rest -= np.outer(factor, values)
        factors.append(factor)
        degrees.append(degree)
        coefficients.append(_padded(numbers, degree))
    if np.abs(rest[:, half:]).max() > tolerance:
        return None
    return np.array(degrees, dtype=np.int64), np.concatenate(coefficients), np.stack(factors, axis=1)


def _polynomial(values: Floats, variables: Floats, tolerance: float) -> tuple[int, Floats, Floats] | None:
    """Degree, coefficients and values of the polynomial of lowest degree that is within a tolerance of values (rays,).

    It is fitted to half of the rays and checked at the others; None if no degree is high enough.
    """
    half, powers = len(values) // 2, variables[:, np.newaxis] ** np.arange(_DEGREES.stop)[:, np.newaxis]
    for degree in _DEGREES:
        i, j, k = np.array(_exponents(degree)).T
        if half < _RAYS_PER_TERM * len(i):
            break
        terms = (powers[0, i] * powers[1, j] * powers[2, k]).T
        coefficients = np.linalg.lstsq(terms[:half], values[:half])[0]
        fitted = terms @ coefficients
        if np.abs(fitted - values)[half:].max() <= tolerance:
            return degree, coefficients, fitted
    return None


def _with_round_stops(lens: LensRecord) -> LensRecord:
    """The lens with circles around its stops, whose shapes and masks take light where rays are traced."""
    rows = lens.rows.copy()
    rows["kind"][np.isin(rows["kind"], (POLYGON, ARCS, STAR, MASK, RING))] = CIRCLE
    return lens._replace(rows=rows, masks=None)


def _transmitted(lens: LensRecord, origin: Floats, through: Floats, wavelengths: int) -> Floats:
    """Light (wavelengths, rays) of rays from points through others that passes the lens, at its first wavelengths."""
    direction, n = through - origin, len(origin)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rows = np.column_stack([origin, direction, np.ones(n), np.zeros(n)]).reshape(-1, BLOCK, RAY // BLOCK)
    light = np.empty((wavelengths, n))
    for wave, of_rays in enumerate(light):
        blocks = np.ascontiguousarray(rows.transpose(0, 2, 1))
        fill_through_lens(blocks.reshape(-1), lens, None if lens.index_ratios is None else np.full(n, wave))
        of_rays[:] = blocks[:, WEIGHT // BLOCK].ravel()
    return light
