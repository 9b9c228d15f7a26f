"""Triangles of which some move: each mesh that does is met in a frame of its own, so that no tree is built anew."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, contiguous
from plenoptic.scene.geometry.accel import Intersector, build_intersector
from plenoptic.scene.geometry.build_geometry import geometry_record, part_of
from plenoptic.scene.geometry.geometry_records import Geometry, Hits, InstanceRecord
from plenoptic.scene.geometry.kernels.interaction import fill_distances
from plenoptic.scene.geometry.kernels.moving import fill_in_frame, fill_nearer


class MovingMesh(NamedTuple):
    """A mesh at a place that moves."""

    row: int
    """Of the instances."""
    first: int
    """The row of `triangles` at which its triangles begin."""
    motion: int
    """Which of the scene's motions it follows."""
    tree: Intersector
    """Of the mesh, in its own frame."""
    middle: Floats
    """(3,): its float32 coordinates count from here, in its own frame."""
    places: Floats
    """(m, 12): rows of matrices, as those of `InstanceRecord`: one, or one for each path."""


class MovingTriangles:
    """An `Intersector` of a scene in which instances move. Where rays have times of their own, see `along`."""

    def __init__(self, geometry: Geometry, instances: InstanceRecord, previous: MovingTriangles | None = None) -> None:
        """Build trees, or take those of a scene `previous` that differs in the poses of moving objects."""
        assert instances.moving is not None
        still = instances.moving < 0
        self._geometry, self._record, self._plain = geometry, instances.some(still), instances.plain
        self._rows = np.flatnonzero(still).astype(np.int32)
        self._path: NDArray[np.int64] | None = None
        if previous is not None and not previous.shares(self):
            previous = None
        self._still: Intersector | None = self._tree_of_rest() if previous is None else previous._still
        trees = {} if previous is None else {mesh.first: (mesh.tree, mesh.middle) for mesh in previous.meshes}
        meshes = []
        for row in np.flatnonzero(~still).tolist():
            first, motion = int(instances.first[row]), int(instances.moving[row])
            if first not in trees:
                trees[first] = _own_tree(geometry, first, int(instances.faces[row]))
            meshes.append(MovingMesh(row, first, motion, *trees[first], instances.matrices[row : row + 1]))
        self.meshes: tuple[MovingMesh, ...] = tuple(meshes)
        """What moves, in the order of the rows."""

    def fill_closest(self, hits: Hits, rays: Floats) -> None:
        """Closest triangle hit by each ray (origin and direction, (n, 6)), or -1; and its instance, or -1."""
        assert hits.instance is not None
        hits.triangle[:] = hits.instance[:] = -1
        reached, local = np.empty(len(rays)), np.empty((len(rays), 6))
        if self._still is not None:
            self._still.fill_closest(hits, rays)
            placed = hits.instance >= 0
            hits.instance[placed] = self._rows[hits.instance[placed]]
        fill_distances(reached, hits, rays, self._geometry)
        triangles = np.empty(len(rays), dtype=np.int32)
        for mesh in self.meshes:
            fill_in_frame(local, rays, mesh.places, self._path if len(mesh.places) > 1 else None)
            mesh.tree.fill_closest(Hits(triangles, None, None), local)
            fill_nearer(hits, reached, triangles, local, self._geometry, mesh.first, mesh.row)

    def fill_occlusion(self, blocked: NDArray[np.uint8], rays: Floats) -> None:
        """1 where something lies between a ray's origin and origin + direction, else 0."""
        blocked[:] = 0
        if self._still is not None:
            self._still.fill_occlusion(blocked, rays)
        local, more = np.empty((len(rays), 6)), np.empty_like(blocked)
        for mesh in self.meshes:
            fill_in_frame(local, rays, mesh.places, self._path if len(mesh.places) > 1 else None)
            mesh.tree.fill_occlusion(more, local)
            blocked |= more

    def along(self, path: NDArray[np.int64], meshes: tuple[MovingMesh, ...]) -> MovingTriangles:
        """The same for rays of paths (n,), with poses of moving objects at their times."""
        other = object.__new__(MovingTriangles)
        other.__dict__.update(self.__dict__, _path=path, meshes=meshes)
        return other

    def shares(self, other: MovingTriangles) -> bool:
        """True if both have the same triangles, and the same of them stand still."""
        mine, theirs = self._still_arrays(), other._still_arrays()
        is_alike = self._plain == other._plain and len(mine) == len(theirs)
        return is_alike and all(a is b or np.array_equal(a, b) for a, b in zip(mine, theirs, strict=True))

    def _still_arrays(self) -> list[NDArray[Any]]:
        """Arrays of the triangles and of the instances that stand still."""
        geometry, record = self._geometry, self._record
        instances: list[NDArray[Any]] = [] if record is None else [record.matrices, record.first]
        return [geometry.vertices, geometry.triangles, geometry.middle, *instances]

    def _tree_of_rest(self) -> Intersector | None:
        """Intersector of the triangles that stand still; None where none does."""
        geometry, plain = self._geometry, self._plain
        if self._record is not None:
            return build_intersector(geometry, self._record)
        return build_intersector(geometry._replace(triangles=geometry.triangles[:plain])) if plain else None


def _own_tree(geometry: Geometry, first: int, faces: int) -> tuple[Intersector, Floats]:
    """Intersector of a mesh in its own frame, and the mesh's middle, the origin of its float32 coordinates."""
    corners, triangles = part_of(geometry.vertices, geometry.triangles[first : first + faces])
    record = geometry_record(corners, contiguous(triangles), np.zeros(faces, dtype=np.int32))
    return build_intersector(record), record.middle
