"""Proven bounds on slope, curvature and height of an asphere within its semi-diameter."""

from __future__ import annotations

import functools
import math

import numpy as np

from plenoptic.core.values import Floats

RINGS = 64
"""Rings of equal area with separate bounds: narrow enough for bounds some per cent above the true maximum."""

_ROUNDING = 1.0 + 1e-9


@functools.lru_cache(maxsize=256)
def asphere_bounds(c: float, conic: float, terms: tuple[float, ...], edge: float) -> tuple[float, float, float]:
    """Bounds up to the semi-diameter on the magnitudes of the slope dz/dr, of the second derivative by r, and of the
    sag.

    With u = (r / semi-diameter)^2, each is a polynomial in u plus a part of the conic that is monotone in u. In every
    ring of u, a polynomial lies between the smallest and the largest of its Bernstein coefficients (G. Farin, Curves
    and Surfaces for CAGD, 5th ed., section 6.2), and the conic's part between its ends. Infinite if the surface
    reaches the equator of its conic.
    """
    u = np.linspace(0.0, 1.0, RINGS + 1)
    r = edge * np.sqrt(u)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        w2 = np.maximum(1.0 - (1.0 + conic) * (c * r) ** 2, 0.0)
        w = np.sqrt(w2)
        slope_over_r, second_derivative, sag = c / w, c / (w * w2), c * r * r / (1.0 + w)
        powers = np.arange(1, len(terms) + 1)
        # a_i r^(2 i) with r^2 = u edge^2, as a polynomial in u; a remaining factor r is applied outside.
        scaled = np.array(terms) * edge ** (2.0 * powers)
        slope = r[1:] * _bound(slope_over_r, scaled * 2 * powers / edge**2)
        bending = _bound(second_derivative, scaled * 2 * powers * (2 * powers - 1) / edge**2)
        height = _bound(sag, np.concatenate([[0.0], scaled]))
    bounds = [float(np.max(bound)) * _ROUNDING for bound in (slope, bending, height)]
    return tuple(bound if bound < math.inf else math.inf for bound in bounds)  # type: ignore[return-value]


def _bound(monotone: Floats, powers: Floats) -> Floats:
    """Bound for each ring on the magnitude of a monotone part, given at the rings' ends, plus a polynomial in u."""
    low, high = bernstein_range(powers)
    ends = np.stack([monotone[:-1], monotone[1:]])
    return np.asarray(np.maximum(np.abs(ends.min(axis=0) + low), np.abs(ends.max(axis=0) + high)))


def bernstein_range(powers: Floats) -> tuple[Floats, Floats]:
    """Smallest and largest Bernstein coefficient of a polynomial on each ring, (RINGS,) each."""
    n = len(powers) - 1
    width = 1.0 / RINGS
    ranges = []
    for start in np.arange(RINGS) * width:
        # Taylor coefficients at the start of the ring, for u = start + width t.
        local = np.array(
            [
                width**j * sum(math.comb(i, j) * powers[i] * start ** (i - j) for i in range(j, n + 1))
                for j in range(n + 1)
            ]
        )
        coefficients = [sum(math.comb(k, j) / math.comb(n, j) * local[j] for j in range(k + 1)) for k in range(n + 1)]
        ranges.append((min(coefficients), max(coefficients)))
    low, high = np.array(ranges).T
    # Largest rounding error of sums of large terms that cancel.
    slack = 64 * np.finfo(np.float64).eps * float(np.abs(powers).sum())
    return low - slack, high + slack
