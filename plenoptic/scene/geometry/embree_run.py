"""Embree through `EmbreeScene.run` of embreex: the fallback, and the tests' second opinion."""

from __future__ import annotations

from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.geometry.build_geometry import part_of
from plenoptic.scene.geometry.geometry_records import Geometry, Hits, InstanceRecord
from plenoptic.scene.geometry.kernels.intersect import SHADOW_END


class SceneRunTriangles:
    """The answers of `EmbreeTriangles`, single-threaded and with the GIL held; instances are copied."""

    def __init__(self, geometry: Geometry, instances: InstanceRecord | None = None) -> None:
        self._middle = geometry.middle
        self._row: NDArray[np.int32] | None = None
        self._instance: NDArray[np.int32] | None = None
        vertices, triangles = geometry.vertices, geometry.triangles
        if instances is not None:
            vertices, triangles, self._row, self._instance = _copies(vertices, triangles, instances)
        self._scene: Any = EmbreeScene(robust=True)
        centred = (vertices - self._middle).astype(np.float32)
        self._mesh = TriangleMesh(self._scene, centred, np.ascontiguousarray(triangles))

    def fill_closest(self, hits: Hits, rays: Floats) -> None:
        """Closest triangle hit by each ray (origin and direction, (n, 6)), or -1; and its instance, or -1."""
        rows = self._scene.run(*self._halves(rays), query="INTERSECT")
        hits.triangle[:] = rows if self._row is None else np.where(rows < 0, -1, self._row[rows])
        if hits.instance is not None:
            hits.instance[:] = -1 if self._instance is None else np.where(rows < 0, -1, self._instance[rows])

    def fill_occlusion(self, blocked: NDArray[np.uint8], rays: Floats) -> None:
        """1 where something lies between a ray's origin and origin + direction, else 0."""
        blocked[: len(rays)] = self._scene.run(*self._halves(rays), query="DISTANCE") < SHADOW_END

    def _halves(self, rays: Floats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Origins, relative to the middle of the scene, and directions."""
        origins, directions = rays[:, :3] - self._middle, rays[:, 3:]
        return np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32)


def _copies(
    vertices: Floats, triangles: NDArray[np.int32], instances: InstanceRecord
) -> tuple[Floats, NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """All triangles in the world, with the row of `triangles` and the instance (or -1) of each."""
    plain = triangles[: instances.plain]
    points, faces = [vertices[: plain.max() + 1] if len(plain) else vertices[:0]], [plain]
    rows, places = [np.arange(len(plain), dtype=np.int32)], [np.full(len(plain), -1, np.int32)]
    start = len(points[0])
    for instance, matrix in enumerate(instances.matrices.reshape(-1, 3, 4)):
        first, count = instances.first[instance], instances.faces[instance]
        corners, part = part_of(vertices, triangles[first : first + count])
        points.append(corners @ matrix[:, :3].T + matrix[:, 3])
        faces.append((part + start).astype(np.int32))
        rows.append(np.arange(first, first + count, dtype=np.int32))
        places.append(np.full(count, instance, np.int32))
        start += len(corners)
    return np.concatenate(points), np.concatenate(faces), np.concatenate(rows), np.concatenate(places)
