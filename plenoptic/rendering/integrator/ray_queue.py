"""Records of rays in the scene, as read and filled by kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats


class RayQueue(NamedTuple):
    """Rays and the states of their paths with C channels; None for states that a scene does not need."""

    rays: Floats
    """(n, 6): origin and direction."""
    path: NDArray[np.int64]
    """(n,): index of the ray's path in the bundle."""
    throughput: Floats | None
    """(n, C): fraction of the radiance along the ray that reaches the camera. None if it is 1 for all rays."""
    pdf: Floats | None
    """(n,), 1/sr: density by which the direction was sampled; DELTA for a specular direction. None if no ray is
    sampled.
    """
    media: NDArray[np.int32] | None
    """(n, NESTED): bodies that contain the ray. None if nothing absorbs."""
    rough: NDArray[np.uint8] | None
    """(n,): 1 for paths that a rough surface has scattered. None if caustics are included."""


class Flights(NamedTuple):
    """The m of n rays that fly through scattering media, up to the next surface."""

    reach: Floats
    """(n,), mm: distance from a ray's start to the surface, also where transparent ones are in between; or inf."""
    ray: NDArray[np.int64]
    """(m,): index of the ray in its queue."""
    path: NDArray[np.int64]
    """(m,): that of its path in the bundle."""
    end: Floats
    """(m,), mm: distance from the start to where the ray scatters; inf if it does not before its reach."""
    chance: Floats
    """(m,): probability that the ray scatters."""
    end_random: Floats
    """(4, m): random numbers of the end, and of the distance at which the ray is lit."""
    light_random: Floats
    """(4, m): random numbers of the light that lights it, and of the direction in which it scatters."""
    key: NDArray[np.uint64]
    """(m,): set of random points of the ray."""
    number: NDArray[np.uint32]
    """(m,): the ray's point in it."""

    def first(self, m: int) -> Flights:
        """The first m of the flights; the other arrays may have room for more."""
        return self._replace(ray=self.ray[:m], path=self.path[:m])


class ShadowRays(NamedTuple):
    """Rays to lights, and the radiance of these along the path if unoccluded."""

    rays: Floats
    """(n, 6): origin, and vector to the light."""
    path: NDArray[np.int64]
    """(n,)."""
    radiance: Floats
    """(n, C)."""

    def first(self, n: int) -> ShadowRays:
        """The first n of the rays."""
        return ShadowRays(self.rays[:n], self.path[:n], self.radiance[:n])


class Wavelengths(NamedTuple):
    """Wavelengths of paths; both members are None if paths carry the channels of the scene."""

    number: NDArray[np.int64] | None
    """(paths,): wavelength number of each path."""
    basis: Floats | None
    """(wavelengths, 3): values of red, green and blue at each wavelength."""
