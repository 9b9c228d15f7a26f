"""Odd powers of the distance from the axis, as in extended odd aspheres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, broadcast, coefficients, set_field, value
from plenoptic.optics.surfaces.freeform_bounds import FreeformBounds, VertexShape
from plenoptic.optics.surfaces.sag_bounds import RINGS, bernstein_range

ODD_POWERS = 3
"""Kind of the freeform term, for kernels."""

_MARGIN = 1.0 + 1e-9
_EPS = float(np.finfo(np.float64).eps)


@value
class OddPowerSag:
    r"""Odd powers of r, which are added to the sag of a surface; `Surface.aspheric` are the even ones.

    .. math:: \Delta z = \sum_i a_i r^{2 i + 3}, \qquad r = \sqrt{x^2 + y^2}

    The curvature at the vertex is unchanged. A term of r itself would be a cone, without a normal at the vertex.

    Parameters
    ----------
    coefficients : sequence of float
        a_0, a_1, ... of r^3, r^5 and so on, in mm^-2, mm^-4, ...

    Raises
    ------
    InvalidValueError
        If a coefficient is not finite.

    Examples
    --------
    >>> import plenoptic as pl
    >>> front = pl.Surface(50.0, semi_diameter=10.0, freeform=pl.optics.OddPowerSag([1e-5]))
    >>> round(float(front.sag(10.0) - pl.Surface(50.0, semi_diameter=10.0).sag(10.0)), 12)      # 1e-5 10^3
    0.01
    """

    coefficients: Sequence[float]

    def __post_init__(self) -> None:
        set_field(
            self, "coefficients", coefficients(self.coefficients, "coefficients", "a sequence, that of r^3 first")
        )

    @property
    def inverted(self) -> OddPowerSag:
        """The term with the opposite sign."""
        return OddPowerSag(tuple(-a for a in self.coefficients))

    def rescale(self, factor: float) -> OddPowerSag:
        """The term with all lengths times a factor."""
        return OddPowerSag(tuple(a / factor ** (2 * i + 2) for i, a in enumerate(self.coefficients)))

    @property
    def vertex(self) -> VertexShape:
        """Derivatives at the vertex, for paraxial rays: 0."""
        return VertexShape(0.0, 0.0, 0.0, 0.0, 0.0)

    def sag(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Sag of the term in mm at points (x, y), mm."""
        r = np.hypot(*broadcast(x=x, y=y))
        return np.asarray(r**3 * np.polynomial.polynomial.polyval(r * r, np.array([*self.coefficients, 0.0])))

    def gradient(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """(2, ...) derivatives of the sag with respect to x and y: (x, y) times (dz/dr) / r."""
        along = np.stack(broadcast(x=x, y=y))
        r = np.hypot(*along)
        return np.asarray(along * r * np.polynomial.polynomial.polyval(r * r, self._slopes()))

    def _slopes(self) -> Floats:
        """Coefficients of (dz/dr) / r^2, as a polynomial in r^2."""
        return np.array([(2 * i + 3) * a for i, a in enumerate(self.coefficients)] + [0.0])

    def bounds(self, radius: float) -> FreeformBounds:
        """Bounds within a distance from the vertex in mm; see `asphere_bounds`."""
        with np.errstate(over="ignore", invalid="ignore"):  # the surface rejects a term without finite bounds
            r = radius * np.sqrt(np.linspace(0.0, 1.0, RINGS + 1)[1:])  # at the outer end of each ring
            first = self._slopes()
            powers = float(radius) ** (2.0 * np.arange(len(first)))
            order = 2.0 * np.arange(len(first)) + 3.0
            # dz/dr / r^2, the second derivative along r over r, and z / r^3; across r it is (dz/dr) / r.
            slope, along, height = (
                np.max(np.abs(bernstein_range(p * powers)), axis=0)
                for p in (first, first * (order - 1.0), first / order)
            )
            bounds = r * r * slope, r * np.maximum(slope, along), r**3 * height
            largest = float(radius) ** 3 * float(np.abs(first * powers / order).sum())
        slope_bound, bending, tallest = (_MARGIN * float(bound.max()) for bound in bounds)
        # The bending is not 0, since lengths are divided by it.
        return FreeformBounds(slope_bound, bending + 1e-200, tallest, (2 * len(first) + 6) * _EPS * largest)

    def numbers(self) -> tuple[float, ...]:
        """Numbers for its kernel: kind, number of coefficients, and these."""
        return (float(ODD_POWERS), float(len(self.coefficients)), *self.coefficients)
