"""Light transport: paths that left the lens, followed through the scene stage after stage."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.record import Batch
from plenoptic.rendering.context import Compiled
from plenoptic.rendering.integrator.interaction import MetSurfaces, PathRays
from plenoptic.rendering.plan.scene_stages import ROULETTE
from plenoptic.rendering.plan.stages import Stage
from plenoptic.rendering.settings import Caustics
from plenoptic.scene.compile import SceneRecord
from plenoptic.scene.geometry.record import Hits
from plenoptic.scene.materials.alpha_mask import SALTS, media_at, pass_through, thin_out


class Witness(Protocol):
    """Is told what the paths of a bundle go through. What it is handed is used again: it copies what it keeps."""

    def saw(
        self,
        rays: NDArray[np.float64],
        hits: NDArray[np.int32],
        placed: NDArray[np.int32] | None,
        travelled: NDArray[np.float64] | None,
        radiance: NDArray[np.float64],
    ) -> None:
        """Rays have met triangles, `travelled` to where they are now, and paths have collected what shines there."""

    def lit(
        self,
        met: MetSurfaces,
        shadow_rays: NDArray[np.float64],
        blocked: NDArray[np.uint8],
        shadow_radiance: NDArray[np.float64],
    ) -> None:
        """Lights were drawn for surfaces, and some of them could be seen."""

    def scattered(self, met: MetSurfaces, then: PathRays, onwards: int, drawn: int) -> None:
        """So many rays go on, of those that were drawn: the others ended by chance. Known where none goes on."""


class Transport:
    """Follows the paths of a tile's bundles through the scene; its arrays are used again for each bundle."""

    def __init__(self, view: Compiled, most: int) -> None:
        assert view.scene is not None
        tables, scene, intersector, settings = view.camera, view.scene, view.intersector, view.settings
        self._camera, self._scene, self._intersector, self._settings = tables, scene, intersector, settings
        self._basis = None if tables.colour is None else tables.colour.basis
        self._channels = channels = scene.channels if tables.colour is None else 1
        plan = settings.plan
        self._radiance = np.empty((most, channels))
        self.met = 0
        """Paths that met a triangle."""
        self._hits = np.full(most, -1, dtype=np.int32)
        self._placed = None if scene.instances is None else np.full(most, -1, dtype=np.int32)
        scattering, telling = plan.runs(Stage.SCATTERING), settings.how.caustics is Caustics.LEFT_OUT
        pair = [
            PathRays(most, channels, scene, onward=plan.runs(Stage.ONWARD_RAYS), telling=telling)
            for _ in range(2 if scattering else 1)
        ]
        self._now, self._next = pair[0], pair[-1]
        if scene.alpha is not None:
            self._travelled = np.empty(most)
        if scene.absorption is not None and intersector is not None:
            self._media = media_at(scene, intersector, np.zeros(3) if tables.position is None else tables.position)
        if scattering or scene.alpha is not None:
            self._keys, self._indices = np.empty(most, dtype=np.uint64), np.empty(most, dtype=np.uint32)
        if scattering:
            assert intersector is not None
            lights = plan.runs(Stage.DIRECT_LIGHT)
            self._met = MetSurfaces(scene, self._basis, most, channels, lights=lights)
            self._from = np.empty(most, dtype=np.int64)
            room = most if lights else 0
            self._shadow_rays = np.empty((room, 6))
            self._shadow_path = np.empty(room, dtype=np.int64)
            self._shadow_radiance = np.empty((room, channels))
            self._blocked = np.empty(room, dtype=np.uint8)

    def radiance(
        self,
        blocks: NDArray[np.float64],
        start: int,
        n: int,
        batch: Batch,
        number: NDArray[np.int64],
        waves: NDArray[np.int64] | None,
        witness: Witness | None = None,
    ) -> NDArray[np.float64]:
        """What the paths of a bundle see, (n, channels); 0 for those that did not leave the lens.

        With `waves`, the number of each path's wavelength, there is one channel.
        """
        from plenoptic.camera.kernels.world_rays import fill_world_rays

        scene, settings, plan = self._scene, self._settings, self._settings.plan
        max_bounces = settings.how.max_bounces
        radiance = self._radiance[:n]
        radiance[:] = 0.0
        now = self._now
        found = fill_world_rays(now.rays, now.path_of, blocks, n, self._camera.rotation, self._camera.position)
        if plan.runs(Stage.SCATTERING) or scene.alpha is not None:
            from plenoptic.rendering.integrator.kernels.path_keys import fill_path_keys

            fill_path_keys(self._keys[:n], self._indices[:n], start, batch, number)
        if scene.absorption is not None:
            assert now.throughput is not None and now.media is not None
            now.throughput[:found], now.media[:found] = 1.0, self._media
        if now.rough is not None:
            now.rough[:found] = 0
        for bounce in range(max_bounces + 1):
            self._meet(found, bounce)
            if bounce == 0:
                self.met += int(np.count_nonzero(self._hits[:found] >= 0))
            self._see(radiance, found, bounce, waves)
            if witness is not None:
                placed = None if self._placed is None else self._placed[:found]
                travelled = None if scene.alpha is None else self._travelled[:found]
                witness.saw(self._now.rays[:found], self._hits[:found], placed, travelled, radiance)
            if bounce == max_bounces or not plan.runs(Stage.SCATTERING):
                break
            found = self._scatter(radiance, found, bounce, waves, witness)
            self._now, self._next = self._next, self._now
            if not found:
                break
        return radiance

    def _meet(self, found: int, bounce: int) -> None:
        """Find what rays meet, through surfaces that are not there for their paths."""
        if self._intersector is None:
            return
        now = self._now
        placed = None if self._placed is None else self._placed[:found]
        travelled = None if self._scene.alpha is None else self._travelled[:found]
        hits = Hits(self._hits[:found], placed, travelled)
        self._intersector.fill_closest(hits, now.rays[:found], coherent=bounce == 0)
        if self._scene.alpha is not None:
            pass_through(
                self._scene,
                self._intersector,
                now.rays[:found],
                hits,
                now.path_of,
                self._keys,
                self._indices,
                bounce * SALTS,
            )

    def _see(self, radiance: NDArray[np.float64], found: int, bounce: int, waves: NDArray[np.int64] | None) -> None:
        """Add what rays meet that shines, and weaken them by what they have come through."""
        from plenoptic.rendering.integrator.kernels import shade

        scene, now, sky, emission = self._scene, self._now, self._scene.lights.sky, self._scene.emission
        geometry, environment = scene.geometry, sky.environment
        hits, rays, path_of = self._hits[:found], now.rays[:found], now.path_of[:found]
        travelled = None if scene.alpha is None else self._travelled
        if scene.absorption is not None:
            from plenoptic.scene.materials.kernels import absorption

            assert geometry is not None and scene.bsdf is not None
            absorption.fill_absorbed(
                now.throughput,
                now.media,
                path_of,
                hits,
                self._placed,
                rays,
                geometry.vertices,
                geometry.triangles,
                geometry.triangle_material,
                geometry.instance_to_world,
                scene.bsdf.glass_index,
                scene.absorption,
                travelled,
                waves,
                self._basis,
            )
        weighed = bounce > 0 or scene.absorption is not None
        if emission is None and sky.background is None and sky.suns is None and environment is None:
            return
        glow = None if emission is None else emission.texture
        shade.fill_emitted(
            radiance,
            now.throughput if weighed else None,
            now.density if bounce > 0 else None,
            now.rough,
            path_of,
            hits,
            self._placed,
            rays,
            None if geometry is None else geometry.vertices,
            None if geometry is None else geometry.triangles,
            None if geometry is None else geometry.triangle_material,
            None if geometry is None else geometry.uv,
            None if geometry is None else geometry.instance_to_world,
            None if emission is None else emission.radiance,
            None if emission is None else emission.two_sided,
            None if glow is None else glow.row,
            None if glow is None else glow.texels,
            None if glow is None else glow.textures,
            None if emission is None else emission.pdf,
            sky.background,
            sky.suns,
            sky.sun_colors,
            None if environment is None else environment.texels,
            None if environment is None else environment.pdf,
            None if environment is None else environment.rotation,
            0.0 if environment is None else environment.probability,
            travelled,
            waves,
            self._basis,
        )

    def _scatter(
        self,
        radiance: NDArray[np.float64],
        found: int,
        bounce: int,
        waves: NDArray[np.int64] | None,
        witness: Witness | None,
    ) -> int:
        """Add direct light and send the rays onwards; returns how many there are."""
        scene, now, met, plan = self._scene, self._now, self._met, self._settings.plan
        placed = None if self._placed is None else self._placed[:found]
        met.describe(now, self._hits[:found], placed, self._keys, self._indices, bounce, waves)
        throughput = now.throughput if bounce > 0 or scene.absorption is not None else None
        if plan.runs(Stage.DIRECT_LIGHT):
            met.draw_lights(now, waves)
            shadows = self._add_direct(radiance, throughput, waves)
            if witness is not None:
                rays, blocked = self._shadow_rays[:shadows], self._blocked[:shadows]
                witness.lit(met, rays, blocked, self._shadow_radiance[:shadows])
        # After the last bounce only what a ray meets by chance is missing.
        onwards, goes_on = 0, plan.runs(Stage.ONWARD_RAYS)
        if goes_on:
            onwards = self._send_on(throughput, waves, lottery=bounce >= ROULETTE)
        if witness is not None:
            drawn = self._send_on(throughput, waves, lottery=False) if goes_on and not onwards else onwards
            witness.scattered(met, self._next, onwards, drawn)
        return onwards

    def _add_direct(
        self, radiance: NDArray[np.float64], throughput: NDArray[np.float64] | None, waves: NDArray[np.int64] | None
    ) -> int:
        """Add the drawn lights that nothing hides; returns how many shadow rays there were."""
        from plenoptic.rendering.integrator.kernels import shade

        assert self._intersector is not None
        scene, now, met = self._scene, self._now, self._met
        shadows = shade.fill_lit(
            self._shadow_rays,
            self._shadow_path,
            self._shadow_radiance,
            met.rows,
            met.base,
            met.lane_of,
            met.material_of,
            now.rays,
            now.path_of,
            throughput,
            *scattering_columns(scene),
            met.drawn,
            met.lit,
            waves,
            self._basis,
        )
        if not shadows:
            return 0
        blocked, rays = self._blocked[:shadows], self._shadow_rays[:shadows]
        if scene.alpha is None:
            self._intersector.fill_blocked(blocked, rays)
        else:
            thin_out(scene, self._intersector, rays, blocked, self._shadow_radiance)
        shade.fill_direct(radiance, blocked, self._shadow_path[:shadows], self._shadow_radiance)
        return int(shadows)

    def _send_on(
        self, throughput: NDArray[np.float64] | None, waves: NDArray[np.int64] | None, *, lottery: bool
    ) -> int:
        """Draw the rays onwards; returns how many there are."""
        from plenoptic.rendering.integrator.kernels import shade

        scene, now, then, met = self._scene, self._now, self._next, self._met
        traced = scene.absorption is not None or now.rough is not None
        onwards = shade.fill_onward(
            then.rays,
            then.path_of,
            then.throughput,
            then.density,
            self._from if traced else None,
            met.rows,
            met.base,
            met.lane_of,
            met.material_of,
            now.rays,
            now.path_of,
            throughput,
            met.random,
            met.keys,
            met.indices,
            lottery,
            *scattering_columns(scene),
            waves,
            self._basis,
        )
        if traced:
            self._hand_on(int(onwards))
        return int(onwards)

    def _hand_on(self, onwards: int) -> None:
        """Tell rays onwards what they are in and what they come from."""
        now, then, scene, met = self._now, self._next, self._scene, self._met
        came = self._from[:onwards]
        if scene.absorption is not None:
            from plenoptic.scene.materials.kernels import absorption

            absorption.fill_next_media(
                then.media, came, now.media, met.rows, met.lane_of, met.material_of, scattering_columns(scene)[2]
            )
        if now.rough is not None:
            assert then.rough is not None and then.density is not None
            surface = np.where(came < 0, -1 - came, came)
            # A negative density is that of a direction without choice: a mirror's.
            then.rough[:onwards] = now.rough[met.lane_of[surface]] | (then.density[:onwards] > 0)


def scattering_columns(scene: SceneRecord):  # type: ignore[no-untyped-def]
    """What kernels need to know of materials."""
    bsdf = scene.bsdf
    assert bsdf is not None
    return bsdf.kind, bsdf.metal_index, bsdf.glass_index, bsdf.pane_index, bsdf.coupling, bsdf.coupling_mean
