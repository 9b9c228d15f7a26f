"""Scattering of the rays of a bundle in media."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels import sobol
from plenoptic.core.values import Floats
from plenoptic.rendering.integrator.kernels import medium_light
from plenoptic.rendering.integrator.kernels import medium_scattering as scattering
from plenoptic.rendering.integrator.ray_queue import Flights, RayQueue, ShadowRays, Wavelengths
from plenoptic.scene.geometry.geometry_records import INTERACTION_COLUMNS, Hits, Interactions, PathKeys
from plenoptic.scene.lights.kernels.sample_emitters import sample_emitters
from plenoptic.scene.lights.light_records import DRAWN_COLUMNS, DrawnLights
from plenoptic.scene.scene_record import SceneRecord

_FLIGHT_SETS, _LIGHT_SETS = 1 << 19, 3 << 18
"""Sets of sampling points for distances and for lights: above those of all bounces, below the others of paths."""
_ROULETTE = 6
"""Number of bounces after which Russian roulette begins: more than at surfaces, since an event costs less in a medium.
Glass and clouds of eight bounces take 1.2 times as long for the same error after three."""
_TAKES_LIGHT = np.ones(1, dtype=np.uint8)


class MediumStage:
    """Points at which rays scatter in media; its arrays are reused for each bounce."""

    def __init__(self, scene: SceneRecord, reach: Floats, channels: int) -> None:
        assert scene.media is not None
        self._scene, self._media, capacity = scene, scene.media, len(reach)
        self._buffer = Flights(
            reach=reach,
            ray=np.empty(capacity, dtype=np.int64),
            path=np.empty(capacity, dtype=np.int64),
            end=np.empty(capacity),
            chance=np.empty(capacity),
            end_random=np.empty((sobol.DIMENSIONS, capacity)),
            light_random=np.empty((sobol.DIMENSIONS, capacity)),
            key=np.empty(capacity, dtype=np.uint64),
            number=np.empty(capacity, dtype=np.uint32),
        )
        self._flights, self._distances = self._buffer.first(0), np.empty((3, capacity))
        self._points = Interactions(
            rows=np.empty((capacity, INTERACTION_COLUMNS)),
            ray=np.empty(capacity, dtype=np.int64),
            path=np.empty(capacity, dtype=np.int64),
            material=np.zeros(capacity, dtype=np.int64),
            base_color=np.empty((0, channels)),
            random=np.empty((sobol.DIMENSIONS, capacity)),
            key=np.empty(0, dtype=np.uint64),
            number=np.empty(0, dtype=np.uint32),
        )
        self._drawn = DrawnLights(np.empty((capacity, DRAWN_COLUMNS)), np.empty((capacity, channels)))

    def begin_flights(self, queue: RayQueue, hits: Hits, keys: PathKeys, bounce: int, wavelengths: Wavelengths) -> None:
        """List the rays that fly in scattering media, and draw their random numbers."""
        buffer = self._buffer._replace(reach=self._buffer.reach[: len(hits.triangle)])
        self._flights = flights = buffer.first(int(scattering.list_flights(buffer, queue, self._media, wavelengths)))
        stream = flights.key, flights.number, flights.path, keys.key, keys.number
        sobol.fill_samples(flights.end_random, *stream, _FLIGHT_SETS + bounce)
        sobol.fill_samples(flights.light_random, *stream, _LIGHT_SETS + bounce)

    def draw_lights(self, shadow: ShadowRays, queue: RayQueue, hits: Hits, wavelengths: Wavelengths) -> int:
        """Draw a light and a point that it lights for each flight, and fill the shadow rays; return their number."""
        scene, drawn, media, distances = self._scene, self._drawn, self._media, self._distances
        flown = self._flights, queue, hits, scene.lights, media, wavelengths
        points = self._points.first(int(medium_light.draw_lit_points(self._points, distances, *flown)))
        emitters = scene.geometry, scene.emission, scene.alpha, scene.lights
        sample_emitters(drawn, points, *emitters, _TAKES_LIGHT, wavelengths)
        return int(medium_light.fill_medium_lights(shadow, points, distances, drawn, queue, media, wavelengths))

    def end_flights(self, queue: RayQueue, hits: Hits, wavelengths: Wavelengths) -> None:
        """Find the rays that scatter before their hit, which is taken from them, and weight them and the others."""
        scattering.end_flights(self._flights, queue, hits, self._media, wavelengths)

    def scatter(self, new: RayQueue, n_rays: int, queue: RayQueue, hits: Hits, bounce: int) -> int:
        """Append the scattered rays to the n_rays of the next queue; return the number of all."""
        arrays = self._flights, queue, hits, self._media, self._scene.lights
        return int(scattering.scatter_in_media(new, n_rays, *arrays, bounce >= _ROULETTE))
