"""Freeform terms: vertex derivatives and bounds of a sag without rotational symmetry, added to a conic or asphere."""

from __future__ import annotations

from typing import NamedTuple


class VertexShape(NamedTuple):
    """Derivatives of the sag at the vertex with respect to x and y in mm."""

    dx: float
    dy: float
    dxx: float
    dxy: float
    dyy: float

    @property
    def curvature(self) -> float:
        """The rotationally symmetric part of the second order, in 1/mm."""
        return 0.5 * (self.dxx + self.dyy)


class FreeformBounds(NamedTuple):
    """Proven bounds in a disc about the vertex."""

    slope: float
    """Largest size of the gradient."""
    bending: float
    """Largest size of the second derivative in any direction, 1/mm."""
    height: float
    """Largest size of the sag in mm."""
    rounding: float
    """Largest rounding error of the sag in mm."""
