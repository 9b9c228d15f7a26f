"""Individual microlenses of an array's description."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.imperfections import deviations_of
from plenoptic.optics.microlens.lattice import Lattice

if TYPE_CHECKING:
    from plenoptic.optics.microlens.array import MicrolensArray

MAX_LENSES = 20_000_000
"""Limit of the number of microlenses that are listed at once."""


@value
class Lenslets:
    """Microlenses of an array as columns, ordered by their indices; made by `MicrolensArray.lenses`.

    Parameters
    ----------
    index : (n, 2) array of int
        Lattice indices (i, j); in FREE lattices (number, 0).
    design : (n, 2) array
        Design centres, in mm on the plane of the array.
    centre : (n, 2) array
        Centres of the displaced openings, or of the cells if lenses fill them.
    axis : (n, 2) array
        Positions of the optical axes.
    type : (n,) array of int
        Row of the array's `focal_lengths`.
    power : (n,) array
        1 / focal length in 1/mm; 0 for flat glass.
    transmission : (n,) array
        0 for dark lenses, 1 for clear ones.
    """

    index: NDArray[np.int64]
    design: Floats
    centre: Floats
    axis: Floats
    type: NDArray[np.int64]
    power: Floats
    transmission: Floats

    def __len__(self) -> int:
        return len(self.index)


def lenslets(array: MicrolensArray, low: Floats, high: Floats) -> Lenslets:
    """Microlenses whose design centres lie in a box."""
    if np.isnan(low).any() or np.isnan(high).any():
        raise InvalidValueError(f"the box from {low} to {high} has a corner that is no number; give two points in mm")
    _, index = lenses_in_boxes(array, low[None], high[None])
    return lenses_of(array, index)


def types_of(array: MicrolensArray, index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Types (n,) of the lenses with lattice indices (n, 2), which are (number, 0) for FREE."""
    if array.lattice is Lattice.FREE:
        return np.zeros(len(index), np.int64) if array.types is None else array.types[index[:, 0]]
    pattern = array.type_pattern
    return np.asarray(pattern[index[:, 0] % pattern.shape[0], index[:, 1] % pattern.shape[1]])


def lenses_in_boxes(array: MicrolensArray, low: Floats, high: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Lattice indices (k, 2) of the microlenses whose design centres lie in boxes (n, 2), and the box of each (k,)."""
    if array.centres is not None:
        lists = [
            np.flatnonzero(((array.centres >= first) & (array.centres <= last)).all(axis=1))
            for first, last in zip(low, high, strict=True)
        ]
        number = np.concatenate([np.empty(0, np.int64), *lists])
        return np.repeat(np.arange(len(low)), [len(part) for part in lists]), np.column_stack([number, 0 * number])
    low, high = np.maximum(low, -array.half_extent), np.minimum(high, array.half_extent)
    if np.isinf([low, high]).any():
        raise InvalidValueError(f"the box from {low} to {high} is infinite, and so is the lattice; take a smaller one")
    # Rounding must not lose a lens on the border of the box.
    slack = 1e-9 * np.abs(array.basis).max(axis=0)
    low, high = low - slack, high + slack
    corners = np.stack([low, np.column_stack([low[:, 0], high[:, 1]]), np.column_stack([high[:, 0], low[:, 1]]), high])
    first = (corners @ np.linalg.inv(array.basis))[..., 0]
    start, end = np.floor(first.min(axis=0)), np.ceil(first.max(axis=0))
    box, row = _ranges(start, end, np.arange(len(low)), np.all(low <= high, axis=1))
    # Along each row the box is an interval in either coordinate.
    offset, step = row[:, None] * array.basis[0], array.basis[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([(low[box] - offset) / step, (high[box] - offset) / step], axis=0)
    crossed = (low[box] <= offset) & (offset <= high[box])
    ends = np.where(step == 0, np.where(crossed, [[[-np.inf]], [[np.inf]]], np.nan), ends)
    start, end = np.ceil(ends[0].max(axis=1)), np.floor(ends[1].min(axis=1))
    of_row, column = _ranges(start, end, box, start <= end)
    return box[of_row], np.column_stack([row[of_row], column])


def _ranges(
    start: Floats, end: Floats, box: NDArray[np.int64], chosen: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Whole numbers (k,) from start to end (n,) of the chosen rows of boxes, and the row of each."""
    sizes = np.where(chosen, end - start + 1, 0.0)
    if (count := np.bincount(box, sizes).max(initial=0)) > MAX_LENSES:
        raise InvalidValueError(
            f"the box holds some {count:.3g} microlenses, and the limit is {MAX_LENSES}; take a smaller one"
        )
    counts = sizes.astype(np.int64)
    row = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    return row, np.where(chosen, start, 0.0).astype(np.int64)[row] + place


def lenses_of(array: MicrolensArray, index: NDArray[np.int64]) -> Lenslets:
    """Lenses with lattice indices (n, 2), which are (number, 0) for FREE, with their deviations."""
    design = index @ array.basis if array.centres is None else array.centres[index[:, 0]]
    types = types_of(array, index)
    power = 1.0 / np.asarray(array.focal_lengths)[types]
    centre, transmission = design, np.ones(len(index))
    axis = centre
    if array.imperfections is not None:
        deviations = deviations_of(array.imperfections, index)
        displaced = design if deviations.shift is None else design + deviations.shift
        axis = displaced if deviations.decentre is None else displaced + deviations.decentre
        # A lens that fills its cell keeps its size.
        centre = design if array.aperture is None else displaced
        if deviations.focal_length_factor is not None:
            power = power / deviations.focal_length_factor
        if deviations.transmission is not None:
            transmission = deviations.transmission
    return Lenslets(index, design, centre, axis, types, power, transmission)
