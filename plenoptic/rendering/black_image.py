"""Diagnosis of images that are black, or show nothing of their scene, by a few paths over the whole sensor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_rays import CameraRays
from plenoptic.camera.sampling.aperture_regions import cells_per_pixel, illuminated_pixels
from plenoptic.core.kernels.bundles import fill_status_counts
from plenoptic.core.lost_rays import by_cause, in_words, lost_rays
from plenoptic.core.values import Floats
from plenoptic.core.warn import warn
from plenoptic.errors import BlackImageWarning, UnseenSceneWarning
from plenoptic.rendering.context import RenderContext, batch_of
from plenoptic.rendering.tile import Tile, status_codes
from plenoptic.scene.geometry.geometry_records import NORMAL, OFFSET, POINT
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.environment import ConstantBackground
from plenoptic.scene.lights.registry import AreaLight, DistantLight, PositionalLight
from plenoptic.scene.lights.spot import SpotLight
from plenoptic.scene.textures.color import mean_colour

if TYPE_CHECKING:
    from plenoptic.rendering.integrator.ray_queue import RayQueue
    from plenoptic.rendering.schedule.progress import Progress
    from plenoptic.scene.geometry.geometry_records import Hits, Interactions
    from plenoptic.scene.scene import Scene

_PIXELS, _SAMPLES, _CELLS = 256, 16, 1 << 14
"""Random pixels, samples and total microlenses of the probe; fewer pixels if each is illuminated by more microlenses.
"""
_POINTS, _PARTS = 64, 16
"""Surface points, and points of each light, that are tested."""
_FEW = 32 * 32
"""Pixels of a region that may well be dark: between micro images, or next to all emitters."""
_NAMED = 3
"""Lights that are listed."""
_TURN = "turn it round, as QuadLight.facing does, or make it two_sided"


def warn_of_darkness(context: RenderContext, scene: Scene | None, progress: Progress, *, lit: bool) -> None:
    """Warn with the cause if an image is black or shows none of its meshes; silent if only few pixels are affected."""
    probe, sensor = _Probe(context, scene), context.camera.sensor
    rows, columns = progress.film.mean.shape[:2]
    whole = (rows, columns) == (sensor.rows, sensor.columns)
    if not lit and (cause := _cause(probe, progress, whole, few=not whole and rows * columns < _FEW)):
        warn(f"the image is black: {cause}", BlackImageWarning)
    elif lit and scene is not None and (whole or probe.is_past(scene)):
        warn(f"no path met the scene, {probe.scene_position(scene)}", UnseenSceneWarning)


def _cause(probe: _Probe, progress: Progress, whole: bool, *, few: bool) -> str:
    """The cause in one sentence; empty if nothing need be wrong."""
    context, scene, counts = probe.context, probe.scene, progress.counts if whole else probe.counts
    bounces = f"within {context.settings.max_bounces} bounces; give more"
    if not counts[0]:
        lost = in_words(by_cause(lost_rays(counts))) or "nothing feeds the pixels"
        return f"no light passes the camera ({lost}); look at camera.report(), the stop and the size of the sensor"
    if probe.bright and not whole:
        return "" if few else "this region of the sensor gets no light, and others do; choose another region"
    if scene is not None and context.intersector is None:
        return "nothing is there for light to fall on, and no light is in view; give the scene meshes=[...]"
    if scene is not None and ((whole and not progress.scene_hits) or probe.is_past(scene)):
        return f"no path met the scene, {probe.scene_position(scene)}"
    if scene is None or not len(probe.meshes):
        return "" if few else "hardly any path passes the camera and meets the scene; look at camera.report()"
    if context.settings.max_bounces == 0:
        return "max_bounces is 0, which shows only emitters, and none is in view; give more"
    labels, emitters = scene.object_names, list(_emitters(scene))
    inside = probe.surrounding()
    start = "" if inside is None else f"the camera is inside {labels[inside]}; "
    if not len(probe.surface_points):
        visible_names = {labels[number] for number in probe.meshes}
        if backs := [e.name for e in emitters if e.name in visible_names and e.normals is not None][:_NAMED]:
            return f"{start}{', '.join(backs)} shines away from the camera; {_TURN}"
        visible = f"{start}the visible surfaces are black, glass or mirrors"
        return f"{visible}, and no path hits a light {bounces}, or matt materials"
    obstacles = [(e.name, probe.obstacle(e, labels)) for e in emitters]
    if not all(obstacle for _, obstacle in obstacles):
        dim = f"{start}light reaches the visible surfaces and not the camera {bounces}"
        return "" if few else f"{dim}, or samples, or look at the colours of lights and materials"
    named = "; ".join(f"{name} {obstacle}" for name, obstacle in obstacles[:_NAMED])
    more = f"; and {len(obstacles) - _NAMED} more" * (len(obstacles) > _NAMED)
    return (
        f"{start}{len(obstacles)} light{'s' * (len(obstacles) > 1)}, none reaches the visible surfaces; {named}{more}"
    )


class _Emitter(NamedTuple):
    """An emitter: points on it, or directions towards it."""

    name: str
    ends: Floats
    """(m, 3), mm."""
    distant: bool = False
    normals: Floats | None = None
    """(m, 3), if one side is dark."""
    spot: SpotLight | None = None


def _emitters(scene: Scene) -> Iterator[_Emitter]:
    for number, light in enumerate(scene.lights):
        name = f"{type(light).__name__} {number}"
        if isinstance(light, AreaLight) and np.any(light.radiance):
            yield _mesh_emitter(name, [light.mesh()])
        elif isinstance(light, DistantLight) and np.any(light.irradiance):
            yield _Emitter(name, -light.direction[None], distant=True)
        elif isinstance(light, PositionalLight) and np.any(light.intensity):
            yield _Emitter(name, light.position[None], spot=light if isinstance(light, SpotLight) else None)
    for part, name in zip(scene.meshes, scene.object_names, strict=False):
        mesh, places = (part, np.eye(4)[None]) if isinstance(part, Mesh) else (part.mesh, part.matrices[:_PARTS])
        if np.any(mean_colour(mesh.material.row().emission)):
            yield _mesh_emitter(name, [mesh.transformed(place) for place in places])
    world = scene.background
    if world is not None and np.any(world.radiance if isinstance(world, ConstantBackground) else world.texels):
        yield _Emitter("the background", _directions(_PARTS), distant=True)


def _mesh_emitter(name: str, copies: list[Mesh]) -> _Emitter:
    """Emitter of the centroids and normals of some triangles."""
    corners = np.concatenate([mesh.vertices[mesh.faces] for mesh in copies])
    # Random triangles: every n-th triangle of a sphere may lie on one of its sides.
    corners = corners[np.random.default_rng(0).permutation(len(corners))[:_PARTS]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return _Emitter(name, corners.mean(axis=1), normals=None if copies[0].material.row().two_sided else normals)


def _directions(n: int) -> Floats:
    """(n, 3): unit vectors over the sphere, on a Fibonacci spiral."""
    z = 1 - (2 * np.arange(n) + 1) / n
    turn = math.pi * (3 - math.sqrt(5)) * np.arange(n)
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)


class _Probe:
    """Test paths over the whole sensor, and their fates, recorded as a `PathObserver`."""

    def __init__(self, context: RenderContext, scene: Scene | None) -> None:
        self.context, self.scene, camera = context, scene, context.camera
        self.record: Any = context.scene
        self.intersector: Any = context.intersector
        self.counts = np.zeros(status_codes(camera), dtype=np.int64)
        """Number of paths by status."""
        self.rays, self.surface_points = np.empty((0, 6)), np.empty((0, 6))
        """Rays that leave the camera; points and normals of the first matt surfaces that they hit."""
        self.meshes = np.empty(0, dtype=np.int32)
        """Numbers of the visible meshes."""
        self.bright = False
        pixels = min(_PIXELS, 1 + int(_CELLS / cells_per_pixel(camera)))
        pixel_positions = np.random.default_rng(0).integers(
            (camera.sensor.rows, camera.sensor.columns), size=(pixels, 2)
        )
        tiles = [Tile(row, column, 1, 1) for row, column in pixel_positions.tolist()]
        centres, numbers = ([of(tile, camera) for tile in tiles] for of in (Tile.centres, Tile.numbers))
        fed = illuminated_pixels(camera._replace(deflection=None), np.concatenate(centres), np.concatenate(numbers))
        batch, n = batch_of(context, 0, _SAMPLES), fed.place.size * _SAMPLES
        if not n:
            return
        camera_rays = CameraRays(camera, fed, batch, n)
        bundle = camera_rays.sample(0, n)
        camera_rays.fill_through_array(bundle)
        camera_rays.fill_through_lens(bundle)
        camera_rays.fill_iris_deflections(bundle, 0, n)
        fill_status_counts(self.counts, bundle, n)
        self.bright = context.scene is None and bool(self.counts[0])
        if context.scene is not None:
            from plenoptic.rendering.integrator.path import PathIntegrator

            radiance = PathIntegrator(context, n).radiance(
                bundle, 0, n, batch, fed.number, camera_rays.waves, observer=self
            )
            self.bright = bool(radiance.any())

    def on_camera_ray(self, rays: Floats) -> None:
        """Keep the rays that leave the camera."""
        self.rays = rays.copy()

    def on_hit(self, rays: Floats, hits: Hits, radiance: Floats) -> None:
        """Keep the numbers of the meshes at the first hits."""
        if not len(self.meshes) and self.intersector is not None:
            self.meshes = np.unique(self.record.triangle_mesh[hits.triangle[hits.triangle >= 0]])

    def on_direct_light(self, *_: object) -> None:
        """Ignored."""

    def on_scatter(self, interactions: Interactions, scattered_rays: RayQueue, n_rays: int, n_sampled: int) -> None:
        """Keep the first surfaces that scatter the light of lamps."""
        if not len(self.surface_points):
            matt = self.record.bsdf.takes_light[interactions.material] > 0
            rows = interactions.rows[: len(matt)][matt]
            normals = rows[:, NORMAL : NORMAL + 3]
            self.surface_points = np.hstack([rows[:, POINT : POINT + 3] + rows[:, OFFSET, None] * normals, normals])

    def obstacle(self, e: _Emitter, labels: tuple[str, ...]) -> str:
        """Reason why no light of an emitter reaches the visible surfaces; empty if some does."""
        sampled = self.surface_points[:: -(-len(self.surface_points) // _POINTS)]
        points, normals = sampled[:, :3], sampled[:, 3:]
        to_light = np.broadcast_to(e.ends * self.record.lights.far, (len(points), len(e.ends), 3))
        if not e.distant:
            to_light = e.ends - points[:, None]
        unblocked = np.ones(to_light.shape[:2], dtype=bool)
        if e.normals is not None:
            unblocked &= (to_light * e.normals).sum(axis=2) < 0
            if not unblocked.any():
                return f"faces away: {_TURN}"
        if e.spot is not None:
            along = -(to_light @ e.spot.direction) / np.linalg.norm(to_light, axis=2)
            unblocked &= e.spot.falloff(np.arccos(np.clip(along, -1, 1))) > 0
            if not unblocked.any():
                return "shines past it: aim it with SpotLight.facing, or widen outer_angle (radians)"
        unblocked &= (to_light * normals[:, None]).sum(axis=2) > 0
        if not unblocked.any():
            remedy = "reverse its direction, the way its light travels" if e.distant else "move it to the camera's side"
            return f"shines from behind: {remedy}"
        start = np.broadcast_to(points[:, None], to_light.shape)[unblocked]
        rays, blocked = np.hstack([start, to_light[unblocked]]), np.empty(len(start), dtype=np.uint8)
        self.intersector.fill_blocked(blocked, rays)
        if not blocked.all():
            return ""
        triangles = self._triangles_hit(rays)
        label = labels[np.bincount(self.record.triangle_mesh[triangles]).argmax()]
        bsdf, materials = self.record.bsdf, self.record.geometry.triangle_material[triangles]
        if (bsdf.scatters[materials] > bsdf.takes_light[materials]).any():
            return f"is behind {label}, whose glass lets light pass by chance only, and that of points never: move it"
        return f"is hidden by {label}: move one of them, or the camera"

    def _triangles_hit(self, rays: Floats) -> NDArray[np.int32]:
        """Triangles hit by rays (n, 6), without the rays that miss."""
        from plenoptic.scene.materials.alpha_mask import no_hits

        hits = no_hits(self.record, len(rays))
        self.intersector.fill_closest(hits, np.ascontiguousarray(rays))
        return hits.triangle[hits.triangle >= 0]

    def surrounding(self) -> int | None:
        """Index of the mesh that surrounds the camera; None without one."""
        directions = _directions(_POINTS)
        rays = np.hstack([np.broadcast_to(self.rays[0, :3], directions.shape), directions])
        meshes = self.record.triangle_mesh[self._triangles_hit(rays)]
        return int(meshes[0]) if len(meshes) == len(directions) and (meshes == meshes[0]).all() else None

    def scene_position(self, scene: Scene) -> str:
        """Position of a scene that no path hit, with a remedy."""
        low, high = np.asarray(scene.bounds).round(3).tolist()
        remedy = "move it, or the camera, which without a pose looks from the origin along -z"
        if not self.is_past(scene):
            remedy = "it is in view and small: give more samples, or go nearer"
        return f"which lies between {low} and {high} mm; {remedy}"

    def is_past(self, scene: Scene) -> bool:
        """True if all meshes and area lights are outside of the cone of rays that leave the camera."""
        if len(self.meshes) or not len(self.rays) or scene.bounds is None:
            return False
        start, directions = self.rays[:, :3].mean(axis=0), self.rays[:, 3:]
        axis = directions.mean(axis=0) / np.linalg.norm(directions.mean(axis=0))
        middle, radius = scene.bounds.mean(axis=0) - start, np.linalg.norm(np.ptp(scene.bounds, axis=0)) / 2
        far = float(np.linalg.norm(middle))
        if far <= radius:
            return False
        width = math.acos(min(1.0, float((directions @ axis).min()))) + math.asin(radius / far)
        return math.acos(max(-1.0, min(1.0, float(middle @ axis) / far))) > width
