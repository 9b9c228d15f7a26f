"""Response to direction of dual and quad pixels, whose light is divided among wells; `dual_pixel` makes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, result

INDEX2 = 1.5**2
"""Squared refractive index between the on-chip lenses and the wells."""


@result
class DualPixels:
    """Response of a pixel with an on-chip lens over two or four wells; lengths are in units of the pitch.

    The lens focuses light of one direction on one point: refracted to theta' in the stack between lens and wells, it is
    displaced by depth tan(theta') along both axes, from the place of the chief ray of an exit pupil at
    `pupil_distance`, for which lenses are shifted. Light in gaps is lost, and so is light beyond the pixel, at its
    walls. A `table` of measured responses replaces this geometry.

    Attributes
    ----------
    split : (int, int)
        Rows and columns of wells.
    depth, gap : float
        Distance from the lens to the wells; insensitive width between wells.
    pupil_distance : float
        In mm; inf: no shift.
    crosstalk : (3, 3) array
        Shares of the light of a well that those around it collect: upper row first, columns from the left.
    table : (n, 3) array or None
        Angle in radians, response of the left and of the right well.
    well : (int, int) or None
        Row and column of the well that is read; None: the sum of all.
    """

    split: tuple[int, int]
    depth: float
    gap: float
    pupil_distance: float
    crosstalk: Floats
    table: Floats | None
    well: tuple[int, int] | None = None

    def intervals(self, axis: int) -> Floats:
        """(n, 2) ends of the wells that are read along rows (0, downwards) or columns (1), from the pixel's centre."""
        ends = np.linspace(-0.5, 0.5, self.split[axis] + 1)
        wells = np.stack([ends[:-1] + 0.5 * self.gap, ends[1:] - 0.5 * self.gap], axis=1)
        return wells if self.well is None else wells[self.well[axis]][None]

    def table_response(self) -> Floats:
        """(n, 2) angles of the table, and the response of the well that is read, or of both."""
        assert self.table is not None
        read = self.table[:, 1:].sum(axis=1) if self.well is None else self.table[:, 1 + self.well[1]]
        return np.stack([self.table[:, 0], read], axis=1)

    def halves_at(self, slope_x: Floats, slope_y: Floats, x: Floats, y: Floats) -> Floats:
        """Responses (2, ...) of the left and right wells to light from (slope_x, slope_y, -1) at points of the sensor.

        All rows count. Points are in mm.
        """
        chief_x, chief_y = -x / self.pupil_distance, -y / self.pupil_distance
        if self.table is not None:
            angle = np.arctan(slope_x) - np.arctan(chief_x)
            return np.stack([np.interp(angle, self.table[:, 0], half) for half in self.table.T[1:]])
        across = self.depth * (_slope_inside(slope_x, slope_y) - _slope_inside(chief_x, chief_y))
        down = -self.depth * (_slope_inside(slope_y, slope_x) - _slope_inside(chief_y, chief_x))
        in_rows, halves = (
            [(place >= low) & (place < high) for low, high in self.intervals(axis)]
            for axis, place in enumerate((down, across))
        )
        return np.asarray(np.stack(halves) * np.logical_or.reduce(in_rows), dtype=np.float64)


def _slope_inside(slope: ArrayLike, other: ArrayLike) -> Floats:
    """Slope in the stack: by Snell's law the sines along both axes shrink by the index."""
    return np.asarray(slope / np.sqrt(INDEX2 + (INDEX2 - 1.0) * (np.square(slope) + np.square(other))))
