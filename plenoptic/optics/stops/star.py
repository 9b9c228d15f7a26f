"""Star-shaped stops."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import (
    MAX_POINTS,
    Floats,
    broadcast,
    finite,
    length_in_mm,
    radians,
    read_only,
    set_field,
    value,
    whole,
)
from plenoptic.errors import InvalidValueError
from plenoptic.optics.element_record import STAR, ElementRow
from plenoptic.optics.lens.placement import Placement, set_place
from plenoptic.optics.stops.polygon import MAX_CORNERS, subdivide


@value
class StarStop:
    """A stop whose hole is a regular star.

    Parameters
    ----------
    points : int
        Number of tips, at least 3.
    semi_diameter : float
        Distance of the tips from the axis in mm, above 0.
    inner_semi_diameter : float
        Distance of the corners between the tips from the axis in mm, above 0 and at most semi_diameter cos(pi /
        points), for which the star is a polygon.
    rotation : float, optional
        Angle of the first tip from +x towards +y, radians.
    thickness, placement
        As of `CircularStop`.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    Examples
    --------
    >>> import plenoptic as pl
    >>> star = pl.StarStop(points=5, semi_diameter=5.0, inner_semi_diameter=2.0)
    >>> star.contains([4.9, -4.9, -1.9], [0.0, 0.0, 0.0]).tolist()
    [True, False, True]
    >>> round(star.area, 3)
    29.389
    """

    points: int
    semi_diameter: float
    inner_semi_diameter: float
    rotation: float = 0.0
    thickness: float = 0.0
    placement: Placement | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        set_place(self)
        set_field(self, "points", whole(self.points, "points", at_least=3, at_most=MAX_CORNERS))
        set_field(self, "inner_semi_diameter", length_in_mm(self.inner_semi_diameter, "inner_semi_diameter"))
        set_field(self, "rotation", radians(self.rotation, "rotation"))
        largest = self.semi_diameter * math.cos(math.pi / self.points)
        if self.inner_semi_diameter > largest * (1 + 1e-12):
            raise InvalidValueError(
                f"inner_semi_diameter is {self.inner_semi_diameter:g} mm; a star of {self.points} points and "
                f"semi_diameter {self.semi_diameter:g} mm has at most {largest:g} mm: reduce it, or use a PolygonStop"
            )

    @property
    def edges(self) -> Floats:
        """(2 points, 4) rows (a, b, p, 0) in pairs, one pair for each corner between two tips.

        Points of the hole satisfy a x + b y <= p for at least one row of each pair, and lie in the circle of the tips.
        """
        half, r = math.pi / self.points, self.inner_semi_diameter
        across, along = r * math.sin(half), self.semi_diameter - r * math.cos(half)
        lean = math.atan2(along, across)
        tip = self.rotation + 2 * half * np.arange(self.points)
        angle = np.stack([tip + lean, tip + 2 * half - lean], axis=1).ravel()
        rows = np.zeros((2 * self.points, 4))
        rows[:, 0], rows[:, 1] = np.cos(angle), np.sin(angle)
        rows[:, 2] = self.semi_diameter * across / math.hypot(across, along)
        return read_only(rows)

    @property
    def area(self) -> float:
        """Area of the hole in mm^2."""
        return self.points * self.semi_diameter * self.inner_semi_diameter * math.sin(math.pi / self.points)

    def contains(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """True for points (x, y), mm, in the hole or on its edge; x and y are broadcast."""
        x, y = broadcast(x=x, y=y)
        inside = x * x + y * y <= self.semi_diameter**2
        for first, second in self.edges.reshape(-1, 2, 4):
            inside &= np.minimum(x * first[0] + y * first[1], x * second[0] + y * second[1]) <= first[2]
        return np.asarray(inside)

    def outline(self, n: int = 64) -> Floats:
        """Points on the edge, counter-clockwise from the first tip, in mm, not closed.

        A (k, 2) array, where k is the smallest multiple of 2 `points` that is at least n: all corners are among the
        points, the others divide the edges evenly.
        """
        angle = self.rotation + math.pi / self.points * np.arange(2 * self.points)
        radius = np.tile([self.semi_diameter, self.inner_semi_diameter], self.points)
        corners = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return subdivide(corners, whole(n, "n", at_least=3, at_most=MAX_POINTS))

    def row(self) -> ElementRow:
        """Record of the stop for kernels."""
        return ElementRow(STAR, self.semi_diameter * self.semi_diameter, edges=tuple(map(tuple, self.edges.tolist())))

    def image(self, scale: float) -> StarStop:
        """Image of the stop by a lens of magnification `scale`: scaled, and rotated by half a turn if negative."""
        size, turn = abs(finite(scale, "scale")), math.pi if scale < 0 else 0.0
        return StarStop(self.points, size * self.semi_diameter, size * self.inner_semi_diameter, self.rotation + turn)

    @property
    def filled_radius(self) -> float:
        """Radius in mm of the largest circle about the axis inside the hole."""
        return self.inner_semi_diameter

    def transmission_at(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Transmission, 1 in the hole and 0 outside, at points (x, y), mm; x and y are broadcast."""
        return np.asarray(self.contains(x, y), dtype=np.float64)

    _repr_html_ = picture_of
