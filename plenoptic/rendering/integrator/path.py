"""Light transport: paths that left the lens, followed through the scene stage after stage."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.record import Batch
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
from plenoptic.scene.geometry.record import Hits, Interactions, PathKeys
from plenoptic.scene.lights.record import DELTA, DrawnLights
from plenoptic.scene.materials.alpha_mask import NESTED, SALTS, attenuate_shadows, media_at, no_hits, skip_transparent

if TYPE_CHECKING:
    from plenoptic.rendering.integrator.moving_paths import MovingPaths


class PathObserver(Protocol):
    """Is told what the paths of a bundle go through. What it is handed is used again: it copies what it keeps."""

    def left(self, rays: Floats) -> None:
        """Rays have left the camera."""

    def saw(self, rays: Floats, hits: Hits, radiance: Floats) -> None:
        """Rays have met triangles, and paths have collected what shines there."""

    def lit(
        self, interactions: Interactions, drawn: DrawnLights, shadow: ShadowRays, blocked: NDArray[np.uint8]
    ) -> None:
        """Lights were drawn for surfaces, and some of them could be seen."""

    def scattered(self, interactions: Interactions, onward: RayQueue, onwards: int, drawn: int) -> None:
        """So many rays go on, of those that were drawn: the others ended by chance. Known where none goes on."""


class PathIntegrator:
    """Follows the paths of a tile's bundles through the scene; its arrays are used again for each bundle."""

    def __init__(self, context: RenderContext, capacity: int) -> None:
        assert context.scene is not None
        camera, scene, intersector, plan = context.camera, context.scene, context.intersector, context.plan
        self.moving: MovingPaths | None = None
        """What differs from path to path; None where nothing moves in the exposure."""
        if context.shutter is not None:
            from plenoptic.rendering.integrator.moving_paths import MovingPaths

            self.moving = MovingPaths(context.shutter, scene, intersector, capacity)
            scene = self.moving.scene
        self._camera, self.scene, self._intersector, self._settings = camera, scene, intersector, context.settings
        self._basis = None if camera.colour is None else camera.colour.basis
        self._channels = channels = scene.channels if camera.colour is None else 1
        self._scatters, self._lights = plan.runs(Stage.SCATTERING), plan.runs(Stage.DIRECT_LIGHT)
        self._goes_on, self._apart = plan.runs(Stage.ONWARD_RAYS), context.settings.caustics is Caustics.LEFT_OUT
        self._radiance = np.empty((capacity, channels))
        self.met = 0
        """Paths that met a triangle."""
        self._hits = no_hits(scene, capacity)
        queues = [self._ray_queue(capacity) for _ in range(2 if self._scatters else 1)]
        self._now, self._next = queues[0], queues[-1]
        if scene.absorption is not None and intersector is not None:
            self._media = media_at(scene, intersector, np.zeros(3) if camera.position is None else camera.position)
        self._random = self._scatters or scene.alpha is not None or self.moving is not None
        if self._random:
            self._keys, self._indices = np.empty(capacity, dtype=np.uint64), np.empty(capacity, dtype=np.uint32)
        if self._scatters:
            self._stage = InteractionStage(scene, capacity, channels, lights=self._lights)
            traced = scene.absorption is not None or self._apart
            self._source = np.empty(capacity, dtype=np.int64) if traced else None
            room = capacity if self._lights else 0
            self._shadow = ShadowRays(np.empty((room, 6)), np.empty(room, np.int64), np.empty((room, channels)))
            self._blocked = np.empty(room, dtype=np.uint8)

    def _ray_queue(self, capacity: int) -> RayQueue:
        """Room for rays and what belongs to them."""
        absorbs = self.scene.absorption is not None
        return RayQueue(
            rays=np.empty((capacity, 6)),
            path=np.empty(capacity, dtype=np.int64),
            throughput=np.empty((capacity, self._channels)) if self._goes_on or absorbs else None,
            pdf=np.empty(capacity) if self._goes_on else None,
            media=np.empty((capacity, NESTED), dtype=np.int32) if absorbs else None,
            rough=np.empty(capacity, dtype=np.uint8) if self._apart else None,
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
        """What the paths of a bundle see, (n, channels); 0 for those that did not leave the lens.

        With `waves`, the number of each path's wavelength, there is one channel.
        """
        max_bounces, wavelengths = self._settings.max_bounces, Wavelengths(waves, self._basis)
        radiance = self._radiance[:n]
        radiance[:] = 0.0
        found = self._start(blocks, start, n, batch, number)
        if observer is not None:
            observer.left(self._now.rays[:found])
        for bounce in range(max_bounces + 1):
            hits = self._meet(found, bounce)
            if bounce == 0:
                self.met += int(np.count_nonzero(hits.triangle >= 0))
            self._see(radiance, hits, wavelengths)
            if observer is not None:
                observer.saw(self._now.rays[:found], hits, radiance)
            if bounce == max_bounces or not self._scatters:
                break
            found = self._scatter(radiance, hits, bounce, wavelengths, observer)
            self._now, self._next = self._next, self._now
            if not found:
                break
        return radiance

    def _start(self, blocks: Floats, start: int, n: int, batch: Batch, number: NDArray[np.int64]) -> int:
        """Rays from the camera; returns how many there are."""
        now = self._now
        found = int(fill_world_rays(now.rays, now.path, blocks, n, self._camera.rotation, self._camera.position))
        if self._random:
            fill_path_keys(self._keys[:n], self._indices[:n], start, batch, number)
        if self.moving is not None:
            keys = self._keys[:n], self._indices[:n]
            self.moving.begin(now.rays[:found], now.path[:found], keys, start, batch, number)
        for column, value in ((now.throughput, 1.0), (now.pdf, DELTA), (now.rough, 0)):
            if column is not None:
                column[:found] = value
        if now.media is not None:
            now.media[:found] = self._media
        return found

    def _path_keys(self) -> PathKeys:
        return PathKeys(self._now.path, self._keys, self._indices)

    def _meet(self, found: int, bounce: int) -> Hits:
        """Find what rays meet, through surfaces that are not there for their paths."""
        hits, rays, path = self._hits.first(found), self._now.rays[:found], self._now.path[:found]
        intersector = self._intersector if self.moving is None else self.moving.along(path)
        if intersector is not None:
            intersector.fill_closest(hits, rays)
            if self.scene.alpha is not None:
                skip_transparent(self.scene, intersector, rays, hits, self._path_keys(), bounce * SALTS)
            if self.moving is not None:
                self.moving.place(hits, path)
        return hits

    def _see(self, radiance: Floats, hits: Hits, wavelengths: Wavelengths) -> None:
        """Add what rays meet that shines, and weaken them by what they have come through."""
        scene, now = self.scene, self._now
        if scene.absorption is not None and scene.bsdf is not None:
            from plenoptic.scene.materials.kernels.absorption import fill_absorbed

            fill_absorbed(now, hits, scene.geometry, scene.bsdf.glass_index, scene.absorption, wavelengths)
        if scene.emission is not None or any(part is not None for part in scene.lights.sky):
            from plenoptic.rendering.integrator.kernels.emission import add_emission

            add_emission(radiance, now, hits, scene.geometry, scene.emission, scene.lights.sky, wavelengths)

    def _scatter(
        self, radiance: Floats, hits: Hits, bounce: int, wavelengths: Wavelengths, observer: PathObserver | None
    ) -> int:
        """Add direct light and send the rays onwards; returns how many there are."""
        met = self._stage.find(self._now, hits, self._path_keys(), bounce, wavelengths)
        if self._lights:
            drawn = self._stage.draw_lights(met, self._now, wavelengths)
            shadow, blocked = self._add_direct(radiance, met, drawn, wavelengths)
            if observer is not None:
                observer.lit(met, drawn, shadow, blocked)
        # After the last bounce only what a ray meets by chance is missing.
        onwards = self._send_on(met, wavelengths, russian_roulette=bounce >= ROULETTE) if self._goes_on else 0
        if observer is not None:
            chosen = onwards
            if self._goes_on and not onwards:
                chosen = self._send_on(met, wavelengths, russian_roulette=False)
            observer.scattered(met, self._next, onwards, chosen)
        return onwards

    def _add_direct(
        self, radiance: Floats, interactions: Interactions, drawn: DrawnLights, wavelengths: Wavelengths
    ) -> tuple[ShadowRays, NDArray[np.uint8]]:
        """Add the drawn lights that nothing hides; returns the shadow rays that were sent, and which were blocked."""
        scene = self.scene
        count = eval_direct(self._shadow, interactions, drawn, self._now, scene.bsdf, wavelengths)
        shadow, blocked = self._shadow.first(count), self._blocked[:count]
        if count:
            intersector = self._intersector if self.moving is None else self.moving.along(shadow.path)
            assert intersector is not None
            if scene.alpha is None:
                intersector.fill_blocked(blocked, shadow.rays)
            else:
                attenuate_shadows(scene, intersector, shadow.rays, blocked, shadow.radiance)
            add_direct(radiance, blocked, shadow)
        return shadow, blocked

    def _send_on(self, interactions: Interactions, wavelengths: Wavelengths, *, russian_roulette: bool) -> int:
        """Draw the rays onwards; returns how many there are."""
        scene, now, then = self.scene, self._now, self._next
        onwards = int(sample_bsdf(then, self._source, interactions, now, scene.bsdf, wavelengths, russian_roulette))
        if self._source is not None:
            self._hand_on(self._source[:onwards], interactions)
        return onwards

    def _hand_on(self, source: NDArray[np.int64], interactions: Interactions) -> None:
        """Tell rays onwards what they are in and what they come from."""
        now, then, scene = self._now, self._next, self.scene
        if scene.absorption is not None and scene.bsdf is not None:
            from plenoptic.scene.materials.kernels.absorption import fill_next_media

            fill_next_media(then.media, source, now.media, interactions, scene.bsdf.glass_index)
        if now.rough is not None:
            assert then.rough is not None and then.pdf is not None
            surface, onwards = np.where(source < 0, -1 - source, source), len(source)
            # A negative density is that of a direction without choice: a mirror's.
            then.rough[:onwards] = now.rough[interactions.ray[surface]] | (then.pdf[:onwards] > 0)
