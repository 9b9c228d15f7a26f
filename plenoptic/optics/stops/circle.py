"""Round stops."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import MAX_POINTS, Floats, broadcast, finite, value, whole
from plenoptic.optics.element_record import CIRCLE, ElementRow
from plenoptic.optics.lens.placement import Placement, set_place


@value
class CircularStop:
    """A stop with a round hole, centred on the axis.

    Parameters
    ----------
    semi_diameter : float
        Radius of the hole in mm, above 0.
    thickness : float, optional
        Axial gap to the next element in mm. Negative: the stop lies behind the vertex of the next surface, such as in
        the plane of its rim, and clips rays as they would go on without that surface. The stop is infinitely thin.
    placement : Placement, optional
        Decentre and tilt; see `LensStack.moved`. None: centred.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    Examples
    --------
    >>> import plenoptic as pl
    >>> stop = pl.CircularStop(5.0)
    >>> stop.contains([0.0, 4.0], [5.0, 4.0]).tolist()
    [True, False]
    """

    semi_diameter: float
    thickness: float = 0.0
    placement: Placement | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        set_place(self)

    @property
    def area(self) -> float:
        """Area of the hole in mm^2."""
        return math.pi * self.semi_diameter**2

    def contains(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """True for points (x, y), mm, in the hole or on its edge; x and y are broadcast."""
        x, y = broadcast(x=x, y=y)
        return np.asarray(x * x + y * y <= self.semi_diameter**2)

    def outline(self, n: int = 64) -> Floats:
        """Points on the edge, counter-clockwise from +x: an (n, 2) array in mm, not closed; n at least 3."""
        angle = 2 * math.pi * np.arange(whole(n, "n", at_least=3, at_most=MAX_POINTS)) / n
        return self.semi_diameter * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def row(self) -> ElementRow:
        """Record of the stop for kernels."""
        return ElementRow(CIRCLE, self.semi_diameter * self.semi_diameter)

    def image(self, scale: float) -> CircularStop:
        """Image of the stop by a lens of magnification `scale`: scaled, and rotated by half a turn if negative."""
        return CircularStop(abs(finite(scale, "scale")) * self.semi_diameter)

    @property
    def filled_radius(self) -> float:
        """Radius in mm of the largest circle about the axis inside the hole."""
        return self.semi_diameter

    def transmission_at(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Transmission, 1 in the hole and 0 outside, at points (x, y), mm; x and y are broadcast."""
        return np.asarray(self.contains(x, y), dtype=np.float64)

    _repr_html_ = picture_of
