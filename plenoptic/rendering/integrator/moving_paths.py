"""Paths at times of their own: rays from where the camera is then, and meshes where they are then."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.kernels.paths import COLOUR_SET
from plenoptic.camera.sampling.record import Batch
from plenoptic.core.kernels import sobol
from plenoptic.core.values import Floats, read_only
from plenoptic.rendering.plan.shutter import OpenShutter
from plenoptic.scene.compile import SceneRecord
from plenoptic.scene.geometry.accel import Intersector
from plenoptic.scene.geometry.moving import MovingTriangles
from plenoptic.scene.geometry.record import INSTANCE_DISTANCE, Hits

SHUTTER_SET = COLOUR_SET + 1
"""Set of the sampling points that draws times: beyond those of all bounces and of wavelengths."""


class MovingPaths:
    """What differs from path to path of a bundle, and the scene in which it does.

    Each ray that meets what moves gets a row of `instance_to_world` of its own, behind those of the scene: whatever
    reads there where a triangle stands needs not know of times.
    """

    def __init__(
        self, shutter: OpenShutter, scene: SceneRecord, intersector: Intersector | None, capacity: int
    ) -> None:
        self._shutter, self._points = shutter, np.empty((sobol.DIMENSIONS, capacity))
        self._keys, self._numbers = np.empty(capacity, dtype=np.uint64), np.empty(capacity, dtype=np.uint32)
        self._intersector, self.scene = intersector, scene
        self.instance_of: NDArray[np.int32] | None = None
        """(rows,): which instance a row of `instance_to_world` is of."""
        self._trees: MovingTriangles | None = None
        if any(motion is not None for motion in shutter.motions):
            assert isinstance(intersector, MovingTriangles) and scene.geometry is not None
            places = scene.geometry.instance_to_world
            assert places is not None
            self._trees, self._still = intersector, len(places)
            self._table = np.concatenate([places, np.empty((capacity, places.shape[1]))])
            self.instance_of = np.arange(len(self._table), dtype=np.int32)
            self.scene = scene._replace(geometry=scene.geometry._replace(instance_to_world=read_only(self._table)))

    def begin(
        self,
        rays: Floats,
        path: NDArray[np.int64],
        keys: tuple[NDArray[np.uint64], NDArray[np.uint32]],
        start: int,
        batch: Batch,
        number: NDArray[np.int64],
    ) -> None:
        """Draw times for paths start, start + 1, ... of a batch, and send their rays from where the camera is then.

        `keys` (paths,) are their random streams and numbers in these, `number` those of the pixels.
        """
        n, shutter = len(keys[0]), self._shutter
        every = np.arange(n)
        sobol.fill_drawn(self._points, self._keys, self._numbers, every, *keys, SHUTTER_SET)
        times = shutter.times(number[(start + every) // batch.samples], self._points[0, :n])
        if shutter.camera is not None:
            moved = shutter.camera.matrices(times)[path]
            rays[:, :3] = (moved[:, :, :3] @ rays[:, :3, None])[:, :, 0] + moved[:, :, 3]
            rays[:, 3:] = (moved[:, :, :3] @ rays[:, 3:, None])[:, :, 0]
        if self._trees is not None:
            places = [None if motion is None else motion.matrices(times) for motion in shutter.motions]
            meshes = []
            for mesh in self._trees.meshes:
                motion, rest = places[mesh.motion], mesh.places.reshape(1, 3, 4)
                if motion is not None:
                    placed = motion[:, :, :3] @ rest
                    placed[:, :, 3] += motion[:, :, 3]
                    mesh = mesh._replace(places=placed.reshape(n, 12))
                meshes.append(mesh)
            self._meshes = tuple(meshes)

    def along(self, path: NDArray[np.int64]) -> Intersector | None:
        """What finds triangles for rays of paths (n,)."""
        return self._intersector if self._trees is None else self._trees.along(path, self._meshes)

    def place(self, hits: Hits, path: NDArray[np.int64]) -> None:
        """Give the rays of paths (n,) that meet what moves rows of their own, with the places at their times."""
        if self._trees is None or self.instance_of is None:
            return
        assert hits.instance is not None and self.scene.geometry is not None
        for mesh in self._meshes:
            if self._shutter.motions[mesh.motion] is None:
                continue
            met = np.flatnonzero(hits.instance == mesh.row)
            rows, places = self._still + met, mesh.places[path[met]]
            off = places.reshape(-1, 3, 4) @ [*mesh.middle, 1.0] - self.scene.geometry.middle
            self._table[rows, :12], self._table[rows, INSTANCE_DISTANCE] = places, np.abs(off).sum(axis=1)
            hits.instance[met] = rows
            self.instance_of[rows] = mesh.row
