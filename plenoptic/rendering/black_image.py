"""Facts about images that are black, or show nothing of their scene, from a few paths over the whole sensor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from plenoptic.camera.camera_rays import CameraRays
from plenoptic.camera.sampling.aperture_regions import cells_per_pixel, illuminated_pixels
from plenoptic.core.kernels.bundles import fill_status_counts
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.lost_rays import by_cause, in_words, lost_rays
from plenoptic.core.values import Floats
from plenoptic.core.warn import warn
from plenoptic.errors import BlackImageWarning, UnseenSceneWarning
from plenoptic.rendering.context import RenderContext, batch_of
from plenoptic.rendering.plan.stages import Stage
from plenoptic.rendering.tile import Tile, status_codes
from plenoptic.scene.geometry.geometry_records import NORMAL, OFFSET, POINT
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.environment import ConstantBackground
from plenoptic.scene.lights.registry import AreaLight, DistantLight, PositionalLight
from plenoptic.scene.lights.sheet import Sheet
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
_SMALL = 5.0
"""Size of meshes in mm below which their unit may be another one."""
_POINTS, _PARTS = 64, 16
"""Surface points, and points of each light, that are tested."""
_FEW = 32 * 32
"""Pixels of a region that may well be dark: between micro images, or next to all emitters."""
_NAMED = 3
"""Lights that are listed."""


def warn_of_darkness(context: RenderContext, scene: Scene | None, progress: Progress, *, lit: bool) -> None:
    """Warn of an image that is black or shows none of its meshes; silent if only few pixels are affected."""
    probe, sensor = _Probe(context, scene), context.camera.sensor
    rows, columns = progress.film.mean.shape[:2]
    whole = (rows, columns) == (sensor.rows, sensor.columns)
    if not lit and (fact := _fact(probe, progress, whole, few=not whole and rows * columns < _FEW)):
        warn(f"the image is black: {fact}", BlackImageWarning)
    elif lit and scene is not None and (whole or probe.is_past(scene)):
        warn(f"no path met the scene, {probe.scene_position(scene)}", UnseenSceneWarning)


def _fact(probe: _Probe, progress: Progress, whole: bool, *, few: bool) -> str:
    """Where paths from the camera to the lights end, in one sentence; empty if nothing need be wrong."""
    context, scene, counts = probe.context, probe.scene, progress.counts if whole else probe.counts
    if not counts[0]:
        lost = in_words(by_cause(lost_rays(counts))) or "no pixel is illuminated"
        return f"no light passes the camera ({lost}); look at camera.report(), the stop and the size of the sensor"
    if context.plan.runs(Stage.LOSSES) and not probe.transmits:
        return "the surfaces of lens or microlenses transmit no light; give coatings whose reflectance is below 1"
    if probe.bright and not whole:
        return "" if few else "this region of the sensor gets no light, and others do; choose another region"
    if scene is not None and context.intersector is None:
        return "the scene has no meshes, and no light is in view; give the scene meshes=[...]"
    if scene is not None and ((whole and not progress.scene_hits) or probe.is_past(scene)):
        return f"no path met the scene, {probe.scene_position(scene)}"
    if scene is None or not probe.has_hits:
        return "" if few else "hardly any path passes the camera and meets the scene; look at camera.report()"
    if context.settings.max_bounces == 0:
        return "max_bounces is 0, which shows only emitters, and none is in view; give more"
    obstacles = {emitter.name: probe.obstacle(emitter) for emitter in _emitters(scene)}
    if few and (not len(probe.surface_points) or not all(obstacles.values())):
        return ""
    if not len(probe.surface_points):
        return "the visible surfaces are black, glass, mirrors or backs of emitters; give matt materials or bounces"
    if not all(obstacles.values()):
        return "light reaches the visible surfaces and not the camera; give more samples or bounces, or other colours"
    facts = [f"{name} {obstacle}" for name, obstacle in obstacles.items()]
    more = f", and {len(facts) - _NAMED} more do not reach them" * (len(facts) > _NAMED)
    return f"no light reaches the visible surfaces: {', '.join(facts[:_NAMED])}{more}; move or turn them"


class _Emitter(NamedTuple):
    """An emitter: points on it, or directions towards it."""

    name: str
    ends: Floats
    """(m, 3), mm."""
    distant: bool = False
    normals: Floats | None = None
    """(m, 3), if one side is dark."""
    spot: SpotLight | None = None
    sheet: Sheet | None = None


def _emitters(scene: Scene) -> Iterator[_Emitter]:
    for number, light in enumerate(scene.lights):
        name = f"{type(light).__name__} {number}"
        if isinstance(light, AreaLight) and np.any(light.radiance):
            yield _mesh_emitter(name, [light.mesh()])
        elif isinstance(light, DistantLight) and np.any(light.irradiance):
            yield _Emitter(name, -light.direction[None], distant=True)
        elif isinstance(light, Sheet) and np.any(light.irradiance):
            yield _Emitter(name, light.position[None], sheet=light)
        elif isinstance(light, PositionalLight) and np.any(light.intensity):
            yield _Emitter(name, light.position[None], spot=light if isinstance(light, SpotLight) else None)
    for part, name in zip(scene.meshes, scene.object_names, strict=False):
        mesh, places = (part, np.eye(4)[None]) if isinstance(part, Mesh) else (part.mesh, part.matrices[:_PARTS])
        if np.any(mean_colour(mesh.material.row().emission)):
            yield _mesh_emitter(name, [mesh.transformed(place) for place in places])
    world = scene.background
    if world is not None and np.any(world.radiance if isinstance(world, ConstantBackground) else world.texels):
        yield _Emitter("the background", np.concatenate([np.eye(3), -np.eye(3)]), distant=True)


def _mesh_emitter(name: str, copies: list[Mesh]) -> _Emitter:
    """Emitter of the centroids and normals of some triangles."""
    corners = np.concatenate([mesh.vertices[mesh.faces] for mesh in copies])
    # Random triangles: every n-th triangle of a sphere may lie on one of its sides.
    corners = corners[np.random.default_rng(0).permutation(len(corners))[:_PARTS]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return _Emitter(name, corners.mean(axis=1), normals=None if copies[0].material.row().two_sided else normals)


class _Probe:
    """Test paths over the whole sensor, recorded as a `PathObserver`."""

    def __init__(self, context: RenderContext, scene: Scene | None) -> None:
        self.context, self.scene, camera = context, scene, context.camera
        self.record: Any = context.scene
        self.counts = np.zeros(status_codes(camera), dtype=np.int64)
        """Number of paths by status."""
        self.rays, self.surface_points = np.empty((0, 6)), np.empty((0, 6))
        """Rays that leave the camera; points and normals of the first matt surfaces that they hit."""
        self.has_hits = self.bright = self.transmits = False
        pixels = min(_PIXELS, 1 + int(_CELLS / cells_per_pixel(camera)))
        positions = np.random.default_rng(0).integers((camera.sensor.rows, camera.sensor.columns), size=(pixels, 2))
        tiles = [Tile(row, column, 1, 1) for row, column in positions.tolist()]
        centres, numbers = (np.concatenate([of(tile, camera) for tile in tiles]) for of in (Tile.centres, Tile.numbers))
        illuminated = illuminated_pixels(camera._replace(deflection=None), centres, numbers)
        batch, n = batch_of(context, 0, _SAMPLES), illuminated.place.size * _SAMPLES
        if not n:
            return
        rays = CameraRays(camera, illuminated, batch, n)
        bundle = rays.sample(0, n)
        rays.fill_through_array(bundle)
        rays.fill_through_lens(bundle)
        rays.fill_iris_deflections(bundle, 0, n)
        fill_status_counts(self.counts, bundle, n)
        self.transmits = bool(bundle.reshape(-1, RAY // BLOCK, BLOCK)[:, WEIGHT // BLOCK].any())
        self.bright = context.scene is None and bool(self.counts[0])
        if context.scene is not None:
            from plenoptic.rendering.integrator.path import PathIntegrator

            integrator = PathIntegrator(context, n)
            radiance = integrator.radiance(bundle, 0, n, batch, illuminated.number, rays.waves, observer=self)
            self.bright = bool(radiance.any())

    def on_camera_ray(self, rays: Floats) -> None:
        """Keep the rays that leave the camera."""
        self.rays = rays.copy()

    def on_hit(self, rays: Floats, hits: Hits, radiance: Floats) -> None:
        """Record whether any ray hits a mesh."""
        self.has_hits |= self.context.intersector is not None and bool((hits.triangle >= 0).any())

    def on_direct_light(self, *_: object) -> None:
        """Ignored."""

    def on_scatter(self, interactions: Interactions, scattered_rays: RayQueue, n_rays: int, n_sampled: int) -> None:
        """Keep the first surfaces that scatter the light of lamps."""
        if not len(self.surface_points):
            matt = self.record.bsdf.takes_light[interactions.material] > 0
            rows = interactions.rows[: len(matt)][matt]
            normals = rows[:, NORMAL : NORMAL + 3]
            self.surface_points = np.hstack([rows[:, POINT : POINT + 3] + rows[:, OFFSET, None] * normals, normals])

    def obstacle(self, emitter: _Emitter) -> str:
        """First obstacle for the light of an emitter on its way to the visible surfaces; empty if some arrives."""
        sampled = self.surface_points[:: max(1, -(-len(self.surface_points) // _POINTS))]
        points, normals = sampled[:, :3], sampled[:, 3:]
        to_light = np.broadcast_to(emitter.ends * self.record.lights.far, (len(points), len(emitter.ends), 3))
        if not emitter.distant:
            to_light = emitter.ends - points[:, None]
        arrives = np.ones(to_light.shape[:2], dtype=bool)
        if emitter.sheet is not None:
            if not len(points) or not emitter.sheet.reaches(np.stack([points.min(axis=0), points.max(axis=0)])):
                return "shines past them"
            lengths = np.minimum(emitter.sheet.lengths_at(points), self.record.lights.far)
            to_light = -(emitter.sheet.directions_at(points) * lengths[:, None])[:, None]
        if emitter.normals is not None:
            arrives &= (to_light * emitter.normals).sum(axis=2) < 0
            if not arrives.any():
                return "faces away from them"
        if emitter.spot is not None:
            along = -(to_light @ emitter.spot.direction) / np.linalg.norm(to_light, axis=2)
            arrives &= emitter.spot.falloff(np.arccos(np.clip(along, -1, 1))) > 0
            if not arrives.any():
                return "shines past them"
        arrives &= (to_light * normals[:, None]).sum(axis=2) > 0
        if not arrives.any():
            return "shines from behind them"
        start, intersector = np.broadcast_to(points[:, None], to_light.shape)[arrives], self.context.intersector
        assert intersector is not None
        blocked = np.empty(len(start), dtype=np.uint8)
        intersector.fill_occlusion(blocked, np.hstack([start, to_light[arrives]]))
        return "is hidden by other objects" if blocked.all() else ""

    def scene_position(self, scene: Scene) -> str:
        """Position of a scene that no path hit, with a remedy."""
        low, high = np.asarray(scene.bounds).round(3).tolist()
        remedy = "move it, or the camera, which without a pose looks from the origin along -z"
        if self.is_behind(scene):
            remedy = f"that is inside of the lens or behind it; {remedy}"
        elif not self.is_past(scene):
            remedy = "it is in view and small: give more samples, or go nearer"
        if scene.meshes and max(np.ptp(mesh.bounds, axis=0).max() for mesh in scene.meshes) < _SMALL:
            remedy += '; if it is of a file, give the unit of its numbers: pl.Scene.load(path, unit="m")'
        return f"which lies between {low} and {high} mm; {remedy}"

    def is_behind(self, scene: Scene) -> bool:
        """True if no mesh has a part in front of the lens, from whose first surface the rays start."""
        if not len(self.rays) or not scene.meshes:
            return False
        bounds = np.array([mesh.bounds for mesh in scene.meshes])
        corners = np.stack([bounds[:, (i, j, k), (0, 1, 2)] for i in (0, 1) for j in (0, 1) for k in (0, 1)], axis=1)
        axis = self.rays[:, 3:].mean(axis=0)
        return bool((corners.reshape(-1, 3) @ axis).max() <= (self.rays[:, :3] @ axis).max())

    def is_past(self, scene: Scene) -> bool:
        """True if all meshes and area lights are outside of the cone of rays that leave the camera."""
        if self.has_hits or not len(self.rays) or scene.bounds is None:
            return False
        start, directions = self.rays[:, :3].mean(axis=0), self.rays[:, 3:]
        axis = directions.mean(axis=0) / np.linalg.norm(directions.mean(axis=0))
        middle, radius = scene.bounds.mean(axis=0) - start, np.linalg.norm(np.ptp(scene.bounds, axis=0)) / 2
        far = float(np.linalg.norm(middle))
        if far <= radius:
            return False
        width = math.acos(min(1.0, float((directions @ axis).min()))) + math.asin(radius / far)
        return math.acos(max(-1.0, min(1.0, float(middle @ axis) / far))) > width
