"""Freeform term: the sag that a surface without rotational symmetry adds to its conic or asphere."""

from __future__ import annotations

from typing import NamedTuple


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
