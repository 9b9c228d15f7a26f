"""Scattering of the rays of a bundle in media."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels import sobol
from plenoptic.core.values import Floats
from plenoptic.rendering.integrator.kernels import medium_scattering as kernels
from plenoptic.rendering.integrator.ray_queue import RayQueue, ShadowRays, Wavelengths
from plenoptic.scene.geometry.geometry_records import INTERACTION_COLUMNS, Hits, Interactions, PathKeys
from plenoptic.scene.lights.kernels.sample_emitters import sample_emitters
from plenoptic.scene.lights.light_records import DRAWN_COLUMNS, DrawnLights
from plenoptic.scene.scene_record import SceneRecord

_FLIGHT_SETS = 1 << 19
"""Sets of sampling points for distances: above those of all bounces, below the others of paths."""
_TAKES_LIGHT = np.ones(1, dtype=np.uint8)


class MediumStage:
    """Points at which rays scatter in media; its arrays are reused for each bounce."""

    def __init__(self, scene: SceneRecord, glass_index: Floats, capacity: int, channels: int) -> None:
        assert scene.media is not None
        self._scene, self._media, self._glass_index = scene, scene.media, glass_index
        self._flights, self._reach = np.empty(capacity), np.empty(capacity)
        self._surrounding = -1 if scene.surrounding is None else scene.surrounding
        self._buffer = Interactions(
            rows=np.empty((capacity, INTERACTION_COLUMNS)),
            ray=np.empty(capacity, dtype=np.int64),
            path=np.empty(capacity, dtype=np.int64),
            material=np.empty(capacity, dtype=np.int64),
            base_color=np.empty((0, channels)),
            random=np.empty((sobol.DIMENSIONS, capacity)),
            key=np.empty(capacity, dtype=np.uint64),
            number=np.empty(capacity, dtype=np.uint32),
        )
        self._drawn = DrawnLights(np.empty((capacity, DRAWN_COLUMNS)), np.empty((capacity, channels)))
        self._vertices = self._buffer.first(0)

    def end_flights(self, queue: RayQueue, hits: Hits, keys: PathKeys, bounce: int, wavelengths: Wavelengths) -> None:
        """Find the rays that scatter before their hit, which is taken from them, and weight them and the others."""
        n, buffer, scene = len(hits.triangle), self._buffer, self._scene
        flights, random = self._flights[:n], buffer.random
        sobol.fill_samples(
            random, buffer.key, buffer.number, keys.path[:n], keys.key, keys.number, _FLIGHT_SETS + bounce
        )
        reach = self._reach[:n]
        kernels.fill_reaches(reach, queue, hits, scene.geometry, self._glass_index, self._surrounding)
        kernels.end_flights(flights, reach, queue, hits, self._media, random, wavelengths)
        self._vertices = buffer.first(int(kernels.fill_vertices(buffer, flights, queue)))
        points = self._vertices
        sobol.fill_samples(random, points.key, points.number, points.path, keys.key, keys.number, bounce + 1)

    def draw_lights(self, shadow: ShadowRays, queue: RayQueue, wavelengths: Wavelengths) -> int:
        """Draw a light for each point and fill the shadow rays; return their number."""
        scene, points, drawn = self._scene, self._vertices, self._drawn
        emitters = scene.geometry, scene.emission, scene.alpha, scene.lights
        sample_emitters(drawn, points, *emitters, _TAKES_LIGHT, wavelengths)
        return int(kernels.fill_medium_lights(shadow, points, drawn, queue, self._media, wavelengths))

    def scatter(self, new: RayQueue, n_rays: int, queue: RayQueue, *, russian_roulette: bool) -> int:
        """Append the scattered rays to the n_rays of the next queue; return the number of all."""
        return int(kernels.scatter_in_media(new, n_rays, self._vertices, queue, self._media, russian_roulette))
