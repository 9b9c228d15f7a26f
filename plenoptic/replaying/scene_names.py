"""Which parts of a scene the rows of its tables are."""

from __future__ import annotations

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.replaying.scene_events import DrawnKind, Place
from plenoptic.scene.compile import SceneRecord
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.lights.registry import AreaLight, DistantLight, PositionalLight
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.scene import Scene


class SceneNames:
    """Which mesh, instance, material and light of a scene the rows of its tables are."""

    def __init__(self, scene: Scene, record: SceneRecord) -> None:
        self._scene, self._record = scene, record
        self._shapes = [light.mesh() for light in scene.lights if isinstance(light, AreaLight)]
        self._points = [i for i, light in enumerate(scene.lights) if isinstance(light, PositionalLight)]
        self._suns = [i for i, light in enumerate(scene.lights) if isinstance(light, DistantLight)]
        repeated = [(i, len(mesh)) for i, mesh in enumerate(scene.meshes) if isinstance(mesh, Instances)]
        self._repeated = np.array(repeated, dtype=np.int64).reshape(-1, 2)

    def place(self, triangle: int, placed: int) -> Place:
        """Of a row of the triangles and one of the instances, -1 for plain triangles."""
        record = self._record
        assert record.triangle_mesh is not None
        number = int(record.triangle_mesh[triangle])
        if placed < 0 or record.instances is None:
            return Place(number, triangle - int(np.argmax(record.triangle_mesh == number)), None)
        ends = np.cumsum(self._repeated[:, 1])
        which = int(np.searchsorted(ends, placed, side="right"))
        instance = placed - int(ends[which] - self._repeated[which, 1])
        return Place(int(self._repeated[which, 0]), triangle - int(record.instances.first[placed]), instance)

    def material(self, place: Place) -> Material:
        """What a place is made of."""
        meshes = self._scene.meshes
        if place.object >= len(meshes):
            return self._shapes[place.object - len(meshes)].material
        mesh = meshes[place.object]
        return mesh.mesh.material if isinstance(mesh, Instances) else mesh.material

    def corners(self, triangle: int, placed: int) -> Floats:
        """(3, 3): corners of a triangle in the world."""
        record = self._record
        geometry = record.geometry
        assert geometry is not None
        points = np.asarray(geometry.vertices[geometry.triangles[triangle]])
        if placed < 0 or record.instances is None:
            return points
        matrix = record.instances.matrices[placed].reshape(3, 4)
        return np.asarray(points @ matrix[:, :3].T + matrix[:, 3])

    def light(self, number: float) -> tuple[DrawnKind, Place | None, int | None]:
        """What is drawn by a random number."""
        lights = self._record.lights
        assert lights.cdf is not None and lights.items is not None
        item = min(int(np.searchsorted(lights.cdf, number, side="right")), len(lights.cdf) - 1)
        kind, row = DrawnKind(int(lights.items["kind"][item])), int(lights.items["row"][item])
        if kind is DrawnKind.TRIANGLE:
            return kind, self.place(row, int(lights.items["instance"][item])), None
        if kind is DrawnKind.ENVIRONMENT:
            return kind, None, None
        return kind, None, (self._points if kind is DrawnKind.POINT else self._suns)[row]
