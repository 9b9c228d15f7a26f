"""Particles in exposures: their light is added to that of surfaces."""

from __future__ import annotations

import dataclasses
import math
import time
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.checks import sensor_region
from plenoptic.camera.psf.point_spread import check_focusing
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.values import Floats, flag, seed_number
from plenoptic.core.warn import warn
from plenoptic.errors import BlackImageWarning, InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.points.particle_scene import particle_scene, pixel_area
from plenoptic.rendering.points.particle_tracing import REPLICATES, choose_rays, trace_particles
from plenoptic.rendering.points.point_weights import TARGET_ERROR
from plenoptic.rendering.schedule.outcome import warn_if_late

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts
    from plenoptic.rendering.plan.stages import Subject
    from plenoptic.rendering.schedule.budget import Budget
    from plenoptic.rendering.schedule.run import RenderOptions
    from plenoptic.scene.scene import Scene

_ROWS = 128
"""Rows of an image to which the light of particles is added together."""


GHOST_ERROR = 10.0
"""Error of the light of ghosts over that of the image, each as a fraction of its light: ghosts are the smaller part."""


class PointsImage(NamedTuple):
    """Image of particles on the whole sensor and the squares of its errors, (rows, columns, channels)."""

    image: Floats
    variance: Floats
    seconds: float
    """Time that their rays took."""


def image_of_points(
    scene: Scene, camera: PlenopticCamera, budget: Budget, seed: int, threads: int, ghosts: Ghosts | None = None
) -> PointsImage:
    """Image of a scene's particles, or of their `ghosts` alone; memory does not grow with their number.

    Under a time limit, of which surfaces get the second half, they may have fewer rays than their error needs.
    """
    from plenoptic.rendering.points.kernels.particle_rays import add_entries

    assert scene.points is not None
    check_focusing(camera)
    begin, part_of_time = time.perf_counter(), 0.5 if scene.has_surfaces_or_light else 0.9
    end = math.inf if budget.time_limit is None else begin + part_of_time * budget.time_limit
    traced = particle_scene(scene.points, camera, scene, seed, ghosts)
    rows, columns = camera.sensor.shape
    image, variance = np.zeros((2, rows * columns, traced.image_channels))
    if len(traced.lit):
        target_error = TARGET_ERROR if budget.target_error is None else budget.target_error
        target_error *= 1.0 if ghosts is None else GHOST_ERROR
        rays = choose_rays(traced, target_error, threads, end)
        intensity = traced.intensity / pixel_area(camera)
        for part in trace_particles(traced, rays, threads, traced.lit):
            add_entries(image, variance, part.counts, part.entries, intensity[part.number])
    shape = rows, columns, traced.image_channels
    return PointsImage(image.reshape(shape), variance.reshape(shape), time.perf_counter() - begin)


def add_points(shot: Exposure, points: PointsImage, threads: int) -> Exposure:
    """Exposure of the surfaces of a scene, with the light of its particles; variances add up."""
    assert shot.camera is not None
    first_row, end_row, first_column, end_column = shot.region or sensor_region(shot.camera.sensor.shape, None)
    crop = slice(first_row, end_row), slice(first_column, end_column)
    light, variance, of_surfaces = points.image[crop], points.variance[crop], shot.standard_error
    image = np.empty(np.broadcast_shapes(shot.image.shape, light.shape), np.float32)
    error = None if of_surfaces is None else np.empty(image.shape, np.float32)

    def fill_rows(first: int) -> None:
        rows = slice(first, first + _ROWS)
        image[rows] = shot.image[rows] + light[rows]
        if error is not None and of_surfaces is not None:
            error[rows] = np.sqrt(np.square(of_surfaces[rows], dtype=np.float64) + variance[rows])

    for _ in run_in_order(fill_rows, range(0, len(image), _ROWS), threads=threads):
        pass
    for array in (image, error):
        if array is not None:
            array.flags.writeable = False  # exposures copy no frozen arrays
    return dataclasses.replace(shot, image=image, standard_error=error)


def exposure_of_points(subject: Subject, budget: Budget, options: RenderOptions) -> Exposure:
    """Exposure of a scene that holds particles alone, without paths from pixels."""
    scene, camera = subject.scene, subject.camera
    assert scene is not None
    if options.checkpoint is not None or options.client is not None:
        raise InvalidValueError(
            "particles alone are traced by threads of this process, at once: leave out checkpoint and client"
        )
    flag(options.progress, "progress")
    region, seed = sensor_region(camera.sensor.shape, options.region), seed_number(options.seed)
    dark = np.zeros((region[1] - region[0], region[3] - region[2], 1), np.float32)
    shot = Exposure(
        dark,
        standard_error=dark,
        replicates=REPLICATES,
        samples=REPLICATES,
        seed=seed,
        camera=camera,
        region=None if options.region is None else region,
        settings=subject.settings,
        white=False,
    )
    threads = thread_count(options.threads)
    points = image_of_points(scene, camera, budget, seed, threads)
    shot = add_points(shot, points, threads)
    warn_if_late(None, budget.time_limit, points.seconds, points.seconds)
    if not shot.image.any():
        warn("no light of the particles reaches these pixels, and the image is black", BlackImageWarning)
    return shot
