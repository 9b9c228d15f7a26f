"""One refracting surface of a lens: a sphere or a plane."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic._values import finite, positive, set_field, value
from plenoptic.errors import PrescriptionError
from plenoptic.optics.media import AIR, Medium


def checked_gap(thickness: float) -> float:
    """An axial gap in mm, or an error where it is negative or not finite."""
    gap = finite(thickness, "thickness")
    if gap < 0:
        raise PrescriptionError(
            f"thickness is {gap:g} mm; the gap to the next element must be at least 0: "
            "list the elements in the order in which light meets them"
        )
    return gap


@value
class Surface:
    """A sphere or a plane, centred on the axis, with the gap and the medium that follow it.

    Parameters
    ----------
    radius : float
        Radius of curvature in mm; positive when the centre lies at +z (convex towards the scene). `math.inf` is
        a plane; so is -inf, which is stored as inf.
    thickness : float, optional
        Axial gap to the next element in mm, at least 0.
    medium : Medium, optional
        What fills that gap.
    semi_diameter : float
        Half of the free diameter in mm, above 0 and not above the absolute radius. Keyword only, required.

    Raises
    ------
    InvalidValueError
        PrescriptionError for a radius of 0 or nan, a negative gap, a semi-diameter above the radius, or a medium
        without an index; its base class for what is not a finite number.

    Examples
    --------
    >>> import plenoptic as pl
    >>> front = pl.Surface(58.95, thickness=7.52, medium=pl.ModelGlass(1.670, 47.1), semi_diameter=25.2)
    >>> front.curvature == 1 / 58.95
    True
    >>> pl.Surface(10.0, semi_diameter=12.0)
    Traceback (most recent call last):
    ...
    plenoptic.errors.PrescriptionError: semi_diameter 12 mm exceeds the radius of curvature 10 mm; reduce it to 10 or \
less
    """

    radius: float
    thickness: float = 0.0
    medium: Medium = AIR
    semi_diameter: float = dataclasses.field(kw_only=True)

    def __post_init__(self) -> None:
        set_field(self, "radius", self._checked_radius())
        set_field(self, "thickness", checked_gap(self.thickness))
        set_field(self, "semi_diameter", positive(self.semi_diameter, "semi_diameter", "mm"))
        if self.semi_diameter > abs(self.radius):
            raise PrescriptionError(
                f"semi_diameter {self.semi_diameter:g} mm exceeds the radius of curvature {abs(self.radius):g} mm; "
                f"reduce it to {abs(self.radius):g} or less"
            )
        # A text or a list has an index() too, which finds things in it; a class has one without an instance.
        if isinstance(self.medium, Sequence | type) or not callable(getattr(self.medium, "index", None)):
            raise PrescriptionError(
                f"medium is {self.medium!r}; it must be a medium: pl.AIR, pl.ConstantMedium(1.5) or a glass, such as "
                'pl.ModelGlass(1.5168, 64.17, "BK7")'
            )

    def _checked_radius(self) -> float:
        try:
            radius = float(self.radius)
        except (TypeError, ValueError, OverflowError):
            raise PrescriptionError(f"radius is {self.radius!r}; it must be a number, math.inf for a plane") from None
        if math.isinf(radius):
            return math.inf
        # The reciprocal of a subnormal radius overflows.
        if math.isnan(radius) or radius == 0 or math.isinf(1.0 / radius):
            raise PrescriptionError(f"radius is {radius:g} mm; it must not be 0 or nan: for a plane use math.inf")
        return radius

    @property
    def curvature(self) -> float:
        """Reciprocal of the radius in 1/mm, 0 for a plane."""
        return 1.0 / self.radius

    def sag(self, r: ArrayLike) -> NDArray[np.float64]:
        r"""Height of the surface over its vertex plane.

        .. math:: z = \frac{c r^2}{1 + \sqrt{1 - c^2 r^2}}

        Parameters
        ----------
        r : array_like
            Distance from the axis in mm, any shape, at most the absolute radius. The semi-diameter is no limit.

        Returns
        -------
        ndarray
            z in mm relative to the vertex, of the shape of `r`; of the sign of the curvature.

        Raises
        ------
        PrescriptionError
            If the sphere does not reach out to `r`.

        Examples
        --------
        >>> import plenoptic as pl
        >>> round(float(pl.Surface(5.0, semi_diameter=4.0).sag(3.0)), 12)
        1.0
        """
        distance = np.asarray(r, dtype=np.float64)
        if not np.all(np.abs(distance) <= abs(self.radius)):
            raise PrescriptionError(
                f"r reaches {np.max(np.abs(distance)):g} mm, where the sphere of radius {self.radius:g} mm has no "
                "point; stay within the radius"
            )
        # The same in terms of the radius, which is exact at the equator too; roots apart and all lengths over 4, which
        # is exact, so that neither a square nor a sum overflows.
        size, out = abs(self.radius) / 4, np.abs(distance) / 4
        depth = size + np.sqrt(size - out) * np.sqrt(size + out)
        return np.asarray(np.copysign(np.abs(distance) * (out / depth), self.radius))
