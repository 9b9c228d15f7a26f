"""Light transport: rays that left the lens, traced through the scene bounce by bounce."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.sampling_records import Batch
from plenoptic.core.kernels.bundles import fill_world_rays
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext
from plenoptic.rendering.integrator.interaction import InteractionStage
from plenoptic.rendering.integrator.kernels.bounce import sample_bsdf
from plenoptic.rendering.integrator.kernels.direct_light import add_direct, eval_direct
from plenoptic.rendering.integrator.kernels.path_keys import fill_path_keys
from plenoptic.rendering.integrator.ray_queue import RayQueue, ShadowRays, Wavelengths
from plenoptic.rendering.plan.scene_stages import ROULETTE
from plenoptic.rendering.plan.stages import Stage
from plenoptic.rendering.settings import Caustics
from plenoptic.scene.geometry.geometry_records import Hits, Interactions, PathKeys
from plenoptic.scene.lights.light_records import DELTA, DrawnLights
from plenoptic.scene.materials.alpha_mask import NESTED, SALTS, attenuate_shadows, media_at, no_hits, skip_transparent

if TYPE_CHECKING:
    from plenoptic.rendering.integrator.medium_stage import MediumStage
    from plenoptic.rendering.integrator.moving_paths import MovingPaths


class PathObserver(Protocol):
    """Observer of the paths of a bundle. Its arguments are reused: it copies the arrays it keeps."""

    def on_camera_ray(self, rays: Floats) -> None:
        """Rays leave the camera."""

    def on_hit(self, rays: Floats, hits: Hits, radiance: Floats) -> None:
        """Rays hit triangles; `radiance` includes the emission at the hits."""

    def on_direct_light(
        self, interactions: Interactions, drawn: DrawnLights, shadow: ShadowRays, blocked: NDArray[np.uint8]
    ) -> None:
        """Lights are sampled for interactions; `blocked` is 1 for shadow rays that are occluded."""

    def on_scatter(self, interactions: Interactions, scattered_rays: RayQueue, n_rays: int, n_sampled: int) -> None:
        """`n_rays` of `n_sampled` scattered rays survive Russian roulette. Both are equal unless `n_rays` is 0."""


class PathIntegrator:
    """Traces the paths of a tile's bundles through the scene; its arrays are reused for each bundle."""

    def __init__(self, context: RenderContext, capacity: int) -> None:
        assert context.scene is not None
        camera, scene, intersector, plan = context.camera, context.scene, context.intersector, context.plan
        self.moving: MovingPaths | None = None
        """Times and placements of the paths; None if nothing moves during the exposure."""
        if context.shutter is not None:
            from plenoptic.rendering.integrator.moving_paths import MovingPaths

            self.moving = MovingPaths(context.shutter, scene, intersector, capacity)
            scene = self.moving.scene
        self._camera, self.scene, self._intersector, self._settings = camera, scene, intersector, context.settings
        self._basis = None if camera.colour is None else camera.colour.basis
        self._channels = channels = scene.channels if camera.colour is None else 1
        self._scatters, self._lights = plan.runs(Stage.SCATTERING), plan.runs(Stage.DIRECT_LIGHT)
        self._traces_scattered = plan.runs(Stage.ONWARD_RAYS)
        self._exclude_caustics = context.settings.caustics is Caustics.EXCLUDE
        self._radiance = np.empty((capacity, channels))
        self.scene_hits = 0
        """Number of paths that hit a triangle."""
        self._hits = no_hits(scene, capacity)
        queues = [self._ray_queue(capacity) for _ in range(2 if self._scatters else 1)]
        self._queue, self._next_queue = queues[0], queues[-1]
        if scene.absorption is not None:
            self._media = media_at(scene, intersector, camera.front)
            glass = None if scene.bsdf is None else scene.bsdf.glass_index
            self._glass_index = np.zeros((len(scene.absorption), 2)) if glass is None else glass
            self._reach = np.empty(capacity)
        self._absorption = scene.absorption
        self._medium_stage: MediumStage | None = None
        if plan.runs(Stage.MEDIA):
            from plenoptic.rendering.integrator.medium_stage import MediumStage

            self._medium_stage = MediumStage(scene, self._reach, channels)
        elif scene.media is not None:
            # Without bounces, light that would be scattered is lost.
            self._absorption = scene.media.extinction
        if scene.emission is not None:
            from plenoptic.rendering.integrator.kernels.emission import add_emission

            self._emission = add_emission.specialize()
        self._sees_sky = any(part is not None for part in scene.lights.sky)
        if self._sees_sky:
            from plenoptic.rendering.integrator.kernels.sky_emission import add_sky

            self._sky_emission = add_sky.specialize()
        self._random = self._scatters or scene.alpha is not None or self.moving is not None
        if self._random:
            self._keys, self._indices = np.empty(capacity, dtype=np.uint64), np.empty(capacity, dtype=np.uint32)
        if self._scatters:
            self._eval_direct, self._sample_bsdf = eval_direct.specialize(), sample_bsdf.specialize()
            self._stage = InteractionStage(scene, capacity, channels, lights=self._lights)
            traced = scene.absorption is not None or self._exclude_caustics
            self._source = np.empty(capacity, dtype=np.int64) if traced else None
            room = capacity if self._lights else 0
            self._shadow = ShadowRays(np.empty((room, 6)), np.empty(room, np.int64), np.empty((room, channels)))
            self._blocked = np.empty(room, dtype=np.uint8)

    def _ray_queue(self, capacity: int) -> RayQueue:
        """Allocate a queue of rays."""
        absorbs = self.scene.absorption is not None
        return RayQueue(
            rays=np.empty((capacity, 6)),
            path=np.empty(capacity, dtype=np.int64),
            throughput=np.empty((capacity, self._channels)) if self._traces_scattered or absorbs else None,
            pdf=np.empty(capacity) if self._traces_scattered else None,
            media=np.empty((capacity, NESTED), dtype=np.int32) if absorbs else None,
            rough=np.empty(capacity, dtype=np.uint8) if self._exclude_caustics else None,
        )

    def radiance(
        self,
        blocks: Floats,
        start: int,
        n: int,
        batch: Batch,
        number: NDArray[np.int64],
        waves: NDArray[np.int64] | None,
        observer: PathObserver | None = None,
    ) -> Floats:
        """Radiance along the paths of a bundle, (n, channels); 0 for rays that did not leave the lens.

        With `waves`, the wavelength number of each path, there is one channel.
        """
        max_bounces, wavelengths = self._settings.max_bounces, Wavelengths(waves, self._basis)
        radiance = self._radiance[:n]
        radiance[:] = 0.0
        n_rays = self._start(blocks, start, n, batch, number)
        if observer is not None:
            observer.on_camera_ray(self._queue.rays[:n_rays])
        for bounce in range(max_bounces + 1):
            hits = self._intersect(n_rays, bounce)
            if bounce == 0:
                self.scene_hits += int(np.count_nonzero(hits.triangle >= 0))
            self._add_emission(radiance, hits, bounce, wavelengths)
            if observer is not None:
                observer.on_hit(self._queue.rays[:n_rays], hits, radiance)
            if bounce == max_bounces or not self._scatters:
                break
            n_rays = self._scatter(radiance, hits, bounce, wavelengths, observer)
            self._queue, self._next_queue = self._next_queue, self._queue
            if not n_rays:
                break
        return radiance

    def _start(self, blocks: Floats, start: int, n: int, batch: Batch, number: NDArray[np.int64]) -> int:
        """Fill the queue with the rays from the camera; return their number."""
        queue = self._queue
        n_rays = int(fill_world_rays(queue.rays, queue.path, blocks, n, self._camera.rotation, self._camera.position))
        if self._random:
            fill_path_keys(self._keys[:n], self._indices[:n], start, batch, number)
        if self.moving is not None:
            keys = self._keys[:n], self._indices[:n]
            self.moving.begin(queue.rays[:n_rays], queue.path[:n_rays], keys, start, batch, number)
        for column, value in ((queue.throughput, 1.0), (queue.pdf, DELTA), (queue.rough, 0)):
            if column is not None:
                column[:n_rays] = value
        if queue.media is not None:
            queue.media[:n_rays] = self._media
        return n_rays

    def _path_keys(self) -> PathKeys:
        return PathKeys(self._queue.path, self._keys, self._indices)

    def _intersect(self, n_rays: int, bounce: int) -> Hits:
        """Closest hits of the first n_rays rays of the queue; transparent (alpha-masked) hits are skipped."""
        hits, rays, path = self._hits.first(n_rays), self._queue.rays[:n_rays], self._queue.path[:n_rays]
        intersector = self._intersector if self.moving is None else self.moving.at_times(path)
        if intersector is not None:
            intersector.fill_closest(hits, rays)
            if self.scene.alpha is not None:
                skip_transparent(self.scene, intersector, rays, hits, self._path_keys(), bounce * SALTS)
            if self.moving is not None:
                self.moving.set_placements(hits, path)
        return hits

    def _add_emission(self, radiance: Floats, hits: Hits, bounce: int, wavelengths: Wavelengths) -> None:
        """Attenuate the throughput by the media along each ray, then add the emission at its hit or of the sky."""
        scene, queue = self.scene, self._queue
        if self._sees_sky:
            self._sky_emission(radiance, queue, hits, scene.lights.sky, wavelengths)
        if self._absorption is not None:
            self._fly(self._absorption, radiance, hits, bounce, wavelengths)
        if scene.emission is not None:
            self._emission(radiance, queue, hits, scene.geometry, scene.emission, wavelengths)

    def _fly(self, absorption: Floats, radiance: Floats, hits: Hits, bounce: int, wavelengths: Wavelengths) -> None:
        """Attenuate rays by media, add the light that these scatter, and end rays that scatter before their hit."""
        from plenoptic.scene.materials.kernels.absorption import fill_absorption, fill_reaches

        scene, queue, stage, reach = self.scene, self._queue, self._medium_stage, self._reach[: len(hits.triangle)]
        surrounding = -1 if scene.surrounding is None else scene.surrounding
        fill_reaches(reach, queue, hits, scene.geometry, self._glass_index, surrounding)
        if stage is not None:
            stage.begin_flights(queue, hits, self._path_keys(), bounce, wavelengths)
            if self._lights and bounce < self._settings.max_bounces:
                self._add_visible_lights(radiance, stage.draw_lights(self._shadow, queue, hits, wavelengths))
            stage.end_flights(queue, hits, wavelengths)
        fill_absorption(queue, reach, hits, absorption, wavelengths)

    def _scatter(
        self, radiance: Floats, hits: Hits, bounce: int, wavelengths: Wavelengths, observer: PathObserver | None
    ) -> int:
        """Add direct light and sample the scattered rays; return their number."""
        n_rays = 0
        if self.scene.bsdf is not None:
            n_rays = self._scatter_at_surfaces(radiance, hits, bounce, wavelengths, observer)
        if self._medium_stage is not None and self._traces_scattered:
            n_rays = self._medium_stage.scatter(self._next_queue, n_rays, self._queue, hits, bounce)
        return n_rays

    def _scatter_at_surfaces(
        self, radiance: Floats, hits: Hits, bounce: int, wavelengths: Wavelengths, observer: PathObserver | None
    ) -> int:
        """Scatter the rays that hit surfaces; return the number of scattered ones."""
        interactions = self._stage.evaluate(self._queue, hits, self._path_keys(), bounce, wavelengths)
        if self._lights:
            drawn = self._stage.draw_lights(interactions, self._queue, wavelengths, self._shadow)
            shadow, blocked = self._add_direct(radiance, interactions, drawn, wavelengths)
            if observer is not None:
                observer.on_direct_light(interactions, drawn, shadow, blocked)
        # Rays after the last bounce can only hit emitters.
        n_rays = 0
        if self._traces_scattered:
            n_rays = self._sample_scattering(interactions, wavelengths, russian_roulette=bounce >= ROULETTE)
        if observer is not None:
            n_sampled = n_rays
            if self._traces_scattered and not n_rays:
                n_sampled = self._sample_scattering(interactions, wavelengths, russian_roulette=False)
            observer.on_scatter(interactions, self._next_queue, n_rays, n_sampled)
        return n_rays

    def _add_direct(
        self, radiance: Floats, interactions: Interactions, drawn: DrawnLights, wavelengths: Wavelengths
    ) -> tuple[ShadowRays, NDArray[np.uint8]]:
        """Add the sampled lights that are not occluded; return the shadow rays, and a mask of the blocked ones."""
        count = self._eval_direct(self._shadow, interactions, drawn, self._queue, self.scene.bsdf, wavelengths)
        return self._add_visible_lights(radiance, count)

    def _add_visible_lights(self, radiance: Floats, count: int) -> tuple[ShadowRays, NDArray[np.uint8]]:
        """Add the light of the first `count` shadow rays that are not occluded; return these, and a mask."""
        scene = self.scene
        shadow, blocked = self._shadow.first(count), self._blocked[:count]
        if count:
            intersector = self._intersector if self.moving is None else self.moving.at_times(shadow.path)
            if intersector is None:
                blocked[:] = 0
            elif scene.alpha is None:
                intersector.fill_occlusion(blocked, shadow.rays)
            else:
                attenuate_shadows(scene, intersector, shadow.rays, blocked, shadow.radiance)
            add_direct(radiance, blocked, shadow)
        return shadow, blocked

    def _sample_scattering(
        self, interactions: Interactions, wavelengths: Wavelengths, *, russian_roulette: bool
    ) -> int:
        """Sample the scattered rays; return their number."""
        scene, queue, next_queue = self.scene, self._queue, self._next_queue
        target = next_queue, self._source
        n_rays = int(self._sample_bsdf(*target, interactions, queue, scene.bsdf, wavelengths, russian_roulette))
        if self._source is not None:
            self._update_states(self._source[:n_rays], interactions)
        return n_rays

    def _update_states(self, source: NDArray[np.int64], interactions: Interactions) -> None:
        """Set the media of scattered rays, and whether their paths have met a rough surface."""
        queue, next_queue, scene = self._queue, self._next_queue, self.scene
        if scene.absorption is not None:
            from plenoptic.scene.materials.kernels.absorption import fill_next_media

            fill_next_media(next_queue.media, source, queue.media, interactions, self._glass_index)
        if queue.rough is not None:
            assert next_queue.rough is not None and next_queue.pdf is not None
            surface, n_rays = np.where(source < 0, -1 - source, source), len(source)
            # A negative pdf marks a specular direction (delta distribution).
            next_queue.rough[:n_rays] = queue.rough[interactions.ray[surface]] | (next_queue.pdf[:n_rays] > 0)
