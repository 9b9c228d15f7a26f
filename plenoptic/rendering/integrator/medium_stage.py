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
_TAKES_LIGHT = np.ones(1, dtype=np.uint8)


class MediumStage:
    """Points at which rays scatter in media; its arrays are reused for each bounce."""

    def __init__(self, scene: SceneRecord, reach: Floats, channels: int) -> None:
        assert scene.media is not None
        self._scene, self._media, capacity = scene, scene.media, len(reach)
        samples = np.empty((sobol.DIMENSIONS, capacity)), np.empty((sobol.DIMENSIONS, capacity))
        key, number = np.empty(capacity, dtype=np.uint64), np.empty(capacity, dtype=np.uint32)
        self._flights = Flights(reach, np.empty(capacity), *samples, key, number)
        self._distances, self._lit = np.empty(capacity), np.empty((2, capacity))
        self._buffer = Interactions(
            rows=np.empty((capacity, INTERACTION_COLUMNS)),
            ray=np.empty(capacity, dtype=np.int64),
            path=np.empty(capacity, dtype=np.int64),
            material=np.zeros(capacity, dtype=np.int64),
            base_color=np.empty((0, channels)),
            random=np.empty((sobol.DIMENSIONS, capacity)),
            key=np.empty(capacity, dtype=np.uint64),
            number=np.empty(capacity, dtype=np.uint32),
        )
        self._drawn = DrawnLights(np.empty((capacity, DRAWN_COLUMNS)), np.empty((capacity, channels)))
        self._points, self._ends = self._buffer.first(0), self._distances[:0]

    def begin_flights(self, queue: RayQueue, hits: Hits, keys: PathKeys, bounce: int, wavelengths: Wavelengths) -> None:
        """List the rays that fly in scattering media, and draw their random numbers."""
        n, points = len(hits.triangle), self._buffer
        flights = self._flights.first(n)
        stream = flights.key, flights.number, keys.path[:n], keys.key, keys.number
        sobol.fill_samples(flights.distance_random, *stream, _FLIGHT_SETS + bounce)
        sobol.fill_samples(flights.light_random, *stream, _LIGHT_SETS + bounce)
        self._points = points.first(int(medium_light.list_flights(points, flights, queue, self._media, wavelengths)))

    def draw_lights(self, shadow: ShadowRays, queue: RayQueue, hits: Hits, wavelengths: Wavelengths) -> int:
        """Draw a light and a point that it lights for each flight, and fill the shadow rays; return their number."""
        scene, drawn, flights, media = self._scene, self._drawn, self._flights, self._media
        flown = self._lit, flights, queue, hits
        count = medium_light.draw_lit_points(self._points, *flown, scene.lights, media, wavelengths)
        points = self._points.first(int(count))
        emitters = scene.geometry, scene.emission, scene.alpha, scene.lights
        sample_emitters(drawn, points, *emitters, _TAKES_LIGHT, wavelengths)
        lit = points, self._lit, flights, drawn
        return int(medium_light.fill_medium_lights(shadow, *lit, queue, media, wavelengths))

    def end_flights(self, queue: RayQueue, hits: Hits, wavelengths: Wavelengths) -> None:
        """Find the rays that scatter before their hit, which is taken from them, and weight them and the others."""
        self._ends = self._distances[: len(hits.triangle)]
        scattering.end_flights(self._ends, self._flights, queue, hits, self._media, wavelengths)

    def scatter(self, new: RayQueue, n_rays: int, queue: RayQueue, *, russian_roulette: bool) -> int:
        """Append the scattered rays to the n_rays of the next queue; return the number of all."""
        ends, flights = self._ends, self._flights
        return int(scattering.scatter_in_media(new, n_rays, ends, flights, queue, self._media, russian_roulette))
