"""Motion blur: each path has a time of its own, at which the camera and moving meshes are placed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.kernels.path_numbers import SHUTTER_SET
from plenoptic.camera.sampling.sampling_records import Batch
from plenoptic.core.kernels import sobol
from plenoptic.core.values import Floats, read_only
from plenoptic.rendering.plan.shutter import OpenShutter
from plenoptic.scene.geometry.accel import Intersector
from plenoptic.scene.geometry.geometry_records import INSTANCE_DISTANCE, Hits
from plenoptic.scene.geometry.moving import MovingTriangles
from plenoptic.scene.scene_record import SceneRecord


class MovingPaths:
    """Times of the paths of a bundle, and the scene with the placements at these times.

    Each ray that hits a moving mesh gets its own row of `instance_to_world`, after the rows of the scene: code that
    reads the placement of a triangle from there needs no times.
    """

    def __init__(
        self, shutter: OpenShutter, scene: SceneRecord, intersector: Intersector | None, capacity: int
    ) -> None:
        self._shutter, self._points = shutter, np.empty((sobol.DIMENSIONS, capacity))
        self._keys, self._numbers = np.empty(capacity, dtype=np.uint64), np.empty(capacity, dtype=np.uint32)
        self._intersector, self.scene = intersector, scene
        self.instance_of: NDArray[np.int32] | None = None
        """(rows,): index of the instance of each row of `instance_to_world`."""
        self._triangles: MovingTriangles | None = None
        if any(motion is not None for motion in shutter.motions):
            assert isinstance(intersector, MovingTriangles) and scene.geometry is not None
            placements = scene.geometry.instance_to_world
            assert placements is not None
            self._triangles, self._n_static = intersector, len(placements)
            self._table = np.concatenate([placements, np.empty((capacity, placements.shape[1]))])
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
        """Sample times for paths start, start + 1, ... of a batch, and transform their rays with the camera's pose.

        `keys` (paths,) are their random streams and indices, `number` the pixel numbers.
        """
        n, shutter = len(keys[0]), self._shutter
        path_index = np.arange(n)
        sobol.fill_samples(self._points, self._keys, self._numbers, path_index, *keys, SHUTTER_SET)
        times = shutter.times(number[(start + path_index) // batch.samples], self._points[0, :n])
        if shutter.camera is not None:
            camera_to_world = shutter.camera.matrices(times)[path]
            rays[:, :3] = (camera_to_world[:, :, :3] @ rays[:, :3, None])[:, :, 0] + camera_to_world[:, :, 3]
            rays[:, 3:] = (camera_to_world[:, :, :3] @ rays[:, 3:, None])[:, :, 0]
        if self._triangles is not None:
            motions = [None if motion is None else motion.matrices(times) for motion in shutter.motions]
            meshes = []
            for mesh in self._triangles.meshes:
                motion, rest_placement = motions[mesh.motion], mesh.places.reshape(1, 3, 4)
                if motion is not None:
                    placement = motion[:, :, :3] @ rest_placement
                    placement[:, :, 3] += motion[:, :, 3]
                    mesh = mesh._replace(places=placement.reshape(n, 12))
                meshes.append(mesh)
            self._meshes = tuple(meshes)

    def at_times(self, path: NDArray[np.int64]) -> Intersector | None:
        """Intersector for the rays of given paths (n,), at their times."""
        return self._intersector if self._triangles is None else self._triangles.along(path, self._meshes)

    def set_placements(self, hits: Hits, path: NDArray[np.int64]) -> None:
        """Give rays of paths (n,) that hit a moving mesh rows of their own, with the placements at their times."""
        if self._triangles is None or self.instance_of is None:
            return
        assert hits.instance is not None and self.scene.geometry is not None
        for mesh in self._meshes:
            if self._shutter.motions[mesh.motion] is None:
                continue
            hit_rays = np.flatnonzero(hits.instance == mesh.row)
            rows, placements = self._n_static + hit_rays, mesh.places[path[hit_rays]]
            centre = placements.reshape(-1, 3, 4) @ [*mesh.middle, 1.0] - self.scene.geometry.middle
            self._table[rows, :12], self._table[rows, INSTANCE_DISTANCE] = placements, np.abs(centre).sum(axis=1)
            hits.instance[hit_rays] = rows
            self.instance_of[rows] = mesh.row
