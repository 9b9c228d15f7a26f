"""Interface of a microlens model; each is implemented in one file, and nothing else distinguishes models."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

if TYPE_CHECKING:
    from plenoptic.core.rays import RayBundle
    from plenoptic.optics.microlens.array import MicrolensArray
    from plenoptic.optics.microlens.record import ArrayRecord, SensorPlane

Pair: TypeAlias = tuple[Floats, Floats]
"""x and y of n points, or n slopes."""
Own: TypeAlias = NDArray[np.void] | None
"""What n paths keep of their microlenses, rows of `MICROLENS`; None where these do not differ."""
Waves: TypeAlias = NDArray[np.int64] | None
"""Numbers of the wavelengths that n paths have drawn; None for the camera's."""


class Depths(NamedTuple):
    """Lengths along the axis of a lens in mm."""

    front: float = 0.0
    """From its first vertex, seen from the scene, to the front principal plane."""
    separation: float = 0.0
    """From the front to the rear principal plane."""
    rear: float = 0.0
    """From the rear principal plane to the last vertex."""


class Crossing(NamedTuple):
    """Intersections of rays with an array, in the axes in which it is traced."""

    array: ArrayRecord
    sensor: SensorPlane
    """Behind the rear principal plane."""
    z_plane: float
    """The front principal plane."""


class FoundPaths(NamedTuple):
    """Results of kernels for n rays on their way through an array."""

    lengths: Floats
    """(n,), mm: optical paths, nan if lost; of ideal lenses, which have none, undefined."""
    lenses: Floats
    """(n, 5): optical axis, lattice index (FREE: number and 0) and power of the microlens passed."""


class ModelRules(NamedTuple):
    """Model of a microlens; the defaults are those of ideal lenses, which act in one plane."""

    to_lens: Callable[[Floats, Own, Crossing, Waves], None]
    """Aimed samples become rays towards the main lens (see `kernels.to_lens`)."""
    to_sensor: Callable[[Floats, Crossing, bool], None] | None
    """Rays behind the main lens land on the sensor (see `kernels.to_sensor`), through lenses that may differ. None: no
    ray from a point meets a lens."""
    focuses: bool = True
    """Whether light is bent."""
    is_plate: bool = False
    """Whether rays pass two surfaces of glass: openings end them there, and they stray from those of ideal lenses."""
    is_flat: bool = False
    """Whether a plane with the normals of a sphere stands for the sphere."""
    check: Callable[[MicrolensArray], None] = lambda _: None
    """Refuse arrays that cannot be."""
    record: Callable[[MicrolensArray, tuple[float, ...]], NamedTuple | None] = lambda *_: None
    """What its kernels read of it, for the camera's wavelength and those that paths draw."""
    depths: Callable[[MicrolensArray], Depths] = lambda _: Depths()
    displaced: Callable[[MicrolensArray, Floats, Floats, float, bool], Floats] = lambda _, points, *__: points
    """Points (n, 2) of a principal plane, the rear one for True, and slopes (n, 2) of rays through the optical centre,
    at a wavelength in nm: where the rays cross that plane as they run outside the lens."""
    landing: Callable[[MicrolensArray, float, Pair, Pair, Pair], Pair] = lambda _, __, aimed, *___: aimed
    """Of a lens of a power: where rays meet the side that ends it, aimed in reverse at points of the rear principal
    plane with slopes per length of z, that leave the lens at the last points."""

    passed: Callable[[RayBundle, FoundPaths, ArrayRecord, bool, float], RayBundle] | None = None
    """Rays of an index's wavelength behind an array, through lenses that may differ, whose first vertex lies at z = 0,
    in its axes; fills `FoundPaths`. None: no ray from a point meets a lens."""

    @property
    def is_thin(self) -> bool:
        """True if refraction is given by a power, so that colour is a factor of it."""
        return self.focuses and not self.is_plate
