"""Intersectors: the triangle that a ray hits first."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.geometry.geometry_records import Geometry, Hits, InstanceRecord


class Intersector(Protocol):
    """Finds triangles, as float32 goes; the exact hit is computed from the triangle afterwards."""

    def fill_closest(self, hits: Hits, rays: Floats) -> None:
        """Closest triangle hit by each ray (origin and direction, (n, 6)), and its instance; see `Hits`."""

    def fill_occlusion(self, blocked: NDArray[np.uint8], rays: Floats) -> None:
        """1 where something lies between a ray's origin and origin + direction, else 0."""


def build_intersector(geometry: Geometry, instances: InstanceRecord | None = None) -> Intersector:
    """Embree through its C library, or through `EmbreeScene.run` where that cannot be had."""
    try:
        from plenoptic.scene.geometry.kernels.embree import EmbreeTriangles
    except ImportError:
        from plenoptic.scene.geometry.embree_run import SceneRunTriangles

        return SceneRunTriangles(geometry, instances)
    return EmbreeTriangles(geometry, instances)
