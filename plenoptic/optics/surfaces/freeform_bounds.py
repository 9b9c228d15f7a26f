"""Data of freeform terms: derivatives and bounds of a sag without rotational symmetry, and its Zemax numbers."""

from __future__ import annotations

from collections.abc import Mapping
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
        """Mean curvature: the rotationally symmetric part of the second order, in 1/mm."""
        return 0.5 * (self.dxx + self.dyy)


class FreeformBounds(NamedTuple):
    """Proven bounds in a disc about the vertex."""

    slope: float
    """Largest magnitude of the gradient."""
    bending: float
    """Largest magnitude of the second derivative in any direction, 1/mm."""
    height: float
    """Largest magnitude of the sag in mm."""
    rounding: float
    """Largest rounding error of the sag in mm."""


class ZemaxNumbers(NamedTuple):
    """Numbers of a surface in a Zemax file from which a freeform term is made."""

    curvature: float
    """CURV, in 1/mm."""
    conic: float
    """CONI."""
    parameters: Mapping[int, float]
    """PARM by number, lengths in units of the file; missing ones are 0."""
    extra: Mapping[int, float]
    """XDAT by number, lengths in units of the file; missing ones are 0."""
    unit: float
    """Unit of the file in mm."""
