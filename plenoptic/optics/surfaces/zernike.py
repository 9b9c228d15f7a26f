"""Zernike polynomials as a freeform term of a surface."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats, broadcast, check_has, coefficients, positive, set_field, value
from plenoptic.errors import PrescriptionError
from plenoptic.optics.surfaces.freeform_bounds import FreeformBounds, VertexShape, ZemaxNumbers
from plenoptic.optics.surfaces.sag_bounds import RINGS, bernstein_range

ZERNIKE = 1
"""Kind of the freeform term, for kernels."""

_SMALLEST_RADIUS = 1e-9
"""Smallest norm radius in mm, and reciprocal of the largest; powers of others overflow."""

MAX_TERMS = 91
"""All terms of degree 12 and below. Beyond, sums of powers lose too many digits near the rim."""

_EPS = float(np.finfo(np.float64).eps)


class _Harmonics(NamedTuple):
    """The sag as sum over m of P_m(u) Re zeta^m + Q_m(u) Im zeta^m, zeta = (x + i y) / norm_radius, u = |zeta|^2."""

    cosine: Floats
    """(orders, terms) coefficients of the P_m, of u^0 first; P_0(0) is 0."""
    sine: Floats
    offset: float
    """Omitted constant of P_0, in mm."""


@value
class ZernikeSag:
    r"""Noll's Zernike polynomials over a disc, less their value at the vertex.

    .. math:: \Delta z = \sum_j a_j \left(Z_j(\rho, \varphi) - Z_j(0)\right), \qquad
        \rho = \frac{\sqrt{x^2 + y^2}}{r_n}, \quad \varphi = \operatorname{atan2}(y, x)

    The polynomials have a mean square of 1 over the disc, like those of Zemax's Zernike standard sag. The vertex is
    not displaced: piston, and the constants of other terms, only shift a surface along its axis.

    Parameters
    ----------
    coefficients : sequence of float
        a_1, a_2, ... in mm, at most 91 (degree 12): piston, tilts, defocus, astigmatism (oblique first), coma, ...
    norm_radius : float
        Radius r_n of the disc in mm, above 0; usually the semi-diameter.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    References
    ----------
    R. J. Noll, Zernike polynomials and atmospheric turbulence, J. Opt. Soc. Am. 66, 207 (1976), table I.

    Examples
    --------
    >>> import plenoptic as pl
    >>> astigmatism = pl.optics.ZernikeSag([0, 0, 0, 0, 0, 1e-3], norm_radius=10.0)     # sqrt(6) rho^2 cos(2 phi)
    >>> (1e3 * astigmatism.sag([10.0, 0.0], [0.0, 10.0])).round(4).tolist()
    [2.4495, -2.4495]
    >>> front = pl.Surface(50.0, semi_diameter=10.0, freeform=astigmatism)
    >>> bool(front.sag(10.0, 0.0) > front.sag(0.0, 10.0))
    True
    """

    coefficients: Sequence[float]
    norm_radius: float

    def __post_init__(self) -> None:
        set_field(self, "norm_radius", positive(self.norm_radius, "norm_radius", "mm"))
        if not _SMALLEST_RADIUS <= self.norm_radius <= 1.0 / _SMALLEST_RADIUS:
            limits = f"from {_SMALLEST_RADIUS:g} to {1.0 / _SMALLEST_RADIUS:g} mm"
            raise PrescriptionError(f"norm_radius is {self.norm_radius:g} mm; it must be {limits}")
        expected = "a sequence of numbers, that of piston first"
        terms = list(coefficients(self.coefficients, "coefficients", expected))
        while terms and terms[-1] == 0:
            terms.pop()
        if len(terms) > MAX_TERMS:
            raise PrescriptionError(
                f"coefficients has {len(terms)} terms, up to degree {degree_and_order(len(terms))[0]}; at most "
                f"{MAX_TERMS}, of degree 12, can be traced: leave out the others if they are small"
            )
        set_field(self, "coefficients", tuple(terms))

    @property
    def _harmonics(self) -> _Harmonics:
        return _harmonics(tuple(self.coefficients))

    @property
    def offset(self) -> float:
        """Sum of the a_j Z_j(0) in mm, which is omitted."""
        return self._harmonics.offset

    @property
    def inverted(self) -> ZernikeSag:
        """The term with the opposite sign."""
        return ZernikeSag(tuple(-a for a in self.coefficients), self.norm_radius)

    def rescale(self, factor: float) -> ZernikeSag:
        """The term with all lengths times a factor."""
        return ZernikeSag(tuple(factor * a for a in self.coefficients), factor * self.norm_radius)

    def sag(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Sag of the term in mm at points (x, y), mm."""
        zeta, u = self._zeta(x, y)
        parts = self._harmonics
        total = np.zeros(zeta.shape)
        for m, (p, q) in enumerate(zip(parts.cosine, parts.sine, strict=True)):
            power = zeta**m
            total = total + _at(p, u) * power.real + _at(q, u) * power.imag
        return total

    def gradient(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """(2, ...) derivatives of the sag with respect to x and y."""
        zeta, u = self._zeta(x, y)
        parts = self._harmonics
        total = np.zeros((2, *zeta.shape))
        for m, (p, q) in enumerate(zip(parts.cosine, parts.sine, strict=True)):
            power, change = zeta**m, m * zeta ** max(m - 1, 0)
            by_u = _at(_derivative(p), u) * power.real + _at(_derivative(q), u) * power.imag
            along = np.stack([change.real, -change.imag]) * _at(p, u) + np.stack([change.imag, change.real]) * _at(q, u)
            total = total + 2.0 * np.stack([zeta.real, zeta.imag]) * by_u + along
        return np.asarray(total / self.norm_radius)

    def _zeta(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.complex128], Floats]:
        scaled_x, scaled_y = (xy / self.norm_radius for xy in broadcast(x=x, y=y))
        zeta: NDArray[np.complex128] = np.asarray(scaled_x + 1j * scaled_y, np.complex128)
        return zeta, np.asarray(scaled_x * scaled_x + scaled_y * scaled_y)

    @property
    def vertex(self) -> VertexShape:
        """Derivatives at the vertex, for paraxial rays."""
        p, q, _ = self._harmonics
        r = self.norm_radius
        mean, split, oblique = 2.0 * p[0, 1] / r**2, 2.0 * p[2, 0] / r**2, 2.0 * q[2, 0] / r**2
        shape = (p[1, 0] / r, q[1, 0] / r, mean + split, oblique, mean - split)
        return VertexShape(*map(float, shape))

    def bounds(self, radius: float) -> FreeformBounds:
        """Bounds within a distance from the vertex in mm."""
        return _bounds(tuple(self.coefficients), self.norm_radius, float(radius))

    def numbers(self) -> tuple[float, ...]:
        """Numbers for its kernel: kind, degree, and the coefficients of x^i y^j in mm, by falling i, then falling j."""
        powers, _ = _powers(tuple(self.coefficients))
        degree = len(powers) - 1
        order = [(i, j) for i in range(degree, -1, -1) for j in range(degree - i, -1, -1)]
        return (float(ZERNIKE), float(degree), *(float(powers[i, j]) / self.norm_radius ** (i + j) for i, j in order))

    @classmethod
    def from_zemax(cls, surface: ZemaxNumbers) -> tuple[ZernikeSag | None, float]:
        """Freeform term of a surface of type SZERNSAG, and its omitted sag at the vertex in mm.

        XDAT are the number of terms, the norm radius, and the coefficients.
        """
        check_has(surface, "surface", "ZemaxNumbers", "a surface of a Zemax file", "extra")
        extra, unit = surface.extra, surface.unit
        if 1 not in extra or not float(extra[1]).is_integer() or extra[1] < 0:
            raise PrescriptionError("XDAT 1, the number of Zernike terms, is missing or invalid; give it")
        last = 2 + int(extra[1])
        if last > max(2, *extra):
            raise PrescriptionError(
                f"XDAT 1 states {last - 2} Zernike terms, but XDAT {last}, the last of them, is missing: "
                "give all of them, or their number"
            )
        terms = {j - 2: a * unit for j, a in extra.items() if 2 < j <= last and a != 0}
        if not terms:
            return None, 0.0
        if max(terms) > MAX_TERMS:
            raise PrescriptionError(f"XDAT {max(terms) + 2} is Zernike term {max(terms)}; at most {MAX_TERMS} are read")
        if 2 not in extra:
            raise PrescriptionError("XDAT 2, the norm radius of the Zernike terms, is missing; give it")
        sag = cls([terms.get(j, 0.0) for j in range(1, max(terms) + 1)], extra[2] * unit)
        return sag, sag.offset


