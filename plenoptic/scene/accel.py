"""What finds the triangle that a ray meets."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Intersector(Protocol):
    """Finds triangles, as float32 goes; the exact hit is computed from the triangle afterwards."""

    middle: NDArray[np.float64]
    """(3,): float32 coordinates count from here, so that a scene far from the world's origin loses no digits."""

    def fill_closest(self, hits: NDArray[np.int32], rays: NDArray[np.float64], *, coherent: bool) -> None:
        """Triangle that each ray (origin and direction, (n, 6)) meets first, or -1.

        `coherent` says that neighbouring rays go nearly the same way, as those of a pixel do; it changes nothing
        but the time: a third less where it is so, twice as much where it is not.
        """

    def fill_blocked(self, blocked: NDArray[np.uint8], rays: NDArray[np.float64]) -> None:
        """1 where something lies between a ray's origin and origin + direction, else 0."""


def middle_of(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median of the vertices: where the details are, whatever large surfaces lie around them."""
    return np.asarray(np.median(vertices, axis=0))


def build_intersector(vertices: NDArray[np.float64], triangles: NDArray[np.int32]) -> Intersector:
    """Embree through its C library, or through `EmbreeScene.run` where that cannot be had."""
    try:
        from plenoptic.scene._embree import EmbreeTriangles
    except ImportError:
        from plenoptic.scene._embree_run import SceneRunTriangles

        return SceneRunTriangles(vertices, triangles)
    return EmbreeTriangles(vertices, triangles)
