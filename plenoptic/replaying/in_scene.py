"""Events of one path in the scene."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.rendering.integrator.path import PathIntegrator
from plenoptic.rendering.integrator.ray_queue import RayQueue, ShadowRays
from plenoptic.rendering.plan.stages import Plan, Stage
from plenoptic.replaying.events import DirectLight, DrawnKind, Escape, Meeting, PathEnding, Place
from plenoptic.scene.geometry.geometry_records import SHADING_NORMAL, Hits, Interactions
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.lights.light_records import END, DrawnLights
from plenoptic.scene.lights.registry import AreaLight, DistantLight, PositionalLight
from plenoptic.scene.lights.sheet import Sheet
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.scene import Scene
from plenoptic.scene.scene_record import SceneRecord

if TYPE_CHECKING:
    from plenoptic.rendering.integrator.moving_paths import MovingPaths


class Recorder:
    """A `path.PathObserver` of a bundle of one path."""

    def __init__(self, scene: Scene, integrator: PathIntegrator, plan: Plan, max_bounces: int) -> None:
        self._record, self._plan = integrator.scene, plan
        self._names = _SceneNames(scene, self._record, integrator.moving)
        self._max_bounces = max_bounces
        self._collected: Floats | None = None
        self.start: Floats | None = None
        """(6,): the ray that leaves the camera; None for a path that does not."""
        self.events: list[Meeting | Escape] = []
        self.ending = PathEnding.LEFT_SCENE

    def on_camera_ray(self, rays: Floats) -> None:
        """See `PathObserver`."""
        self.start = rays[0].copy() if len(rays) else None

    def on_hit(self, rays: Floats, hits: Hits, radiance: Floats) -> None:
        """See `PathObserver`."""
        if not len(rays):
            return
        collected = radiance[0].copy()
        with np.errstate(all="ignore"):
            emitted = collected if self._collected is None else collected - self._collected
        self._collected = collected
        direction = rays[0, 3:].copy()
        if hits.triangle[0] < 0:
            self.events.append(Escape(direction, emitted))
            self.ending = PathEnding.LEFT_SCENE
            return
        hit, instance = int(hits.triangle[0]), -1 if hits.instance is None else int(hits.instance[0])
        place = self._names.place(hit, instance)
        distance, normal = _intersect(rays[0], self._names.corners(hit, instance))
        self.events.append(
            Meeting(
                place=place,
                material=self._names.material(place),
                point=rays[0, :3] + distance * direction,
                distance=distance + (0.0 if hits.travelled is None else float(hits.travelled[0])),
                normal=normal,
                shading_normal=None,
                emitted=emitted,
            )
        )
        self.ending = self._end_here(hit)

    def _end_here(self, hit: int) -> PathEnding:
        """End of a path that is not scattered at its hit."""
        bsdf, geometry = self._record.bsdf, self._record.geometry
        if bsdf is None or geometry is None or not bsdf.scatters[geometry.triangle_material[hit]]:
            return PathEnding.ABSORBED
        scattered = sum(isinstance(event, Meeting) for event in self.events) - 1
        return PathEnding.MAX_BOUNCES if scattered >= self._max_bounces else PathEnding.NO_SURFACE

    def on_direct_light(
        self, interactions: Interactions, drawn: DrawnLights, shadow: ShadowRays, blocked: NDArray[np.uint8]
    ) -> None:
        """See `PathObserver`."""
        bsdf = self._record.bsdf
        if not len(interactions.ray) or bsdf is None or not bsdf.takes_light[interactions.material[0]]:
            return
        sampled = self._names.light(float(interactions.random[0, 0]))
        point = drawn.rows[0, END : END + 3].copy() if np.any(drawn.radiance[0] > 0) else None
        is_blocked = bool(blocked[0]) if len(shadow.rays) else None
        added = shadow.radiance[0].copy() if is_blocked is False else np.zeros(drawn.radiance.shape[1])
        if self._collected is not None:
            with np.errstate(all="ignore"):
                self._collected = self._collected + added
        self._amend(light=DirectLight(*sampled, point, is_blocked, added))

    def on_scatter(self, interactions: Interactions, scattered_rays: RayQueue, n_rays: int, n_sampled: int) -> None:
        """See `PathObserver`."""
        if not len(interactions.ray):
            return
        self._amend(shading_normal=interactions.rows[0, SHADING_NORMAL : SHADING_NORMAL + 3].copy())
        if n_rays:
            assert scattered_rays.throughput is not None
            self._amend(direction=scattered_rays.rays[0, 3:].copy(), throughput=scattered_rays.throughput[0].copy())
        elif not self._plan.runs(Stage.ONWARD_RAYS):
            self.ending = PathEnding.NOTHING_AHEAD
        else:
            self.ending = PathEnding.ROULETTE if n_sampled else PathEnding.ABSORBED

    def _amend(self, **members: Any) -> None:
        """Add members to the last event."""
        last = self.events[-1]
        assert isinstance(last, Meeting)
        self.events[-1] = dataclasses.replace(last, **members)


class _SceneNames:
    """Meshes, instances, materials and lights of a scene by the rows of its record."""

    def __init__(self, scene: Scene, record: SceneRecord, moving: MovingPaths | None) -> None:
        self._scene, self._record = scene, record
        self._instance_of = None if moving is None else moving.instance_of
        self._shapes = [light.mesh() for light in scene.lights if isinstance(light, AreaLight)]
        classes = {DrawnKind.POINT: PositionalLight, DrawnKind.SHEET: Sheet, DrawnKind.SUN: DistantLight}
        self._lights = {
            kind: [i for i, light in enumerate(scene.lights) if isinstance(light, of_kind)]
            for kind, of_kind in classes.items()
        }
        repeated = [(i, len(mesh)) for i, mesh in enumerate(scene.meshes) if isinstance(mesh, Instances)]
        self._repeated = np.array(repeated, dtype=np.int64).reshape(-1, 2)

    def place(self, triangle: int, placed: int) -> Place:
        """Triangle by its row and that of an instance, -1 for plain triangles."""
        record = self._record
        assert record.triangle_mesh is not None
        number = int(record.triangle_mesh[triangle])
        if placed < 0 or record.instances is None:
            return Place(number, triangle - int(np.argmax(record.triangle_mesh == number)), None)
        placed = placed if self._instance_of is None else int(self._instance_of[placed])
        ends = np.cumsum(self._repeated[:, 1])
        which = int(np.searchsorted(ends, placed, side="right"))
        instance = placed - int(ends[which] - self._repeated[which, 1])
        return Place(int(self._repeated[which, 0]), triangle - int(record.instances.first[placed]), instance)

    def material(self, place: Place) -> Material:
        """Material of a triangle."""
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
        if placed < 0 or geometry.instance_to_world is None:
            return points
        matrix = geometry.instance_to_world[placed, :12].reshape(3, 4)
        return np.asarray(points @ matrix[:, :3].T + matrix[:, 3])

    def light(self, number: float) -> tuple[DrawnKind, Place | None, int | None]:
        """Light that a random number selects."""
        lights = self._record.lights
        assert lights.cdf is not None and lights.items is not None
        item = min(int(np.searchsorted(lights.cdf, number, side="right")), len(lights.cdf) - 1)
        kind, row = DrawnKind(int(lights.items["kind"][item])), int(lights.items["row"][item])
        if kind is DrawnKind.TRIANGLE:
            return kind, self.place(row, int(lights.items["instance"][item])), None
        if kind is DrawnKind.ENVIRONMENT:
            return kind, None, None
        return kind, None, self._lights[kind][row]


def _intersect(ray: Floats, corners: Floats) -> tuple[float, Floats]:
    """Distance along a ray to a triangle, and its unit normal on the ray's side; not finite without area."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    with np.errstate(all="ignore"):
        along = normal @ ray[3:]
        distance = float(-(normal @ (ray[:3] - corners[0])) / along)
        normal = normal / np.sqrt(normal @ normal)
    return distance, -normal if along > 0 else normal
