"""Embree through `EmbreeScene.run` of embreex: the fallback, and the tests' second opinion."""

from __future__ import annotations

from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from plenoptic.scene._hit import SHADOW_END
from plenoptic.scene.accel import middle_of


class SceneRunTriangles:
    """The answers of `EmbreeTriangles`, single-threaded and with the GIL held."""

    def __init__(self, vertices: NDArray[np.float64], triangles: NDArray[np.int32]) -> None:
        self.middle = middle_of(vertices)
        self._scene: Any = EmbreeScene(robust=True)
        centred = (vertices - self.middle).astype(np.float32)
        self._mesh = TriangleMesh(self._scene, centred, np.ascontiguousarray(triangles))

    def fill_closest(self, hits: NDArray[np.int32], rays: NDArray[np.float64], *, coherent: bool) -> None:
        """Triangle that each ray (origin and direction, (n, 6)) meets first, or -1."""
        hits[: len(rays)] = self._scene.run(*self._halves(rays), query="INTERSECT")

    def fill_blocked(self, blocked: NDArray[np.uint8], rays: NDArray[np.float64]) -> None:
        """1 where something lies between a ray's origin and origin + direction, else 0."""
        blocked[: len(rays)] = self._scene.run(*self._halves(rays), query="DISTANCE") < SHADOW_END

    def _halves(self, rays: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Origins, relative to the middle of the scene, and directions."""
        origins, directions = rays[:, :3] - self.middle, rays[:, 3:]
        return np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32)
