"""Estimate of the time and memory that particles take, from some of them."""

from __future__ import annotations

import dataclasses
import time
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.rendering.points.particle_scene import particle_scene
from plenoptic.rendering.points.particle_tracing import choose_rays, entrance_polygons_at
from plenoptic.rendering.points.point_weights import TARGET_ERROR
from plenoptic.rendering.points.points_exposure import GHOST_ERROR
from plenoptic.scene.scene import Scene

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts
    from plenoptic.rendering.estimation.estimated import Estimate, Estimated

_PUPILS = 1 << 13
"""Largest number of particles whose pupils are computed."""


def with_particles(
    estimate: Estimate,
    scene: Scene,
    camera: PlenopticCamera,
    target_error: float | None,
    threads: int,
    ghosts: Ghosts | None = None,
) -> Estimate:
    """Estimate of a render with the particles of its scene, or with their `ghosts`: pupils of some, rays of a few."""
    assert scene.points is not None
    traced = particle_scene(scene.points, camera, scene, 0, ghosts)
    memory = 2.0 * 8 * traced.image_channels * np.prod(camera.sensor.shape) if ghosts is None else 0.0
    pupils = rays = 0.0
    if len(traced.lit):
        target = (TARGET_ERROR if target_error is None else target_error) * (1.0 if ghosts is None else GHOST_ERROR)
        choice, begin = choose_rays(traced, target, 1), time.perf_counter()
        block = traced.lit[:: -(-len(traced.lit) // _PUPILS)]
        entrance_polygons_at(traced, block)
        pupils = (time.perf_counter() - begin) * len(traced.lit) / len(block)
        rays = choice.rays * choice.seconds * len(traced.lit)
    scene_factor = 1.0 if scene.has_surfaces_or_light or ghosts is not None else 0.0
    return dataclasses.replace(
        estimate,
        cpu_seconds=_sum(estimate.cpu_seconds, scene_factor, pupils + rays),
        seconds=_sum(estimate.seconds, scene_factor, (pupils + rays) / threads),
        peak_memory=_sum(estimate.peak_memory, 1.0, memory),
        relative_error=None,
    )


def _sum(number: Estimated, factor: float, more: float) -> Estimated:
    return number._replace(
        value=factor * number.value + more, low=factor * number.low + 0.6 * more, high=factor * number.high + 1.5 * more
    )
