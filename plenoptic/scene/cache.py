"""Compiled records of the scene that was rendered last, for the next call with the same one."""

from __future__ import annotations

from plenoptic.core.last_result import LastResultCache
from plenoptic.scene.geometry.accel import Intersector, build_intersector
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.geometry.moving import MovingTriangles
from plenoptic.scene.scene import Scene
from plenoptic.scene.scene_record import CompiledMeshes, SceneRecord, build_record


class PreparedScene:
    """Scene record with its intersector.

    There is no lock, for which a process that is forked off meanwhile would wait for ever: two threads may both build.
    """

    def __init__(self, record: SceneRecord, kept: _Kept | None = None) -> None:
        self.record = record
        self._built: tuple[Intersector | None] | None = None
        self._kept = kept

    @property
    def intersector(self) -> Intersector | None:
        """Built on first use; None without triangles."""
        if self._built is None:
            self._built = (self._intersector(),)
        return self._built[0]

    def _intersector(self) -> Intersector | None:
        geometry, instances = self.record.geometry, self.record.instances
        if geometry is None:
            return None
        if instances is None or instances.moving is None:
            return build_intersector(geometry, instances)
        trees = MovingTriangles(geometry, instances, None if self._kept is None else self._kept.trees)
        if self._kept is not None:
            self._kept.trees = trees
        return trees


class _Kept:
    """Compiled meshes that scenes share which differ in lights and in the poses of moving objects: those of the last
    scene.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.surfaces: CompiledMeshes | None = None
        self.trees: MovingTriangles | None = None


def _prepare(scene: Scene) -> PreparedScene:
    cache = surfaces_before = None
    if scene.meshes:
        first = scene.meshes[0]
        cache = _kept(first.mesh if isinstance(first, Instances) else first)
        surfaces_before = cache.surfaces
    record, surfaces = build_record(scene.meshes, scene.lights, scene.background, surfaces_before, scene.medium)
    if cache is not None:
        cache.surfaces = surfaces
    return PreparedScene(record, cache)


def prepared_scene(scene: Scene) -> PreparedScene:
    """Compile a scene, or return the last compiled one if it is the same: scenes do not change."""
    return _last(scene)


_last: LastResultCache[Scene, PreparedScene] = LastResultCache(_prepare)
"""Of one scene only: trees take as much memory as scenes do."""
_kept: LastResultCache[Mesh, _Kept] = LastResultCache(_Kept)
