"""What `transport` tells of one path, as events."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.rendering.integrator.record import RayQueue, ShadowRays
from plenoptic.rendering.plan.stages import Plan, Stage
from plenoptic.replaying.ending import PathEnding
from plenoptic.replaying.scene_events import DirectLight, Escape, Meeting
from plenoptic.replaying.scene_names import SceneNames
from plenoptic.scene.compile import SceneRecord
from plenoptic.scene.geometry.record import SHADING_NORMAL, Hits, Interactions
from plenoptic.scene.lights.record import END, DrawnLights
from plenoptic.scene.scene import Scene


class Recorder:
    """A `transport.Witness` of a bundle of one path."""

    def __init__(self, scene: Scene, record: SceneRecord, plan: Plan, max_bounces: int) -> None:
        self._names, self._record, self._plan = SceneNames(scene, record), record, plan
        self._max_bounces = max_bounces
        self._collected: Floats | None = None
        self.events: list[Meeting | Escape] = []
        self.ending = PathEnding.LEFT_SCENE

    def saw(self, rays: Floats, hits: Hits, radiance: Floats) -> None:
        """See `Witness`."""
        if not len(rays):
            return
        collected = radiance[0].copy()
        with np.errstate(all="ignore"):
            emitted = _fixed(collected if self._collected is None else collected - self._collected)
        self._collected = collected
        direction = _fixed(rays[0, 3:].copy())
        if hits.triangle[0] < 0:
            self.events.append(Escape(direction, emitted))
            self.ending = PathEnding.LEFT_SCENE
            return
        hit, instance = int(hits.triangle[0]), -1 if hits.instance is None else int(hits.instance[0])
        place = self._names.place(hit, instance)
        reached, normal = _meet(rays[0], self._names.corners(hit, instance))
        self.events.append(
            Meeting(
                place=place,
                material=self._names.material(place),
                point=_fixed(rays[0, :3] + reached * direction),
                distance=reached + (0.0 if hits.travelled is None else float(hits.travelled[0])),
                normal=_fixed(normal),
                shading_normal=None,
                emitted=emitted,
            )
        )
        self.ending = self._end_here(hit)

    def _end_here(self, hit: int) -> PathEnding:
        """How a path ends that is not scattered where it is."""
        bsdf, geometry = self._record.bsdf, self._record.geometry
        if bsdf is None or geometry is None or not bsdf.scatters[geometry.triangle_material[hit]]:
            return PathEnding.ABSORBED
        scattered = sum(isinstance(event, Meeting) for event in self.events) - 1
        return PathEnding.MAX_BOUNCES if scattered >= self._max_bounces else PathEnding.NO_SURFACE

    def lit(
        self, interactions: Interactions, drawn: DrawnLights, shadow: ShadowRays, blocked: NDArray[np.uint8]
    ) -> None:
        """See `Witness`."""
        bsdf = self._record.bsdf
        if not len(interactions.ray) or bsdf is None or not bsdf.takes_light[interactions.material[0]]:
            return
        kind, place, light = self._names.light(float(interactions.random[0, 0]))
        shines = bool(np.any(drawn.radiance[0] > 0))
        sent = bool(len(shadow.rays))
        added = np.zeros(drawn.radiance.shape[1]) if not sent or blocked[0] else shadow.radiance[0].copy()
        if self._collected is not None:
            with np.errstate(all="ignore"):
                self._collected = self._collected + added
        self._amend(
            light=DirectLight(
                kind=kind,
                place=place,
                light=light,
                point=_fixed(drawn.rows[0, END : END + 3].copy()) if shines else None,
                blocked=bool(blocked[0]) if sent else None,
                contribution=_fixed(added),
            )
        )

    def scattered(self, interactions: Interactions, onward: RayQueue, onwards: int, drawn: int) -> None:
        """See `Witness`."""
        if not len(interactions.ray):
            return
        self._amend(shading_normal=_fixed(interactions.rows[0, SHADING_NORMAL : SHADING_NORMAL + 3].copy()))
        if onwards:
            assert onward.throughput is not None
            self._amend(direction=_fixed(onward.rays[0, 3:].copy()), throughput=_fixed(onward.throughput[0].copy()))
        elif not self._plan.runs(Stage.ONWARD_RAYS):
            self.ending = PathEnding.NOTHING_AHEAD
        else:
            self.ending = PathEnding.ROULETTE if drawn else PathEnding.ABSORBED

    def _amend(self, **known: Any) -> None:
        """Add to the last event what has become known of it."""
        last = self.events[-1]
        assert isinstance(last, Meeting)
        self.events[-1] = dataclasses.replace(last, **known)


def _meet(ray: Floats, corners: Floats) -> tuple[float, Floats]:
    """Distance along a ray to a triangle, and its unit normal on the ray's side; not finite without area."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    with np.errstate(all="ignore"):
        along = normal @ ray[3:]
        distance = float(-(normal @ (ray[:3] - corners[0])) / along)
        normal = normal / np.sqrt(normal @ normal)
    return distance, -normal if along > 0 else normal


def _fixed(array: Floats) -> Floats:
    array.flags.writeable = False
    return array
