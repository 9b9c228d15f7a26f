"""Openings of microlenses and the gaps between them."""

from __future__ import annotations

import enum
import math

import numpy as np

from plenoptic.core.values import Floats, choice, positive, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.lattice import polygon_area, polygon_edges, regular_polygon

_CIRCLE_SIDES = 24
"""Sides of the polygon around a round opening, in which points are sampled: 0.6 % larger than the circle."""


class ApertureShape(enum.IntEnum):
    """The shape of a microlens's opening. See `MicrolensAperture`."""

    CELL = 0
    """The shape of the lattice's cell."""
    CIRCLE = 1
    SQUARE = 2
    """Sides along x and y."""
    HEXAGON = 3
    """Corners on the x-axis, as the cell of the hexagonal lattice has them."""


class Gaps(enum.IntEnum):
    """Gaps between the openings. See `MicrolensAperture`."""

    OPAQUE = 0
    """No light passes, as through chromium."""
    CLEAR = 1
    """Flat glass: light passes unrefracted."""


class Walls(enum.IntEnum):
    """Walls between neighbouring cells, from the array to the sensor. See `MicrolensArray`."""

    NONE = 0
    """None: a microlens illuminates all of the sensor, as in plenoptic cameras."""
    OPAQUE = 1
    """Walls along the array's normal: a lens illuminates only the area behind its cell, as in an array of cameras."""


@value
class MicrolensAperture:
    """Opening of every microlens of an array, centred on the lens and clipped by its cell.

    Parameters
    ----------
    shape : ApertureShape
    fill_factor : float
        Area of the opening over that of the cell, above 0 and at most 1. A circle that extends beyond the cell
        is an error: the largest fills 0.90689 (pi / sqrt 12) of a hexagonal and 0.78539 (pi / 4) of a square cell.
    gaps : Gaps
        Transmission between the openings.

    Raises
    ------
    InvalidValueError
        If the fill factor is out of range, or shape or gaps are no members of their enums.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round_ones, glass = pl.optics.ApertureShape.CIRCLE, pl.optics.Gaps.CLEAR
    >>> aperture = pl.optics.MicrolensAperture(round_ones, fill_factor=0.8, gaps=glass)
    >>> array = pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), aperture=aperture)
    >>> f"{array.opening.radius:.4f} mm"
    '0.0939 mm'
    """

    shape: ApertureShape = ApertureShape.CELL
    fill_factor: float = 1.0
    gaps: Gaps = Gaps.OPAQUE

    def __post_init__(self) -> None:
        set_field(self, "shape", choice(self.shape, ApertureShape, "shape of the aperture"))
        set_field(self, "gaps", choice(self.gaps, Gaps, "gaps"))
        set_field(self, "fill_factor", positive(self.fill_factor, "fill_factor"))
        if self.fill_factor > 1:
            raise InvalidValueError(
                f"fill_factor is {self.fill_factor:g}; an opening covers at most the whole cell: give at most 1"
            )


@value
class Opening:
    """An aperture in mm: a convex polygon for sampling, and a circle that clips it if round. See `MicrolensAperture`.

    Parameters
    ----------
    corners : (k, 2) array
        Counter-clockwise, relative to the lens.
    radius : float
        Radius of a round opening; inf for polygons.
    """

    corners: Floats
    radius: float = math.inf

    @property
    def reach(self) -> float:
        """Distance from the lens to the farthest point of its opening in mm."""
        return self.radius if math.isfinite(self.radius) else float(np.hypot(*self.corners.T).max())

    @property
    def edges(self) -> Floats:
        """(k, 3) outward normals and distances of the edges; empty for a round opening."""
        return np.zeros((0, 3)) if math.isfinite(self.radius) else polygon_edges(self.corners)


def has_clear_gaps(aperture: MicrolensAperture | None) -> bool:
    """True if light passes through the gaps between openings."""
    return aperture is not None and aperture.gaps is Gaps.CLEAR


def opening_of(aperture: MicrolensAperture, cell: Floats) -> Opening:
    """Opening of an aperture in a cell (k, 2); an error if it extends beyond the cell."""
    area = aperture.fill_factor * polygon_area(cell)
    if aperture.shape is ApertureShape.CELL:
        return Opening(math.sqrt(aperture.fill_factor) * cell)
    if aperture.shape is ApertureShape.CIRCLE:
        radius = math.sqrt(area / math.pi)
        corners = regular_polygon(_CIRCLE_SIDES, radius / math.cos(math.pi / _CIRCLE_SIDES), 0.0)
        fits = radius <= polygon_edges(cell)[:, 2].min() * (1 + 1e-9)
        largest = math.pi * polygon_edges(cell)[:, 2].min() ** 2 / polygon_area(cell)
    else:
        sides, first = (4, math.pi / 4) if aperture.shape is ApertureShape.SQUARE else (6, 0.0)
        unit = regular_polygon(sides, 1.0, first)
        corners, radius = math.sqrt(area / polygon_area(unit)) * unit, math.inf
        edges = polygon_edges(cell)
        excess = float(((corners @ edges[:, :2].T) / edges[:, 2]).max())
        fits, largest = excess <= 1 + 1e-9, aperture.fill_factor / excess**2
    if not fits:
        raise InvalidValueError(
            f"fill_factor {aperture.fill_factor:g} makes the {aperture.shape.name.lower()} stick out of its cell; "
            f"the largest that fits is {math.floor(1e5 * largest) / 1e5:g}"
        )
    return Opening(corners, radius)
