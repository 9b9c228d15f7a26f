"""Particles in exposures: their light is added to that of surfaces."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.checks import sensor_region
from plenoptic.camera.psf.point_spread import check_focusing
from plenoptic.core.parallel import thread_count
from plenoptic.core.values import Floats, flag, seed_number
from plenoptic.core.warn import warn
from plenoptic.errors import BlackImageWarning, InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.points.particle_scene import particle_scene, pixel_area
from plenoptic.rendering.points.particle_tracing import REPLICATES, choose_rays, trace_particles
from plenoptic.rendering.points.point_weights import TARGET_ERROR

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.rendering.plan.stages import Subject
    from plenoptic.rendering.schedule.budget import Budget
    from plenoptic.rendering.schedule.run import RenderOptions
    from plenoptic.scene.scene import Scene


class PointsImage(NamedTuple):
    """Image of particles on the whole sensor and the squares of its errors, (rows, columns, channels)."""

    image: Floats
    variance: Floats


def image_of_points(scene: Scene, camera: PlenopticCamera, target_error: float, seed: int, threads: int) -> PointsImage:
    """Image of a scene's particles; memory does not grow with their number."""
    from plenoptic.rendering.points.kernels.particle_rays import add_entries

    assert scene.points is not None
    check_focusing(camera)
    traced = particle_scene(scene.points, camera, scene, seed)
    rays = choose_rays(traced, target_error, threads)
    rows, columns = camera.sensor.shape
    image, variance = np.zeros((2, rows * columns, traced.image_channels))
    intensity = traced.intensity / pixel_area(camera)
    for part in trace_particles(traced, rays, threads):
        add_entries(image, variance, part.counts, part.entries, intensity[part.number])
    shape = rows, columns, traced.image_channels
    return PointsImage(image.reshape(shape), variance.reshape(shape))


def add_points(shot: Exposure, scene: Scene, budget: Budget, threads: int) -> Exposure:
    """Exposure of the surfaces of a scene, with the light of its particles; variances add up."""
    camera, seed = shot.camera, shot.seed
    assert camera is not None and isinstance(seed, int)
    target_error = TARGET_ERROR if budget.target_error is None else budget.target_error
    points = image_of_points(scene, camera, target_error, seed, threads)
    first_row, end_row, first_column, end_column = shot.region or (0, camera.sensor.shape[0], 0, camera.sensor.shape[1])
    crop = slice(first_row, end_row), slice(first_column, end_column)
    error = shot.standard_error
    if error is not None:
        error = np.sqrt(np.square(error, dtype=np.float64) + points.variance[crop])
    return dataclasses.replace(shot, image=shot.image + points.image[crop], standard_error=error)


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
    shot = add_points(shot, scene, budget, thread_count(options.threads))
    if not shot.image.any():
        warn("no light of the particles reaches these pixels, and the image is black", BlackImageWarning)
    return shot
