"""Biconic: a surface with different radii and conic constants in the sections x z and y z."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, broadcast, check_has, checked_field, finite, value
from plenoptic.errors import PrescriptionError
from plenoptic.optics.surfaces.freeform_bounds import FreeformBounds, VertexShape, ZemaxNumbers
from plenoptic.optics.surfaces.radius import signed_radius
from plenoptic.optics.surfaces.sag_bounds import RINGS

BICONIC = 2
"""Kind of the freeform term, for kernels."""

SECTORS = 32
"""Intervals of the squared cosine of the azimuth with separate bounds."""

_LEAST_W2 = 1e-4
"""Smallest radicand in the denominator up to the semi-diameter: slopes are about 100 there, and infinite at the
equator, where it is 0."""

_AT_EQUATOR = 1e-12
"""Rounding error of the radicand; a point within it counts as a point of the equator."""

_MARGIN = 1.0 + 1e-9
_EPS = float(np.finfo(np.float64).eps)


@value
class BiconicSag:
    r"""Sag of a biconic, which is added to that of a surface: of a plane for the biconic itself.

    .. math:: z = \frac{c_x x^2 + c_y y^2}{1 + \sqrt{1 - (1 + k_x) c_x^2 x^2 - (1 + k_y) c_y^2 y^2}}

    With one radius infinite it is a cylinder. Paraxial data of a lens use the mean curvature.

    Parameters
    ----------
    radius_x, radius_y : float
        Radii of curvature 1/c in mm in the sections y = 0 and x = 0, signed as that of `Surface`; `math.inf`: flat.
    conic_x, conic_y : float, optional
        Conic constants of these sections.

    Raises
    ------
    InvalidValueError
        If a radius is 0 or nan, or a conic constant not finite.

    Examples
    --------
    >>> import plenoptic as pl
    >>> cylinder = pl.optics.BiconicSag(math.inf, 5.0)
    >>> front = pl.Surface(math.inf, semi_diameter=4.0, freeform=cylinder)
    >>> front.sag([3.0, 0.0], [0.0, 3.0]).round(12).tolist()
    [0.0, 1.0]
    """

    radius_x: float = checked_field(signed_radius)
    radius_y: float = checked_field(signed_radius)
    conic_x: float = checked_field(finite, default=0.0)
    conic_y: float = checked_field(finite, default=0.0)

    @property
    def inverted(self) -> BiconicSag:
        """The term with the opposite sign."""
        return BiconicSag(-self.radius_x, -self.radius_y, self.conic_x, self.conic_y)

    def rescale(self, factor: float) -> BiconicSag:
        """The term with all lengths times a factor."""
        return BiconicSag(factor * self.radius_x, factor * self.radius_y, self.conic_x, self.conic_y)

    def sag(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Sag in mm at points (x, y), mm; PrescriptionError beyond the equator of the biconic."""
        _, a, w = self._at(x, y)
        return np.asarray(a / (1.0 + w))

    def gradient(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """(2, ...) derivatives of the sag with respect to x and y; infinite or nan at the biconic's equator."""
        steep, a, w = self._at(x, y)
        _, *curvature, kx, ky = self.numbers()
        with np.errstate(divide="ignore", invalid="ignore"):
            change = a / (2.0 * w * (1.0 + w) ** 2)
            parts = [s * (1.0 / (1.0 + w) + k * c * change) for s, c, k in zip(steep, curvature, (kx, ky), strict=True)]
        return 2.0 * np.stack(parts)

    def _at(self, x: ArrayLike, y: ArrayLike) -> tuple[tuple[Floats, Floats], Floats, Floats]:
        """(c_x x, c_y y), the numerator of the sag, and the root in its denominator, at points (x, y)."""
        _, cx, cy, kx, ky = self.numbers()
        x, y = broadcast(x=x, y=y)
        sx, sy = cx * x, cy * y
        w2 = 1.0 - (kx * sx * sx + ky * sy * sy)
        if not np.all(w2 >= -_AT_EQUATOR):
            raise PrescriptionError(f"the points reach {np.hypot(x, y).max():g} mm from the vertex, beyond {self!r}")
        return (sx, sy), sx * x + sy * y, np.sqrt(np.maximum(w2, 0.0))

    @property
    def vertex(self) -> VertexShape:
        """Derivatives at the vertex, for paraxial rays."""
        return VertexShape(0.0, 0.0, 1.0 / self.radius_x, 0.0, 1.0 / self.radius_y)

    def bounds(self, radius: float) -> FreeformBounds:
        """Bounds within a distance from the vertex in mm; infinite if slopes there exceed about 100."""
        return _bounds(*self.numbers()[1:], float(radius))

    def numbers(self) -> tuple[float, ...]:
        """Numbers for its kernel: kind, curvatures along x and y, and 1 + k of both."""
        return (float(BICONIC), 1.0 / self.radius_x, 1.0 / self.radius_y, 1.0 + self.conic_x, 1.0 + self.conic_y)

    @classmethod
    def from_zemax(cls, surface: ZemaxNumbers) -> tuple[BiconicSag | None, float]:
        """The surface of a type BICONICX, and 0; None for a plane.

        CURV and CONI hold along y, PARM 1 is the radius along x (0: flat), and PARM 2 the conic constant along x.
        """
        check_has(surface, "surface", "ZemaxNumbers", "a surface of a Zemax file", "parameters")
        radius_x = surface.parameters.get(1, 0.0) * surface.unit or math.inf
        radius_y = 1.0 / surface.curvature if surface.curvature else math.inf
        term = cls(radius_x, radius_y, surface.parameters.get(2, 0.0), surface.conic)
        return (None if math.isinf(term.radius_x) and math.isinf(term.radius_y) else term), 0.0


@functools.lru_cache(maxsize=256)
@np.errstate(over="ignore", invalid="ignore")  # the surface rejects a term without finite bounds
def _bounds(cx: float, cy: float, kx: float, ky: float, radius: float) -> FreeformBounds:
    # z = A h(B), h = 1 / (1 + w), w = sqrt(1 - B), with A = c_x x^2 + c_y y^2 and radicand 1 - B. Both are bilinear in
    # r^2 and the squared cosine of the azimuth: in a cell of these two they lie between their values at its corners. h,
    # h' and h'' are positive and increase with B. Sums and products of intervals bound the derivatives. Cells are
    # narrow near the vertex, for steep hyperbolas, and at the rim.
    r, cosine2 = (np.sin(np.linspace(0.0, 0.5 * math.pi, n + 1)) ** power for n, power in ((RINGS, 1), (SECTORS, 2)))
    r *= radius
    shares = np.array([cosine2, 1.0 - cosine2])
    steep2 = [np.outer((c * r) ** 2, share) for c, share in zip((cx, cy), shares, strict=True)]
    a_x, a_y = (np.outer(c * r * r, share) for c, share in zip((cx, cy), shares, strict=True))
    b_x, b_y = kx * steep2[0], ky * steep2[1]
    b = _cells(b_x + b_y)
    if not b.max() <= 1.0 - _LEAST_W2:
        return FreeformBounds(math.inf, math.inf, math.inf, math.inf)
    w = np.sqrt(1.0 - b)
    h, h1, h2 = 1.0 / (1.0 + w), 0.5 / (w * (1.0 + w) ** 2), 0.25 * (1.0 + 3.0 * w) / (w * (1.0 + w)) ** 3
    a = _cells(a_x + a_y)
    slopes, second = [], []
    for c, k, share, squares in ((cx, kx, shares[0], steep2[0]), (cy, ky, shares[1], steep2[1])):
        scaled, q = _times(c, a), _cells(squares)
        change = 2.0 * _times(c, h + _times(k, _times(scaled, h1)))
        ahead = np.sqrt(np.maximum(share[:-1], share[1:]))
        slopes.append(np.outer(r[1:], ahead) * _size(change))
        curved = _times(q, 2.0 * _times(k, h1) + k * k * _times(scaled, h2))
        second.append(_size(change + 4.0 * _times(c, curved)))
    mixed = _times(kx * cx + ky * cy, h1) + _times(kx * ky * cy, _times(_times(cx, a), h2))
    along, across, oblique = *second, 4.0 * np.sqrt(_cells(steep2[0])[1] * _cells(steep2[1])[1]) * _size(mixed)
    bending = 0.5 * (along + across) + np.hypot(0.5 * (along - across), oblique)
    # A few eps of the sum of the magnitudes of the terms of A and B, and half an eps of 1 - B.
    terms_a, terms_b = (_size(_cells(abs(x) + abs(y))) for x, y in ((a_x, a_y), (b_x, b_y)))
    rounding = 6.0 * terms_a * h[1] + _size(_times(a, h1)) * (6.0 * terms_b + 2.0)
    return FreeformBounds(
        _MARGIN * float(np.hypot(*slopes).max()),
        # Not 0, since lengths are divided by it.
        _MARGIN * float(bending.max()) + 1e-200,
        _MARGIN * float(_size(_times(a, h)).max()),
        _EPS * float(rounding.max()),
    )


def _cells(corners: Floats) -> Floats:
    """(2, rings, sectors): smallest and largest value of a bilinear function in each cell, from its values at the
    corners.
    """
    four = np.stack([corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:]])
    return np.stack([four.min(axis=0), four.max(axis=0)])


def _times(factor: float | Floats, interval: Floats) -> Floats:
    """Product of a number or an interval with an interval, (2, rings, sectors)."""
    products = np.stack([np.asarray(end) * interval for end in np.atleast_1d(factor)]).reshape(-1, *interval.shape[1:])
    return np.stack([products.min(axis=0), products.max(axis=0)])


def _size(interval: Floats) -> Floats:
    """Largest magnitude in each interval."""
    return np.asarray(np.abs(interval).max(axis=0))
