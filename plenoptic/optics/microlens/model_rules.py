"""Interface of a microlens model; each model implements it in one file, and no other code distinguishes models."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

if TYPE_CHECKING:
    from plenoptic.core.rays import RayBundle
    from plenoptic.optics.microlens.array import MicrolensArray
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


class ModelRules(NamedTuple):
    """A microlens model; defaults are those of ideal lenses, which refract in one plane."""

    to_lens: Callable[[Floats, LensletRows, ArrayCrossing, Waves], None]
    """Turns aimed samples into rays towards the main lens (see `kernels.to_lens`)."""
    to_sensor: Callable[[Floats, ArrayCrossing, bool], None] | None
    """Traces rays behind the main lens to the sensor (see `kernels.to_sensor`), through lenses that may differ. None:
    no ray from a point meets a lens."""
    focuses: bool = True
    """True if lenses have a power."""
    is_plate: bool = False
    """True if rays pass two surfaces of glass, where openings limit them: they deviate from those of ideal lenses."""
    is_flat: bool = False
    """True if a plane with the normals of a sphere stands for the sphere."""
    check: Callable[[MicrolensArray], None] = lambda _: None
    """Raises an error for an array that cannot be built."""
    record: Callable[[MicrolensArray, tuple[float, ...]], NamedTuple | None] = lambda *_: None
    """Record for its kernels, at the camera's wavelength and those sampled by paths."""
    depths: Callable[[MicrolensArray], Depths] = lambda _: Depths()
    shift_chief_rays: Callable[[MicrolensArray, Floats, Floats, float, bool], Floats] = lambda _, points, *__: points
    """Points at which chief rays, through the optical centre of lenses, cross a principal plane as they run outside the
    lens: from points (n, 2) of that plane, the rear one for True, slopes (n, 2), and a wavelength in nm."""
    exit_points: Callable[[MicrolensArray, float, Pair, Pair, Pair], Pair] = lambda _, __, aimed, *___: aimed
    """Points on the rear surface of a lens of a power at which rays exit, traced in reverse from points of the rear
    principal plane with slopes per length of z. The last argument is the points at which they leave the lens."""

    trace_rays: Callable[[RayBundle, TracedPaths, ArrayRecord, bool, float], RayBundle] | None = None
    """Traces rays, at the wavelength of a refractive index, through an array of lenses that may differ, in its axes
    with the first vertex at z = 0; fills `TracedPaths`. None: no ray from a point meets a lens."""

    @property
    def is_thin(self) -> bool:
        """True if a power describes the refraction, so that dispersion is a factor of it."""
        return self.focuses and not self.is_plate
