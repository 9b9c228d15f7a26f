"""Arguments and results of the methods of microlens models."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

if TYPE_CHECKING:
    from plenoptic.optics.microlens.microlens_record import ArrayRecord, SensorPlane

Pair: TypeAlias = tuple[Floats, Floats]
"""x and y of n points, or n slopes."""
LensletRows: TypeAlias = NDArray[np.void] | None
"""Lenslet parameters of n paths, rows of `MICROLENS`; None if lenses do not differ."""
Waves: TypeAlias = NDArray[np.int64] | None
"""Numbers of the wavelengths sampled by n paths; None for the camera's."""


class Depths(NamedTuple):
    """Distances along the axis of a lens in mm."""

    front: float = 0.0
    """From its first vertex (towards the scene) to the front principal plane."""
    separation: float = 0.0
    """From the front to the rear principal plane."""
    rear: float = 0.0
    """From the rear principal plane to the last vertex."""


class ArrayCrossing(NamedTuple):
    """Array and sensor that rays cross, in the axes in which the array is traced."""

    array: ArrayRecord
    sensor: SensorPlane
    """Behind the rear principal plane."""
    z_plane: float
    """Position of the front principal plane."""


class TracedPaths(NamedTuple):
    """Optical path lengths and microlenses of n rays through an array, filled by kernels."""

    lengths: Floats
    """(n,) optical path lengths in mm, nan if lost; undefined for ideal lenses, which have no surfaces."""
    lenses: Floats
    """(n, 5): optical axis, lattice index (FREE: number and 0) and power of each ray's microlens."""
