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
    if array.centres is None:
        return lenses_of(array, _lattice_indices(array, low, high))
    number = np.flatnonzero(((array.centres >= low) & (array.centres <= high)).all(axis=1))
    return lenses_of(array, np.stack([number, np.zeros_like(number)], axis=1))


def types_of(array: MicrolensArray, index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Types (n,) of the lenses with lattice indices (n, 2), which are (number, 0) for FREE."""
    if array.lattice is Lattice.FREE:
        return np.zeros(len(index), np.int64) if array.types is None else array.types[index[:, 0]]
    pattern = array.type_pattern
    return np.asarray(pattern[index[:, 0] % pattern.shape[0], index[:, 1] % pattern.shape[1]])


def _lattice_indices(array: MicrolensArray, low: Floats, high: Floats) -> NDArray[np.int64]:
    low, high = np.maximum(low, -array.half_extent), np.minimum(high, array.half_extent)
    if not np.isfinite([low, high]).all():
        raise InvalidValueError(f"the box from {low} to {high} is infinite, and so is the lattice; take a smaller one")
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])]) @ np.linalg.inv(array.basis)
    first, last = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    if (first > last).any():
        return np.empty((0, 2), np.int64)
    if (last - first + 1).prod() > MAX_LENSES:
        raise InvalidValueError(
            f"the box holds some {(last - first + 1).prod():.3g} microlenses, and the limit is {MAX_LENSES}; "
            "take a smaller one"
        )
    i, j = (np.arange(int(first[k]), int(last[k]) + 1) for k in range(2))
    index = np.stack(np.meshgrid(i, j, indexing="ij"), axis=-1).reshape(-1, 2)
    centres = index @ array.basis
    # Rounding must not lose a lens on the border of the box.
    slack = 1e-9 * np.abs(array.basis).max(axis=0)
    return np.asarray(index[((centres >= low - slack) & (centres <= high + slack)).all(axis=1)])


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
