"""Stops: thin opaque screens with a hole."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic._values import finite, positive, read_only, set_field, value, whole
from plenoptic.optics.placement import Placement, kept_placement
from plenoptic.optics.surface import checked_gap


@value
class CircularStop:
    """A stop with a round hole, centred on the axis.

    Parameters
    ----------
    semi_diameter : float
        Radius of the hole in mm, above 0.
    thickness : float, optional
        Axial gap to the next element in mm, at least 0. The stop itself is infinitely thin.
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
        set_field(self, "semi_diameter", positive(self.semi_diameter, "semi_diameter", "mm"))
        set_field(self, "thickness", checked_gap(self.thickness))
        set_field(self, "placement", kept_placement(self.placement))

    def contains(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Whether points (x, y), mm, lie in the hole or on its edge; the shape is that of x and y broadcast."""
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        return np.asarray(x * x + y * y <= self.semi_diameter**2)

    def outline(self, n: int = 64) -> NDArray[np.float64]:
        """Points on the edge, counter-clockwise from +x: an (n, 2) array in mm, not closed; n at least 3."""
        angle = 2 * math.pi * np.arange(whole(n, "n", at_least=3)) / n
        return self.semi_diameter * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@value
class PolygonStop:
    """A stop with a hole that is a regular polygon, as the straight blades of an iris leave it.

    Parameters
    ----------
    blades : int
        Number of corners, at least 3.
    semi_diameter : float
        Distance of the corners from the axis (circumradius) in mm, above 0.
    rotation : float, optional
        Angle of the first corner from +x towards +y, radians.
    thickness : float, optional
        Axial gap to the next element in mm, at least 0.
    placement : Placement, optional
        Decentre and tilt; see `LensStack.moved`. None: centred.

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
    """

    blades: int
    semi_diameter: float
    rotation: float = 0.0
    thickness: float = 0.0
    placement: Placement | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        set_field(self, "blades", whole(self.blades, "blades", at_least=3))
        set_field(self, "semi_diameter", positive(self.semi_diameter, "semi_diameter", "mm"))
        set_field(self, "rotation", finite(self.rotation, "rotation"))
        set_field(self, "thickness", checked_gap(self.thickness))
        set_field(self, "placement", kept_placement(self.placement))

    @property
    def apothem(self) -> float:
        """Distance of the edges from the axis in mm: the semi-diameter times cos(pi / blades)."""
        return self.semi_diameter * math.cos(math.pi / self.blades)

    @property
    def normals(self) -> NDArray[np.float64]:
        """Outward unit normals of the edges, (blades, 2); the first edge runs from the first corner to the second."""
        angle = self.rotation + math.pi * (2 * np.arange(self.blades) + 1) / self.blades
        return read_only(np.stack([np.cos(angle), np.sin(angle)], axis=1))

    def contains(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Whether points (x, y), mm, lie in the hole or on its edge; the shape is that of x and y broadcast."""
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        inside = np.ones(np.broadcast_shapes(x.shape, y.shape), dtype=np.bool_)
        for normal_x, normal_y in self.normals:
            inside &= x * normal_x + y * normal_y <= self.apothem
        return inside

    def outline(self, n: int = 64) -> NDArray[np.float64]:
        """Points on the edge, counter-clockwise from the first corner, in mm, not closed.

        A (k, 2) array, where k is the smallest multiple of `blades` that is at least n: all corners are among
        the points, the others divide the edges evenly.
        """
        per_edge = -(-whole(n, "n", at_least=3) // self.blades)
        angle = self.rotation + 2 * math.pi * np.arange(self.blades + 1) / self.blades
        corners = self.semi_diameter * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        along = (np.arange(per_edge) / per_edge)[:, None]
        edges = [a + along * (b - a) for a, b in pairwise(corners)]
        return np.concatenate(edges)


Stop: TypeAlias = CircularStop | PolygonStop
"""Any stop."""
