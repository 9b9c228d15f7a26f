"""Estimate of a render's time, memory, error and file sizes, from pilot runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera, sensor_region
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import seed_number
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.context import render_context
from plenoptic.rendering.estimation.costs import Pilots, costs_by_error, costs_by_samples
from plenoptic.rendering.estimation.estimated import Estimate
from plenoptic.rendering.estimation.totals import totals
from plenoptic.rendering.plan.stages import Stage, Subject
from plenoptic.rendering.schedule.budget import checked_budget
from plenoptic.rendering.schedule.time_history import time_history
from plenoptic.rendering.settings import Caustics, Ghosts, RenderSettings, Sampler
from plenoptic.truth.channels import Truth
from plenoptic.truth.truth_arrays import available_truth

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene


def estimate(  # noqa: PLR0913
    scene: Scene | None,
    camera: PlenopticCamera,
    *,
    samples: int | None = None,
    target_error: float | None = None,
    region: tuple[slice, slice] | None = None,
    replicates: int = 2,
    sampler: Sampler = Sampler.SOBOL,
    max_bounces: int = 8,
    caustics: Caustics = Caustics.INCLUDE,
    clamp: float | None = None,
    ghosts: Ghosts | None = None,
    truth: Truth = Truth.DEPTH,
    threads: int | None = None,
    progress: bool = True,
) -> Estimate:
    """Estimate time, memory, error and file sizes of `render` in a few seconds, from pilot runs all over the frame.

    Parameters
    ----------
    scene : Scene or None
        None: a white image, as of `render_white`.
    camera : PlenopticCamera
    samples, target_error
        As for `render`; one of them, or both: whichever is reached first.
    region, replicates, sampler, max_bounces, caustics, clamp, ghosts, truth, threads
        As for `render`. Of ghosts the set-up and the samples of their own are added; white images have none.
    progress : bool, optional
        Whether to show that something is being compiled; compilation is not part of the estimate.

    Returns
    -------
    Estimate
        Times hold for this machine under its present load. The bar of a render with the same arguments starts with it
        (with that of the image, since ghosts have a bar of their own).

    Raises
    ------
    InvalidValueError
        If an argument is invalid.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> estimate = pl.estimate(pl.check_scene(), camera, samples=64, progress=False)
    >>> 0 < estimate.seconds.low <= estimate.seconds.value <= estimate.seconds.high
    True
    """
    check_scene_and_camera(scene, camera)
    if samples is None and target_error is None:
        raise InvalidValueError("samples and target_error are both None; give one or both to end the render")
    budget = checked_budget(samples, None, target_error, replicates)
    settings = RenderSettings(0 if scene is None else max_bounces, caustics, clamp, sampler, ghosts)
    requested = Truth.NONE if scene is None else truth
    subject = Subject(scene, camera, budget.max_samples, budget.replicates, requested, settings)
    workers = thread_count(threads)
    if scene is not None and ghosts is not None:
        from plenoptic.camera.ghosts.ghost_camera import ghost_lens  # few images have ghosts

        ghost_lens(camera, ghosts)  # raises errors before pilots run
    with CallProgress("estimating", kind="scene", show=progress):
        context = render_context(subject, seed_number(0))
        meshes, microlenses = context.intersector is not None, camera.microlenses is not None
        available = available_truth(requested, meshes=meshes, microlenses=microlenses)
        reduced_subject = Subject(scene, camera, budget.max_samples, budget.replicates, available, settings)
        sensor_pixels = sensor_region(camera.sensor.shape, region)
        pilots = Pilots(context, reduced_subject, budget, sensor_pixels, workers)
        by_error = target_error is not None and pilots.budget.enough < budget.max_samples
        costs = costs_by_error(pilots) if by_error else costs_by_samples(pilots)
        result = totals(pilots, costs)
        if scene is not None and scene.points is not None:
            from plenoptic.rendering.estimation.particles import with_particles

            result = with_particles(result, scene, camera, target_error, workers)
        # The bar of ghosts is another one.
        time_history.record(subject, budget, sensor_pixels, workers, seconds=result.seconds.value)
        if context.plan.runs(Stage.GHOSTS):
            from plenoptic.rendering.estimation.ghosts import with_ghosts

            result = with_ghosts(result, pilots, costs)
    return result
