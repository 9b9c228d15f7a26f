"""What a surface without rotational symmetry adds to its conic or asphere."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from numpy.typing import ArrayLike

from plenoptic.core.values import Floats


class VertexShape(NamedTuple):
    """Derivatives of the sag at the vertex, by x and y in mm."""

    dx: float
    dy: float
    dxx: float
    dxy: float
    dyy: float

    @property
    def curvature(self) -> float:
        """The rotationally symmetric part of the second order, in 1/mm."""
        return 0.5 * (self.dxx + self.dyy)


class DepartureBounds(NamedTuple):
    """Proven bounds in a disc about the vertex."""

    slope: float
    """Size of the gradient."""
    bending: float
    """Size of the second derivative in any direction, 1/mm."""
    height: float
    """Size of the sag in mm."""
    rounding: float
    """What rounding may leave of the sag, in mm."""


class Departure(Protocol):
    """An added sag, 0 at the vertex: a frozen value. `registry` lists those that there are."""

    def sag(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Added height in mm at points (x, y), mm."""

    def gradient(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """(2, ...) derivatives of the sag by x and y."""

    @property
    def vertex(self) -> VertexShape:
        """What paraxial rays see of it."""

    def bounds(self, radius: float) -> DepartureBounds:
        """Bounds up to a distance from the vertex in mm."""

    def numbers(self) -> tuple[float, ...]:
        """What its kernel reads; the first one is its kind."""
