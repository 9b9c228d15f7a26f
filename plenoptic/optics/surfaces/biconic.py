"""A biconic shape: a surface whose sections along x and y are two conics, as a freeform term on a plane."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, broadcast, finite, number, set_field, value
from plenoptic.errors import PrescriptionError
from plenoptic.optics.surfaces.freeform_bounds import FreeformBounds, VertexShape
from plenoptic.optics.surfaces.zemax_shape import ZemaxShape

BICONIC = 2
"""Kind of the freeform term, for kernels."""

_EPS = float(np.finfo(np.float64).eps)


@value
class BiconicSag:
    r"""Sag with one conic as its section along x and another one along y: toric and cylindrical surfaces, for instance.

    .. math:: z = \frac{c_x x^2 + c_y y^2}{1 + \sqrt{1 - (1 + k_x) c_x^2 x^2 - (1 + k_y) c_y^2 y^2}}

    It is the whole shape on a plane, `Surface(math.inf, freeform=BiconicSag(...))`, and is added to any other base.

    Parameters
    ----------
    radius_x, radius_y : float
        Radii of curvature of the sections at the vertex in mm, signed like `Surface.radius`; `math.inf` is straight.
    conic_x, conic_y : float, optional
        Conic constants of the sections.

    Raises
    ------
    InvalidValueError
        PrescriptionError for a radius of 0 or nan; its base class for conic constants that are not finite.

    Examples
    --------
    >>> import math
    >>> import plenoptic as pl
    >>> cylinder = pl.optics.BiconicSag(math.inf, 50.0)
    >>> front = pl.Surface(math.inf, semi_diameter=10.0, freeform=cylinder)
    >>> front.sag([10.0, 0.0], [0.0, 10.0]).round(4).tolist()
    [0.0, 1.0102]
    """

    radius_x: float
    radius_y: float
    conic_x: float = 0.0
    conic_y: float = 0.0

    def __post_init__(self) -> None:
        for axis in "xy":
            radius = number(getattr(self, f"radius_{axis}"), f"radius_{axis}")
            if math.isnan(radius) or radius == 0 or math.isinf(1.0 / radius):
                raise PrescriptionError(
                    f"radius_{axis} is {radius:g} mm; it must not be 0 or nan: for a straight section use math.inf"
                )
            set_field(self, f"radius_{axis}", math.inf if math.isinf(radius) else radius)
            set_field(self, f"conic_{axis}", finite(getattr(self, f"conic_{axis}"), f"conic_{axis}"))

    @property
    def _curvatures(self) -> Floats:
        return np.array([1.0 / self.radius_x, 1.0 / self.radius_y])

    @property
    def _steepness(self) -> Floats:
        """(2,) factors (1 + k) c^2 of x^2 and y^2 below the root."""
        return (1.0 + np.array([self.conic_x, self.conic_y])) * self._curvatures**2

    @property
    def inverted(self) -> BiconicSag:
        """The term with the opposite sign."""
        return BiconicSag(-self.radius_x, -self.radius_y, self.conic_x, self.conic_y)

    def sag(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Sag of the term in mm at points (x, y), mm; PrescriptionError where the surface has no point."""
        points = np.stack(broadcast(x=x, y=y))
        return np.asarray(np.tensordot(self._curvatures, points**2, 1) / (1.0 + self._root(points)))

    def gradient(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """(2, ...) derivatives of the sag with respect to x and y."""
        points = np.stack(broadcast(x=x, y=y))
        root = self._root(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            along_root = np.tensordot(self._curvatures, points**2, 1) / (root * (1.0 + root))
        of_axis = (2, *[1] * (points.ndim - 1))
        slopes = 2.0 * self._curvatures.reshape(of_axis) + along_root * self._steepness.reshape(of_axis)
        return np.asarray(slopes * points / (1.0 + root))

    def _root(self, points: Floats) -> Floats:
        below_root = 1.0 - np.tensordot(self._steepness, points**2, 1)
        if not np.all(below_root >= 0.0):
            raise PrescriptionError(f"the point farthest out has no sag on {self!r}; stay nearer to the vertex")
        return np.sqrt(below_root)

    @property
    def vertex(self) -> VertexShape:
        """Derivatives at the vertex, for paraxial rays."""
        c_x, c_y = self._curvatures.tolist()
        return VertexShape(0.0, 0.0, c_x, 0.0, c_y)

    def bounds(self, radius: float) -> FreeformBounds:
        """Bounds within a distance from the vertex in mm; infinite if the surface ends within it.

        With A the numerator and w the root, z = A / (1 + w). Bounds on A, its gradient 2 |c| r and w's, q r / w with
        the steepness q, grow with r and with 1 / w; for a sphere they are the slope c r / w and the bending c / w^3.
        """
        c, q = float(np.abs(self._curvatures).max()), float(np.abs(self._steepness).max())
        w2 = 1.0 - max(0.0, float(self._steepness.max())) * radius * radius
        if not w2 > 0.0:
            return FreeformBounds(math.inf, math.inf, math.inf, math.inf)
        w = math.sqrt(w2)
        outer, numerator, by_root = 1.0 / (1.0 + w), c * radius * radius, q * radius / w
        height = numerator * outer
        slope = 2.0 * c * radius * outer + numerator * by_root * outer**2
        bending = 2.0 * c * outer + 4.0 * c * radius * by_root * outer**2
        bending += numerator * (q / w + by_root**2 / w) * outer**2 + 2.0 * numerator * by_root**2 * outer**3
        margin = 1.0 + 1e-9
        rounding = _EPS * height * (6.0 + 3.0 * q * radius * radius / w2)
        # Lengths are divided by the bending, which must not be 0.
        return FreeformBounds(margin * slope, margin * bending + 1e-200, margin * height, rounding)

    def numbers(self) -> tuple[float, ...]:
        """Numbers for its kernel: kind, curvatures and steepness along x and y."""
        return (float(BICONIC), *self._curvatures.tolist(), *self._steepness.tolist())

    @staticmethod
    def from_zemax(shape: ZemaxShape) -> ZemaxShape:
        """Shape of a surface of type BICONICX: CURV and CONI along y, PARM 1 the radius (0: straight) and 2 the conic
        constant along x.
        """
        parameters = dict(shape.parameters)
        radius_x, conic_x = parameters.pop(1, 0.0) * shape.unit, parameters.pop(2, 0.0)
        radius_y = 1.0 / shape.curvature if shape.curvature else math.inf
        term = BiconicSag(radius_x or math.inf, radius_y, conic_x, shape.conic)
        straight = math.isinf(term.radius_x) and math.isinf(term.radius_y)
        return shape._replace(curvature=0.0, conic=0.0, parameters=parameters, freeform=None if straight else term)