def degree_and_order(j: int) -> tuple[int, int]:
    """Degree n and order m of Noll's term j: m above 0 for cosines, below for sines."""
    n = (math.isqrt(8 * j - 7) - 1) // 2
    row = j - n * (n + 1) // 2 - 1  # position within the terms of this degree
    m = 2 * ((row + (n + 1) % 2) // 2) + n % 2
    return n, m if j % 2 == 0 else -m


@functools.lru_cache(maxsize=256)
def _harmonics(noll: tuple[float, ...]) -> _Harmonics:
    terms = [(*degree_and_order(j), a) for j, a in enumerate(noll, start=1)]
    # The vertex curvature needs orders up to 2 and terms up to u.
    orders = max([2, *(abs(m) for _, m, _ in terms)]) + 1
    width = max([1, *((n - abs(m)) // 2 for n, m, _ in terms)]) + 1
    cosine, sine = np.zeros((2, orders, width))
    for n, m, a in terms:
        half, low = (n - abs(m)) // 2, abs(m)
        size = a * math.sqrt((n + 1) * (1 if m == 0 else 2))
        into = (sine if m < 0 else cosine)[low]
        for k in range(half + 1):
            # (n - k)! / (k! ((n + m) / 2 - k)! ((n - m) / 2 - k)!) as a product of two binomials.
            into[half - k] += size * (-1) ** k * math.comb(n - k, k) * math.comb(n - 2 * k, half - k)
    offset = float(cosine[0, 0])
    cosine[0, 0] = 0.0
    return _Harmonics(cosine, sine, offset)


@functools.lru_cache(maxsize=256)
def _powers(terms: tuple[float, ...]) -> tuple[Floats, Floats]:
    """(degree + 1, degree + 1) coefficients of (x / norm_radius)^i (y / norm_radius)^j, and the sums of the magnitudes
    that add up to them.

    zeta^m u^k is (x + i y)^(m + k) (x - i y)^k.
    """
    parts, degree = _harmonics(terms), degree_and_order(max(len(terms), 1))[0]
    powers, sizes = np.zeros((2, degree + 1, degree + 1))
    for m, k in np.argwhere((parts.cosine != 0) | (parts.sine != 0)).tolist():
        n = m + 2 * k
        zeta, y = np.polynomial.Polynomial([1, 1j]), np.arange(n + 1)
        product = (zeta ** (m + k) * np.polynomial.Polynomial([1, -1j]) ** k).coef
        cosine, sine = parts.cosine[m, k] * product.real, parts.sine[m, k] * product.imag
        powers[n - y, y] += cosine + sine
        sizes[n - y, y] += np.abs(cosine) + np.abs(sine)
    return powers, sizes


def _at(p: Floats, u: Floats) -> Floats:
    """Value of a polynomial, of u^0 first."""
    return np.asarray(np.polynomial.polynomial.polyval(u, p))


def _derivative(p: Floats) -> Floats:
    return np.append(p[1:] * np.arange(1, len(p)), 0.0)


def _times_u(p: Floats, power: int = 1) -> Floats:
    """Coefficients of a polynomial times u^power."""
    return np.append(np.zeros(power), p)


def _sum(*parts: Floats) -> Floats:
    total = np.zeros(max(map(len, parts)))
    for part in parts:
        total[: len(part)] += part
    return total


@functools.lru_cache(maxsize=256)
@np.errstate(over="ignore", invalid="ignore")  # the surface rejects a term without a finite height
def _bounds(terms: tuple[float, ...], norm_radius: float, radius: float) -> FreeformBounds:
    # In polar coordinates, a term f(rho) cos(m phi), f = rho^m P(u), has the gradient f', m f / rho, and the second
    # derivatives f'', f' / rho - m^2 f / rho^2 and m (f' / rho - f / rho^2): powers of rho times polynomials in u,
    # which in each ring lie between their Bernstein coefficients. The magnitudes of all terms are added up.
    parts = _harmonics(terms)
    edge2 = (radius / norm_radius) ** 2
    rho = np.sqrt(np.linspace(0.0, edge2, RINGS + 1)[1:])  # at the outer end of each ring

    def size(p: Floats) -> Floats:
        """Bound on the magnitude of a polynomial in u in each ring."""
        low, high = bernstein_range(p * edge2 ** np.arange(len(p)))
        return np.maximum(np.abs(low), np.abs(high))

    slope, bending, height = np.zeros((3, RINGS))
    for m, pair in enumerate(zip(parts.cosine, parts.sine, strict=True)):
        for p in pair:
            if not p.any():
                continue
            d1 = _derivative(p)
            d2 = _derivative(d1)
            height += rho**m * size(p)
            if m == 0:
                slope += rho * size(2 * d1)
                bending += np.maximum(size(_sum(2 * d1, _times_u(4 * d2))), size(2 * d1))
                continue
            slope += rho ** (m - 1) * np.maximum(size(_sum(m * p, _times_u(2 * d1))), size(m * p))
            if m == 1:
                along, across, mixed = (
                    rho * size(_sum(6 * d1, _times_u(4 * d2))),
                    rho * size(2 * d1),
                    rho * size(2 * d1),
                )
            else:
                outer = rho ** (m - 2)
                along = outer * size(_sum(m * (m - 1) * p, _times_u((4 * m + 2) * d1), _times_u(4 * d2, 2)))
                across = outer * size(_sum((m - m * m) * p, _times_u(2 * d1)))
                mixed = outer * m * size(_sum((m - 1) * p, _times_u(2 * d1)))
            bending += np.hypot(np.maximum(along, across), mixed)
    margin = 1.0 + 1e-9
    # Horner's scheme in y and x: some eps of the magnitudes of all powers for each step. Their sum has the degree 12 in
    # the sine and cosine of the azimuth: between 256 azimuths of a circle it exceeds these by 1 / cos(12 pi / 256).
    azimuth = np.linspace(0.0, 0.5 * math.pi, 65)
    edge = math.sqrt(edge2)
    sizes = np.polynomial.polynomial.polyval2d(edge * np.cos(azimuth), edge * np.sin(azimuth), _powers(terms)[1])
    steps = 2 * parts.cosine.shape[1] + 4 * parts.cosine.shape[0] + 4
    return FreeformBounds(
        margin * float(slope.max()) / norm_radius,
        # Not 0, since lengths are divided by it.
        margin * float(bending.max()) / norm_radius**2 + 1e-200,
        margin * float(height.max()),
        1.02 * steps * _EPS * float(sizes.max()),
    )
