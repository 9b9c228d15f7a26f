"""Polygonal stops, formed by the blades of an iris."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import (
    LARGEST_LENGTH,
    MAX_POINTS,
    Floats,
    broadcast,
    finite,
    number,
    radians,
    read_only,
    set_field,
    value,
    whole,
)
from plenoptic.errors import InvalidValueError
from plenoptic.optics.element_record import ARCS, POLYGON, ElementRow
from plenoptic.optics.lens.placement import Placement, set_place

MAX_CORNERS = 1024
"""Largest number of blades: kernels test all edges, and a polygon of more differs from a circle by 5e-6 of its
radius."""

_ROUNDING = 1e-12
"""Relative tolerance of a radius at its limit: common scaling of lengths has rounding errors."""


@value
class PolygonStop:
    """A stop whose hole is a regular polygon, formed by the blades of an iris.

    Parameters
    ----------
    blades : int
        Number of corners, at least 3.
    semi_diameter : float
        Distance of the corners from the axis (circumradius) in mm, above 0.
    rotation : float, optional
        Angle of the first corner from +x towards +y, radians.
    blade_radius : float, optional
        Radius in mm of the circular edges of the blades, from corner to corner; inf (default): straight. Positive: the
        hole bulges outwards, at least `semi_diameter`, for which it is a circle. Negative: the blades bulge into the
        hole, in size at least semi_diameter tan(pi / blades), for which neighbours touch.
    thickness, placement
        As of `CircularStop`.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    Examples
    --------
    >>> import plenoptic as pl
    >>> stop = pl.PolygonStop(blades=6, semi_diameter=5.0)
    >>> round(stop.apothem, 6)
    4.330127
    >>> stop.contains([4.9, 0.0], [0.0, 4.9]).tolist()
    [True, False]
    >>> round(pl.PolygonStop(blades=6, semi_diameter=5.0, blade_radius=8.0).apothem, 6)
    4.730785
    """

    blades: int
    semi_diameter: float
    rotation: float = 0.0
    thickness: float = 0.0
    blade_radius: float = dataclasses.field(default=math.inf, kw_only=True)
    placement: Placement | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        set_place(self)
        set_field(self, "blades", whole(self.blades, "blades", at_least=3, at_most=MAX_CORNERS))
        set_field(self, "rotation", radians(self.rotation, "rotation"))
        set_field(self, "blade_radius", self._checked_blade_radius())

    def _checked_blade_radius(self) -> float:
        radius = number(self.blade_radius, "blade_radius")
        inwards = self.semi_diameter * math.tan(math.pi / self.blades)
        if radius >= self.semi_diameter * (1 - _ROUNDING) or radius <= -inwards * (1 - _ROUNDING):
            return radius if abs(radius) <= LARGEST_LENGTH else math.inf  # -inf means straight, as inf
        raise InvalidValueError(
            f"blade_radius is {radius:g} mm; for {self.blades} blades it must be at least {self.semi_diameter:g} mm, "
            f"or at most {-inwards:g} mm for blades that bulge into the hole: math.inf makes them straight"
        )

    @property
    def apothem(self) -> float:
        """Distance of the middles of the edges from the axis in mm: semi_diameter cos(pi / blades) if straight."""
        # The arc's height over half its chord h: R - sqrt(R^2 - h^2), without its cancellation.
        sine = self._half_chord / self.blade_radius
        root = math.sqrt(max(1.0 - sine * sine, 0.0))
        return self.semi_diameter * math.cos(math.pi / self.blades) + self._half_chord * (sine / (1.0 + root))

    @property
    def normals(self) -> Floats:
        """Outward unit normals of the edges, (blades, 2); the first edge runs from the first corner to the second."""
        angle = self.rotation + math.pi * (2 * np.arange(self.blades) + 1) / self.blades
        return read_only(np.stack([np.cos(angle), np.sin(angle)], axis=1))

    @property
    def edges(self) -> Floats:
        """(blades, 4) rows (a, b, p, q): points of the hole satisfy a x + b y + q (x^2 + y^2) <= p for all rows. They
        also lie in the hole's circle. With the curvature c of the edges and their apothem p0, (a, b) is the normal
        times 1 - c p0, q is c / 2 and p is p0 (1 - c p0 / 2): one formula, accurate for large radii, covers straight,
        outward and inward edges.
        """
        curvature, foot = 1.0 / self.blade_radius, self.apothem
        rows = np.empty((self.blades, 4))
        rows[:, :2] = (1.0 - curvature * foot) * self.normals
        rows[:, 2:] = foot * (1.0 - 0.5 * curvature * foot), 0.5 * curvature
        return read_only(rows)

    @property
    def area(self) -> float:
        """Area of the hole in mm^2: the polygon and the segments between arcs and chords."""
        half_angle = math.asin(max(-1.0, min(1.0, self._half_chord / self.blade_radius)))
        segment = 0.0 if half_angle == 0 else (self._half_chord / math.sin(half_angle)) ** 2 * _segment(half_angle)
        return self.blades * (0.5 * self.semi_diameter**2 * math.sin(2 * math.pi / self.blades) + segment)

    @property
    def _half_chord(self) -> float:
        return self.semi_diameter * math.sin(math.pi / self.blades)

    def contains(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """True for points (x, y), mm, in the hole or on its edge; x and y are broadcast."""
        x, y = broadcast(x=x, y=y)
        curved = math.isfinite(self.blade_radius)
        r2 = x * x + y * y
        inside = r2 <= self.semi_diameter**2 if curved else np.ones(r2.shape, dtype=np.bool_)
        for a, b, limit, quadratic in self.edges:
            inside &= x * a + y * b + (quadratic * r2 if curved else 0.0) <= limit
        return np.asarray(inside)

    def outline(self, n: int = 64) -> Floats:
        """Points on the edge, counter-clockwise from the first corner, in mm, not closed.

        A (k, 2) array, where k is the smallest multiple of `blades` that is at least n: all corners are among
        the points, the others divide the edges evenly.
        """
        per_edge = -(-whole(n, "n", at_least=3, at_most=MAX_POINTS) // self.blades)
        angle = self.rotation + 2 * math.pi * np.arange(self.blades + 1) / self.blades
        corners = self.semi_diameter * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        along, out = np.arange(per_edge) / per_edge, np.zeros(per_edge)
        if math.isfinite(self.blade_radius):
            # Equal steps of the angle 2 alpha of an arc: sines along the chord, and the height above it.
            alpha = math.asin(max(-1.0, min(1.0, self._half_chord / self.blade_radius)))
            turn = alpha * (2 * along - 1)
            along = 0.5 * (1.0 + np.sin(turn) / math.sin(alpha))
            out = self._half_chord * 2 * np.sin(0.5 * (alpha + turn)) * np.sin(0.5 * (alpha - turn)) / math.sin(alpha)
        edges = zip(pairwise(corners), self.normals, strict=True)
        return np.concatenate([a + along[:, None] * (b - a) + out[:, None] * normal for (a, b), normal in edges])

    def row(self) -> ElementRow:
        """Record of the stop for kernels."""
        kind = POLYGON if math.isinf(self.blade_radius) else ARCS
        return ElementRow(kind, self.semi_diameter * self.semi_diameter, edges=tuple(map(tuple, self.edges.tolist())))

    def image(self, scale: float) -> PolygonStop:
        """Image of the stop by a lens of magnification `scale`: scaled, and rotated by half a turn if negative."""
        size, turn = abs(finite(scale, "scale")), math.pi if scale < 0 else 0.0
        bulge = size * self.blade_radius
        return PolygonStop(self.blades, size * self.semi_diameter, self.rotation + turn, blade_radius=bulge)

    @property
    def filled_radius(self) -> float:
        """Radius in mm of the largest circle about the axis inside the hole."""
        return self.apothem

    def transmission_at(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Transmission, 1 in the hole and 0 outside, at points (x, y), mm; x and y are broadcast."""
        return np.asarray(self.contains(x, y), dtype=np.float64)

    _repr_html_ = picture_of


