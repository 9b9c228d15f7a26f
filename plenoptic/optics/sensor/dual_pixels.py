"""Response to direction of dual and quad pixels, whose light is divided among wells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, Given, frozen_array, not_negative, number, positive, set_field, value
from plenoptic.errors import InvalidValueError

INDEX2 = 1.5**2
"""Squared refractive index between the on-chip lenses and the wells."""
_ROUNDING = 1e-6


@value
class DualPixels:
    """Response of a pixel with an on-chip lens over two or four wells, in units of the pitch. Made by `dual_pixel`.

    The lens focuses light of one direction on one point: refracted to theta' in the stack between lens and wells, it is
    displaced by depth tan(theta') along both axes, from the place of the chief ray of an exit pupil at
    `pupil_distance`, for which lenses are shifted. Light in gaps is lost, and so is light beyond the pixel, at its
    walls. A `table` of measured responses replaces this geometry.

    Parameters
    ----------
    split : (int, int)
        Rows and columns of wells.
    depth, gap : float
        Distance from the lens to the wells; insensitive width between wells.
    pupil_distance : float
        In mm; inf: no shift.
    crosstalk : (3, 3) array
        Shares of the light of a well that those around it collect: upper row first, columns from the left. A number is
        that of four neighbours together.
    table : (n, 3) array or None
        Angle in radians, response of the left and of the right well.
    well : (int, int) or None
        Row and column of the well that is read; None: the sum of all.
    """

    split: tuple[int, int]
    depth: float
    gap: float
    pupil_distance: float
    crosstalk: Given[Floats, ArrayLike]
    table: Given[Floats | None, ArrayLike | None] = Given(default=None)
    well: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        set_field(self, "split", _checked_pair(self.split, "split", [(1, 2), (2, 2)]))
        set_field(self, "depth", positive(self.depth, "depth"))
        set_field(self, "gap", not_negative(self.gap, "gap"))
        if not self.gap < 0.5:
            raise InvalidValueError(f"gap is {self.gap:g} pitches; two wells leave room below 0.5 pitches")
        if not number(self.pupil_distance, "pupil_distance") > 0:
            raise InvalidValueError(f"pupil_distance is {self.pupil_distance:g} mm; it must be above 0, or inf")
        set_field(self, "crosstalk", _checked_crosstalk(self.crosstalk))
        if self.table is not None:
            set_field(self, "table", _checked_table(self.table, self.split))
        if self.well is not None:
            set_field(self, "well", _checked_pair(self.well, "well", list(np.ndindex(self.split))))

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


def _checked_pair(pair: object, name: str, choices: list[tuple[int, ...]]) -> tuple[int, ...]:
    if isinstance(pair, tuple | list) and all(isinstance(n, int) for n in pair) and tuple(pair) in choices:
        return tuple(pair)
    raise InvalidValueError(f"{name} is {pair!r:.60}; it must be {' or '.join(map(str, choices))}, rows and columns")


def _checked_crosstalk(crosstalk: ArrayLike) -> Floats:
    """(3, 3) shares of the wells around one."""
    if not isinstance(crosstalk, tuple | list | np.ndarray):
        loss = not_negative(crosstalk, "crosstalk")  # type: ignore[arg-type]
        crosstalk = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) * loss / 4
        crosstalk[1, 1] = 1.0 - loss
    shares = frozen_array(crosstalk, name="crosstalk", shape=(3, 3))
    if not (shares.min() >= 0 and abs(shares.sum() - 1.0) <= _ROUNDING):
        raise InvalidValueError(
            f"crosstalk has shares from {shares.min():g}, which add up to {shares.sum():g}; give one number from 0 to "
            "1, or the shares of 3 x 3 wells, which are not negative and add up to 1"
        )
    return shares


def _checked_table(table: ArrayLike, split: tuple[int, int]) -> Floats:
    if split != (1, 2):
        raise InvalidValueError("a table has the responses of two wells; leave split at (1, 2)")
    rows = frozen_array(table, name="table", shape=("angles", 3))
    if not (len(rows) > 1 and (np.diff(rows[:, 0]) > 0).all() and np.abs(rows[:, 0]).max() < math.pi / 2):
        raise InvalidValueError(
            "table must have two or more angles, rising, within -pi / 2 and pi / 2 (90 degrees); angles of an array "
            "are in radians: np.radians(...)"
        )
    darkest, brightest = rows[:, 1:].min(), rows[:, 1:].sum(axis=1).max()
    if not (darkest >= 0 and brightest <= 1 + _ROUNDING):
        raise InvalidValueError(
            f"table has responses from {darkest:g}, and up to {brightest:g} of both wells; they must be at least 0 and "
            "add up to at most 1: divide them by the largest sum"
        )
    return rows
