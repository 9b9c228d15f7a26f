"""Lattice of micro images in a raw image, with rows as other programs count them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.core.values import Floats, check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.rendering.exposure import Exposure


class Direction(NamedTuple):
    """A direction of rows in a lattice."""

    step: tuple[int, int]
    """From a lens to the next one of its row, in lattice indices."""
    row: tuple[int, int]
    """The product of the indices with this is constant along a row."""
    along: tuple[int, int]
    """The product of the indices with this is twice the place along a row."""


_SQUARE = (Direction((1, 0), (0, 1), (2, 0)), Direction((0, 1), (1, 0), (0, 2)))
# The vectors of a hexagonal lattice enclose 60 degrees.
_HEXAGONAL = (Direction((1, 0), (0, 1), (2, 1)), Direction((0, 1), (1, 0), (1, 2)), Direction((1, -1), (1, 1), (1, -1)))


class LensRows(NamedTuple):
    """Micro images of a raw image in rows, in the image turned by `turns` quarters, counter-clockwise."""

    camera: PlenopticCamera
    turns: int
    lens: NDArray[np.int64]
    """(n, 2) lattice indices."""
    type: NDArray[np.int64]
    """(n,)"""
    centre: Floats
    """(n, 2) row and column of the turned image."""
    row: NDArray[np.int64]
    """(n,) which row of lenses, from above."""
    place: NDArray[np.int64]
    """(n,) which lens of its row, from the left; `shifted` rows lie half a pitch farther right."""
    shifted: NDArray[np.bool_]
    """(n,) every other row of hexagonal lattices."""
    angle: float
    """Angle of the rows to those of the turned image, counter-clockwise, in radians."""
    pitch: tuple[float, float]
    """Distance of neighbours along a row, and of rows, in pixels."""

    @property
    def array(self) -> MicrolensArray:
        """The microlenses."""
        return _array(self.camera)

    @property
    def hexagonal(self) -> bool:
        """True for a hexagonal lattice."""
        return self.array.lattice is Lattice.HEXAGONAL

    def turn_image(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """An image (H, W, C) turned as the centres are."""
        return np.rot90(image, self.turns)

    def whole(self, shape: tuple[int, int]) -> LensRows:
        """The lenses whose images lie wholly in an image of a shape, before it is turned."""
        size = np.array(shape if self.turns % 2 == 0 else shape[::-1])
        half = 0.5 * self.pitch[0]
        inside = ((self.centre >= half - 0.5) & (self.centre <= size - 0.5 - half)).all(axis=1)
        return self.select(np.asarray(inside))

    def select(self, kept: NDArray[Any]) -> LensRows:
        """Some of the lenses, by a mask or their numbers."""
        names = ("lens", "type", "centre", "row", "place", "shifted")
        return self._replace(**{name: getattr(self, name)[kept] for name in names})

    def rectangle(self) -> LensRows:
        """Lenses of a rectangle of rows and places without gaps, counted from 0, as large as a few steps find it."""
        rows = np.unique(self.row)
        ends = {row: (self.place[self.row == row].min(), self.place[self.row == row].max()) for row in rows.tolist()}
        first, last = int(rows[0]), int(rows[-1])

        def size(low: int, high: int) -> tuple[int, int, int]:
            left = max(ends[row][0] for row in range(low, high + 1))
            right = min(ends[row][1] for row in range(low, high + 1))
            return (high - low + 1) * max(right - left + 1, 0), left, right

        while first < last:
            best = max((size(first + 1, last)[0], first + 1, last), (size(first, last - 1)[0], first, last - 1))
            if 0 < size(first, last)[0] >= best[0]:
                break
            _, first, last = best
        _, left, right = size(first, last)
        inside = (self.row >= first) & (self.row <= last) & (self.place >= left) & (self.place <= right)
        order = np.flatnonzero(inside)[np.lexsort((self.place[inside], self.row[inside]))]
        ordered = self.select(order)
        return ordered._replace(row=ordered.row - first, place=ordered.place - left)


def lens_rows(shot: Exposure, *, turn: bool, method: CentreMethod = CentreMethod.CHIEF_RAY) -> LensRows:
    """Lattice of the micro images of an exposure.

    With `turn`, the image is to be turned by a quarter where its rows of lenses run rather along columns. Only lenses
    whose centres lie in the image are listed.
    """
    check_kind(shot, "shot", Exposure, "pl.render(scene, camera)")
    camera = shot.camera
    if camera is None:
        raise InvalidValueError("the exposure names no camera; give one that render made")
    array = _array(camera)
    if array.lattice is Lattice.FREE:
        raise InvalidValueError("the microlenses lie on no lattice, which this program needs; use pl.package")
    centres = microlens_centres(camera, method)
    first = (0, 0) if shot.region is None else (shot.region[0], shot.region[2])
    pixel, size = centres.pixel - first, np.array(shot.image.shape[:2])
    inside = ((pixel >= -0.5) & (pixel <= size - 0.5)).all(axis=1)
    if np.count_nonzero(inside) < 3:
        raise InvalidValueError("the image holds fewer than three micro images; take a larger region")
    index, pixel, kind = centres.index[inside], pixel[inside], centres.type[inside]
    directions = _HEXAGONAL if array.lattice is Lattice.HEXAGONAL else _SQUARE
    table, candidates = np.column_stack([index, np.ones(len(index))]), []
    for turns in (0, 1) if turn else (0,):
        # A quarter counter-clockwise takes (row, column) to (columns - 1 - column, row).
        places = pixel if turns == 0 else np.column_stack([size[1] - 1 - pixel[:, 1], pixel[:, 0]])
        steps = np.linalg.lstsq(table, places, rcond=None)[0][:2]  # of each lattice index
        for direction in directions:
            down, right = np.array(direction.step) @ steps
            angle = math.remainder(math.atan2(-down, right), math.pi)
            candidates.append((round(abs(angle), 6), turns, angle, direction, places, steps))
    _, turns, angle, direction, places, steps = min(candidates, key=lambda entry: entry[:2])
    # Rows count downwards, places to the right.
    across = np.array(direction.along) * np.sign((np.array(direction.step) @ steps)[1])
    twice = index @ across.astype(np.int64)
    row = index @ np.array(direction.row)
    next_row = np.linalg.lstsq(np.column_stack([row, twice, np.ones(len(row))]), places, rcond=None)[0][0]
    row = row * int(np.sign(next_row[0]))
    twice = twice - twice.min()
    length = float(np.hypot(*(np.array(direction.step) @ steps)))
    pitch = length, abs(float(np.linalg.det(steps))) / length
    rows = row - row.min(), twice // 2, twice % 2 == 1
    return LensRows(camera, turns, index, kind, places, *rows, angle, pitch)


def _array(camera: PlenopticCamera) -> MicrolensArray:
    if camera.microlenses is None:
        raise InvalidValueError("the camera has no microlenses, and its image is a single view; use shot.save")
    return camera.microlenses
