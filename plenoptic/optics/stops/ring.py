"""Annular stops, with a central obstruction."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, broadcast, finite, length_in_mm, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.element_record import RING, ElementRow
from plenoptic.optics.lens.placement import Placement, set_place
from plenoptic.optics.stops.circle import CircularStop


@value
class RingStop:
    """A stop whose hole is a ring, such as the aperture of a telescope with a secondary mirror.

    Parameters
    ----------
    semi_diameter : float
        Outer radius of the ring in mm.
    inner_semi_diameter : float
        Inner radius in mm, of the central obstruction; above 0 and below the outer one.
    thickness, placement
        As of `CircularStop`.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    Examples
    --------
    >>> import plenoptic as pl
    >>> behind_secondary = pl.optics.RingStop(50.0, 15.0)
    >>> behind_secondary.contains([0.0, 20.0, 51.0], 0.0).tolist()
    [False, True, False]
    """

    semi_diameter: float
    inner_semi_diameter: float
    thickness: float = 0.0
    placement: Placement | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        set_place(self)
        set_field(self, "inner_semi_diameter", length_in_mm(self.inner_semi_diameter, "inner_semi_diameter"))
        if not self.inner_semi_diameter < self.semi_diameter:
            raise InvalidValueError(
                f"inner_semi_diameter is {self.inner_semi_diameter:g} mm, and no light passes within a semi_diameter "
                f"of {self.semi_diameter:g} mm; reduce it"
            )

    @property
    def area(self) -> float:
        """Area of the ring in mm^2."""
        outer, inner = self.semi_diameter, self.inner_semi_diameter
        return math.pi * (outer - inner) * (outer + inner)

    def contains(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """True for points (x, y), mm, in the ring or on its edges; x and y are broadcast."""
        x, y = broadcast(x=x, y=y)
        r2 = x * x + y * y
        return np.asarray((r2 <= self.semi_diameter**2) & (r2 >= self.inner_semi_diameter**2))

    def outline(self, n: int = 64) -> Floats:
        """Points on the outer edge, counter-clockwise from +x: an (n, 2) array in mm, not closed; n at least 3."""
        return CircularStop(self.semi_diameter).outline(n)

    def row(self) -> ElementRow:
        """Record of the stop for kernels."""
        # One edge as in `PolygonStop.edges`, curved the other way: -(x^2 + y^2) <= -r^2.
        edge = (0.0, 0.0, -self.inner_semi_diameter * self.inner_semi_diameter, -1.0)
        return ElementRow(RING, self.semi_diameter * self.semi_diameter, edges=(edge,))

    def image(self, scale: float) -> RingStop:
        """Image of the stop by a lens of magnification `scale`."""
        size = abs(finite(scale, "scale"))
        return RingStop(size * self.semi_diameter, size * self.inner_semi_diameter)

    @property
    def filled_radius(self) -> float:
        """Height in mm that the marginal ray of a beam that fills the hole reaches: the outer radius."""
        return self.semi_diameter

    def transmission_at(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Transmission, 1 in the ring and 0 outside, at points (x, y), mm; x and y are broadcast."""
        return np.asarray(self.contains(x, y), dtype=np.float64)

    _repr_html_ = picture_of
