"""Transmission of a centred lens for all rays from a plane behind it, as polynomials."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.values import Floats
from plenoptic.optics.element_record import ARCS, CIRCLE, MASK, POLYGON, RING, STAR
from plenoptic.optics.lens.kernels.trace import fill_through_lens
from plenoptic.optics.lens.lens_record import LensRecord

_RAYS, _DISPERSED_RAYS, _RAYS_PER_TERM, _CHECKED, _DEGREES = 4096, 768, 3, 1024, range(2, 9)
"""Rays that are traced, whole blocks, and those at each of many wavelengths; those of a fit over its coefficients, most
rays that check it, and degrees that are tried."""
_MOST_PARTS = 6
"""Most products of a factor by wavelength and a polynomial."""

_TOLERANCE = 1e-6
"""Largest error at rays without part in the fit, over the largest transmission: that of the tables of few surfaces."""


class TransmissionFit(NamedTuple):
    """Polynomials in q^2, p . q and p^2 of the points q and p of a ray in two planes, over the radii of their discs.

    The transmission at many wavelengths is a constant for each and a sum of products of a factor by wavelength and a
    polynomial: coatings and glass take nearly the same part of all rays.
    """

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
    """(parts, terms) in the order of `_exponents`, whose last one is the constant: 0 at many wavelengths."""
    factors: Floats | None
    """(wavelengths, 1 + parts): a constant, and the factor of each part; None for one wavelength and one part."""


def _exponents(degree: int) -> list[tuple[int, int, int]]:
    """Exponents of q^2, p . q and p^2 in the order of Horner's scheme: that of p^2 falls first, that of q^2 last."""
    down = range(degree, -1, -1)
    return [(i, j, k) for k in down for j in down for i in down if i + j + k <= degree]


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
    count = _RAYS if lens.index_ratios is None else _DISPERSED_RAYS
    u, (z_q, radius_q), (z_p, radius_p) = np.random.default_rng(0).random((3, count)), start, pupil
    q, p, angle = np.sqrt(u[0]), np.sqrt(u[1]), math.pi * u[2]
    origin = np.column_stack([radius_q * q, np.zeros(count), np.full(count, z_q)])
    through = np.column_stack([radius_p * p * np.cos(angle), radius_p * p * np.sin(angle), np.full(count, z_p)])
    light = _transmitted(lens, origin, through)
    passes = (light > 0.0).all(axis=0)
    light, variables = light[:, passes], np.stack([q * q, q * p * np.cos(angle), p * p])[:, passes]
    powers = variables[:, np.newaxis] ** np.arange(_DEGREES.stop)[:, np.newaxis]
    for degree in _DEGREES:
        i, j, k = np.array(_exponents(degree)).T
        n = _RAYS_PER_TERM * len(i)
        if 2 * n > light.shape[1]:
            break
        terms = (powers[0, i, : n + _CHECKED] * powers[1, j, : n + _CHECKED] * powers[2, k, : n + _CHECKED]).T
        coefficients, checked = np.linalg.lstsq(terms[:n], light[:, :n].T)[0].T, light[:, n : n + _CHECKED]
        for parts, factors in _few_parts(coefficients, dispersed=lens.index_ratios is not None):
            values = parts @ terms[n:].T
            if factors is not None:
                values = factors[:, :1] + factors[:, 1:] @ values
            if np.abs(values - checked).max() <= _TOLERANCE * light.max():
                return TransmissionFit(z_q, z_p, 1.0 / radius_q, 1.0 / radius_p, degree, parts, factors)
    return None


def _few_parts(coefficients: Floats, *, dispersed: bool) -> Iterator[tuple[Floats, Floats | None]]:
    """Coefficients and factors of a `TransmissionFit`, with one part more each time.

    `coefficients` (wavelengths, terms) are those of each wavelength. Constants differ most between wavelengths; without
    them the rest needs one part less.
    """
    if not dispersed:
        yield coefficients, None
        return
    constant, rest = coefficients[:, -1:], coefficients.copy()
    rest[:, -1] = 0.0
    factors, sizes, parts = np.linalg.svd(rest, full_matrices=False)
    for rank in range(1, min(len(sizes), _MOST_PARTS) + 1):
        chosen = np.concatenate([constant, factors[:, :rank] * sizes[:rank]], axis=1)
        yield np.ascontiguousarray(parts[:rank]), chosen


def _with_round_stops(lens: LensRecord) -> LensRecord:
    """The lens with circles around its stops, whose shapes and masks take light where rays are traced."""
    rows = lens.rows.copy()
    rows["kind"][np.isin(rows["kind"], (POLYGON, ARCS, STAR, MASK, RING))] = CIRCLE
    return lens._replace(rows=rows, masks=None)


def _transmitted(lens: LensRecord, origin: Floats, through: Floats) -> Floats:
    """Light (wavelengths, rays) of rays from points through others that passes the lens."""
    direction, n = through - origin, len(origin)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rows = np.column_stack([origin, direction, np.ones(n), np.zeros(n)]).reshape(-1, BLOCK, RAY // BLOCK)
    light = np.empty((1 if lens.index_ratios is None else lens.index_ratios.shape[1], n))
    for wave, of_rays in enumerate(light):
        blocks = np.ascontiguousarray(rows.transpose(0, 2, 1))
        fill_through_lens(blocks.reshape(-1), lens, None if lens.index_ratios is None else np.full(n, wave))
        of_rays[:] = blocks[:, WEIGHT // BLOCK].ravel()
    return light
