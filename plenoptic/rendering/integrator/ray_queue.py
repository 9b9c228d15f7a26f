"""Rays on their way through the scene, as kernels read and fill them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats


class RayQueue(NamedTuple):
    """Rays and what belongs to them, C channels of their paths; None for what a scene does not need."""

    rays: Floats
    """(n, 6): origin and direction."""
    path: NDArray[np.int64]
    """(n,): which path of the bundle a ray belongs to."""
    throughput: Floats | None
    """(n, C): what of the radiance along the ray reaches the camera. None where all of it does."""
    pdf: Floats | None
    """(n,), 1/sr: by which the direction was drawn; DELTA where it is certain. None where no ray is drawn."""
    media: NDArray[np.int32] | None
    """(n, NESTED): the bodies that the ray is in. None where nothing absorbs."""
    rough: NDArray[np.uint8] | None
    """(n,): 1 for paths that a rough surface has scattered. None where caustics are kept."""


class ShadowRays(NamedTuple):
    """Rays to lights, and what these bring where nothing lies between."""

    rays: Floats
    """(n, 6): origin, and the way to the light."""
    path: NDArray[np.int64]
    """(n,)."""
    radiance: Floats
    """(n, C)."""

    def first(self, n: int) -> ShadowRays:
        """The first of them."""
        return ShadowRays(self.rays[:n], self.path[:n], self.radiance[:n])


class Wavelengths(NamedTuple):
    """At which wavelengths paths see the colours of a scene; both are None where they see its channels."""

    number: NDArray[np.int64] | None
    """(paths,): number of each path's wavelength."""
    basis: Floats | None
    """(wavelengths, 3): what red, green and blue are at each."""