def subdivide(corners: Floats, n: int) -> Floats:
    """Corners (k, 2) of a polygon, and points that divide its edges evenly: at least n in all, not closed."""
    per_edge = -(-n // len(corners))
    fraction = np.arange(per_edge) / per_edge
    following = np.roll(corners, -1, axis=0)
    return np.asarray((corners[:, None] + fraction[:, None] * (following - corners)[:, None]).reshape(-1, 2))


def convex_hull(points: Floats) -> Floats:
    """Corners of the convex hull of points (n, 2), counter-clockwise, by Andrew's monotone chain."""
    ordered = np.unique(points, axis=0).tolist()
    chains: list[list[list[float]]] = []
    for run in (ordered, ordered[::-1]):
        chain: list[list[float]] = []
        for x, y in run:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                    break
                chain.pop()
            chain.append([x, y])
        chains.append(chain[:-1])
    return np.array([*chains[0], *chains[1]])


def _segment(half_angle: float) -> float:
    """Area between arc and chord of a circle of radius 1 for half the arc's angle, odd in the angle.

    It is a - sin a cos a, by a series for small angles, which keeps all digits.
    """
    if abs(half_angle) > 0.1:
        return half_angle - math.sin(half_angle) * math.cos(half_angle)
    x2 = (2.0 * half_angle) ** 2
    series = 1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0 * (1.0 - x2 / 110.0)))
    return half_angle**3 * (2.0 / 3.0) * series
