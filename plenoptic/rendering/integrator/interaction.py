"""Surface interactions of the rays of a bundle, and the lights sampled for them."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels import sobol
from plenoptic.core.values import Floats
from plenoptic.rendering.integrator.kernels.direct_light import eval_direct
from plenoptic.rendering.integrator.ray_queue import RayQueue, ShadowRays, Wavelengths
from plenoptic.scene.geometry.geometry_records import INTERACTION_COLUMNS, Hits, Interactions, PathKeys
from plenoptic.scene.geometry.kernels.interaction import fill_interactions
from plenoptic.scene.lights.kernels.sample_emitters import sample_emitters
from plenoptic.scene.lights.light_records import DRAWN_COLUMNS, DrawnLights
from plenoptic.scene.materials.kernels.parameters import apply_normal_map, apply_textures, fill_parameters
from plenoptic.scene.scene_record import SceneRecord


class InteractionStage:
    """Computes the surface properties at the hits of rays; its arrays are reused for each bounce."""

    def __init__(self, scene: SceneRecord, capacity: int, channels: int, *, lights: bool) -> None:
        self._scene = scene
        extra_parameters = None if scene.bsdf is None else scene.bsdf.extra_shares
        columns = INTERACTION_COLUMNS + (0 if extra_parameters is None else extra_parameters.shape[1])
        self._buffer = Interactions(
            rows=np.empty((capacity, columns)),
            ray=np.empty(capacity, dtype=np.int64),
            path=np.empty(capacity, dtype=np.int64),
            material=np.empty(capacity, dtype=np.int64),
            base_color=np.empty((capacity, channels)),
            random=np.empty((sobol.DIMENSIONS, capacity)),
            key=np.empty(capacity, dtype=np.uint64),
            number=np.empty(capacity, dtype=np.uint32),
        )
        n_lights = capacity if lights else 0
        self._fill_interactions, self._fill_parameters = fill_interactions.specialize(), fill_parameters.specialize()
        self._sample_emitters, self._apply_textures = sample_emitters.specialize(), apply_textures.specialize()
        self._drawn = DrawnLights(np.empty((n_lights, DRAWN_COLUMNS)), np.empty((n_lights, channels)))
        self._choice: Floats | None = None
        if lights and scene.lights.candidates > 1:
            from plenoptic.rendering.integrator.kernels.choose_lights import CHOICE_ROWS

            self._choice = np.empty((CHOICE_ROWS, capacity))

    def evaluate(
        self, queue: RayQueue, hits: Hits, keys: PathKeys, bounce: int, wavelengths: Wavelengths
    ) -> Interactions:
        """Evaluate the surface interactions at the hits on surfaces that scatter."""
        scene, buffer, geometry, bsdf = self._scene, self._buffer, self._scene.geometry, self._scene.bsdf
        assert bsdf is not None
        count = self._fill_interactions(buffer, hits, queue.rays, queue.path, geometry, bsdf.scatters)
        surfaces = buffer.first(count)
        sobol.fill_samples(
            surfaces.random, surfaces.key, surfaces.number, surfaces.path, keys.key, keys.number, bounce + 1
        )
        self._fill_parameters(surfaces, bsdf, wavelengths)
        if scene.textures is not None:
            *columns, normal = scene.textures
            if any(column is not None for column in columns):
                self._apply_textures(surfaces, scene.textures, scene.channels, wavelengths)
            if normal is not None:
                apply_normal_map(surfaces, hits, queue.rays, geometry, normal)
        return surfaces

    def draw_lights(
        self, interactions: Interactions, queue: RayQueue, wavelengths: Wavelengths, shadow: ShadowRays
    ) -> DrawnLights:
        """Sample one light for each interaction. `shadow` is room for contributions of lights."""
        count, choice, bsdf = self._scene.lights.candidates, self._choice, self._scene.bsdf
        if choice is None:
            return self._draw(interactions, queue, wavelengths)
        from plenoptic.rendering.integrator.kernels import choose_lights

        choose_lights.begin_choice(choice, interactions)
        for k in range(count):
            choose_lights.set_candidate(choice, interactions, k, count)
            drawn = self._draw(interactions, queue, wavelengths)
            choose_lights.add_candidate(
                choice, interactions, shadow, eval_direct(shadow, interactions, drawn, queue, bsdf, wavelengths)
            )
        choose_lights.end_choice(choice, interactions, count)
        drawn, n = self._draw(interactions, queue, wavelengths), len(interactions.path)
        drawn.radiance[:n] *= choice[choose_lights.FACTOR, :n, None]
        return drawn

    def _draw(self, interactions: Interactions, queue: RayQueue, wavelengths: Wavelengths) -> DrawnLights:
        """Draw a light for each interaction by its random numbers."""
        scene, drawn, bsdf = self._scene, self._drawn, self._scene.bsdf
        assert bsdf is not None
        emitters = scene.geometry, scene.emission, scene.alpha, scene.lights
        self._sample_emitters(drawn, interactions, *emitters, bsdf.takes_light, wavelengths)
        if scene.absorption is not None:
            from plenoptic.scene.materials.kernels import absorption

            extinction = scene.absorption if scene.media is None else scene.media.extinction
            absorption.fill_dimmed_lights(drawn, queue.media, interactions, extinction, wavelengths)
        return drawn
