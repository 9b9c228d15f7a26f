"""A render from options to exposure: set-up, batches until the budget is used, outcome."""

from __future__ import annotations

import contextlib
import functools
import os
import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from plenoptic.camera.checks import sensor_region
from plenoptic.camera.sampling.aperture_regions import cells_per_pixel
from plenoptic.core.engines.choice import cluster_of
from plenoptic.core.engines.engine import Engine
from plenoptic.core.numba.parallel_compilation import compile_in_parallel
from plenoptic.core.parallel import thread_count
from plenoptic.core.values import flag, seed_number, whole
from plenoptic.core.warn import warn
from plenoptic.errors import BlackImageWarning, BudgetWarning
from plenoptic.optics.lens.analysis.conditioning import Conditioning
from plenoptic.rendering.context import RenderContext, render_context
from plenoptic.rendering.crop import samples_text
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.film import in_whole_blocks, pools_errors
from plenoptic.rendering.plan.scene_stages import is_dark
from plenoptic.rendering.plan.stages import Stage, Subject
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.schedule.outcome import exposure_of, warn_if_late
from plenoptic.rendering.schedule.progress import FilmRegion, Progress
from plenoptic.rendering.schedule.progress_bar import ProgressBar
from plenoptic.rendering.schedule.scheduler import Scheduler, batch_divisor
from plenoptic.rendering.schedule.tile_jobs import RenderTask, TileJob, compile_tiles, thread_engine, tile_renderer
from plenoptic.rendering.schedule.time_history import time_history
from plenoptic.rendering.tile import Tile, TileResult, status_codes
from plenoptic.rendering.tiling import cut_into_tiles
from plenoptic.truth.channels import Truth
from plenoptic.truth.ground_truth import truth_record
from plenoptic.truth.truth_arrays import available_truth, empty_truth

if TYPE_CHECKING:
    from plenoptic.core.engines.dask_engine import DaskCluster
    from plenoptic.rendering.schedule.checkpoint import Checkpoint

_MAX_CONDITIONED = 1 << 20
"""Maximum number of paths whose conditioning is reported: they are traced in one bundle."""


class RenderOptions(NamedTuple):
    """Options of a render other than subject and budget; see `render`."""

    region: tuple[slice, slice] | None
    seed: int
    threads: int | None
    tile_side: int | None
    progress: bool
    conditioning: int | None
    checkpoint: str | os.PathLike[str] | None
    checkpoint_interval: float
    client: Any = None


class RenderSetup(NamedTuple):
    """All that a render needs before its first batch."""

    begin: tuple[float, float]
    """Wall-clock and processor time at the start, s."""
    region: tuple[int, int, int, int]
    """Requested first and end row, first and end column."""
    seed: int
    cluster: DaskCluster | None
    """None for threads of this process."""
    workers: int
    """Number of threads, here or on the cluster."""
    context: RenderContext
    is_dark: bool
    """True if nothing emits light."""
    available: Truth
    """Requested truth that the scene and the camera have."""
    checkpoint: Checkpoint | None
    progress: Progress
    clock: Clock
    tile_side: int
    conditioning: Conditioning | None


def run(subject: Subject, budget: Budget, options: RenderOptions) -> Exposure:
    """Render a subject; see `render`."""
    begin = time.perf_counter(), time.process_time()
    if subject.scene is not None and not subject.scene.has_surfaces_or_light:
        from plenoptic.rendering.points.points_exposure import exposure_of_points

        return exposure_of_points(subject, budget, options)
    with ProgressBar(begin[0], show=flag(options.progress, "progress")) as bar, contextlib.ExitStack() as files:
        setup = _set_up(subject, budget, options, begin, files)
        _begin(setup, subject, budget, bar)
        particles = None
        if subject.scene is not None and subject.scene.points is not None:
            from plenoptic.rendering.points.points_exposure import add_points, image_of_points

            particles = image_of_points(subject.scene, subject.camera, budget, setup.seed, setup.workers)
            setup.clock.postpone()
        interrupted = _render(setup, subject, budget, options, bar)
        region = None if options.region is None else setup.region
        made = setup.progress, subject, region, setup.seed, setup.workers, setup.conditioning
        shot = exposure_of(*made, interrupted=interrupted)
        if particles is not None:
            shot = add_points(shot, particles, setup.workers)
        seconds = 0.0 if particles is None else particles.seconds
        _warn(setup, subject, shot, interrupted=interrupted, particle_seconds=seconds)
        return shot


def _set_up(
    subject: Subject, budget: Budget, options: RenderOptions, begin: tuple[float, float], files: contextlib.ExitStack
) -> RenderSetup:
    """Check the options, compile camera and scene, cut the region into tiles, and open the checkpoint in `files`."""
    camera = subject.camera
    seed, cluster = seed_number(options.seed), cluster_of(options.client, options.threads)
    region = requested = sensor_region(camera.sensor.shape, options.region)
    if pools_errors(
        budget.replicates, deflected=camera.diffraction is not None
    ):  # so that errors at the rim of a region have the same bits
        region = in_whole_blocks(requested, camera.sensor.shape)
    if options.conditioning is not None:
        whole(options.conditioning, "conditioning", at_least=1, at_most=_MAX_CONDITIONED)
    context = render_context(subject, seed)
    budget = budget._replace(with_core=context.plan.runs(Stage.UNVIGNETTED_CORE))
    scene = subject.scene
    if dark := context.scene is not None and is_dark(context.scene) and (scene is None or scene.points is None):
        assert scene is not None
        cause = "no light of the scene emits" if scene.lights else "nothing in the scene emits light"
        warn(f"{cause}, and the image will be black; give it lights=[...] above 0 or a background=", BlackImageWarning)
    meshes, microlenses = context.intersector is not None, camera.microlenses is not None
    available = available_truth(subject.truth, meshes=meshes, microlenses=microlenses)
    checkpoint = None
    if options.checkpoint is not None:
        from plenoptic.rendering.schedule.checkpoint import Checkpoint
        from plenoptic.rendering.schedule.identity import identity

        facts = {"seed": options.seed, "replicates": budget.replicates, "region": region, "truth": available}
        # That of any render with the same paths.
        texts = identity(context.scene, camera, **facts, settings=subject.settings)
        checkpoint = Checkpoint(options.checkpoint, options.checkpoint_interval, texts)
        files.callback(checkpoint.close)
    tile_side = options.tile_side if checkpoint is None or options.tile_side is not None else checkpoint.tile_side
    shared = context.camera.diffraction_kernel is not None
    side, tiles = cut_into_tiles(region, budget, tile_side, cells_per_pixel(context.camera), shared=shared)
    context.prepared.set_tiles(tuple(tiles), steps=budget.steps or budget.passes)
    clock = Clock(begin[0], budget.time_limit, sum(tile.pixels for tile in tiles) * context.channels)
    counted = budget.steps or budget.passes or (checkpoint is not None and checkpoint.has_records)
    batch_samples = [clock.samples_per_batch(tile.pixels, batch_divisor(context, clock)) for tile in tiles]
    counted |= any(samples < budget.max_samples for samples in batch_samples)
    top, bottom, left, right = requested
    crop = slice(top - region[0], bottom - region[0]), slice(left - region[2], right - region[2])
    progress = progress_of(context, budget, region, crop, tiles, available, begin, counted=counted)
    conditioning = None
    if options.conditioning is not None:
        from plenoptic.camera.conditioning import camera_conditioning

        conditioning = camera_conditioning(context.camera, requested, seed=seed, rays=options.conditioning)
    return RenderSetup(
        begin=begin,
        region=requested,
        seed=seed,
        cluster=cluster,
        workers=thread_count(options.threads) if cluster is None else cluster.threads,
        context=context,
        is_dark=dark,
        available=available,
        checkpoint=checkpoint,
        progress=progress,
        clock=clock,
        tile_side=side,
        conditioning=conditioning,
    )


def _begin(setup: RenderSetup, subject: Subject, budget: Budget, bar: ProgressBar) -> None:
    """Write the head of the checkpoint, and start the progress bar with the time of earlier renders."""
    if setup.checkpoint is not None:
        setup.checkpoint.begin(setup.progress, setup.tile_side)
    if setup.cluster is not None:
        setup.progress.film.processors = setup.cluster.processors
        bar.start(setup.progress, None)
    else:
        bar.start(setup.progress, time_history.seconds_of(subject, budget, setup.region, setup.workers))


def _render(setup: RenderSetup, subject: Subject, budget: Budget, options: RenderOptions, bar: ProgressBar) -> bool:
    """Render all batches on threads or on the cluster; return True if interrupted."""
    context, clock, cluster = setup.context, setup.clock, setup.cluster
    engine: Engine[TileJob, TileResult | None]
    with contextlib.ExitStack() as stack:
        if cluster is None:
            truth = truth_record(subject.camera, context.camera, setup.available)
            kernels = functools.partial(compile_tiles, context, truth)
            stack.enter_context(compile_in_parallel(kernels, threads=setup.workers, shown=options.progress))
            engine = thread_engine(context, truth, clock, setup.workers)
        else:
            task = RenderTask(subject, setup.seed, setup.available, budget.steps or budget.passes)
            is_late = None if budget.time_limit is None else clock.late
            engine = stack.enter_context(cluster.engine(tile_renderer, task, out_of_time=is_late))
        interrupted = Scheduler(context, setup.progress, engine, clock, bar, setup.checkpoint).run()
    if cluster is not None:
        film = setup.progress.film
        film.processors = tuple(dict.fromkeys(film.processors + cluster.processors))
    return interrupted


def progress_of(
    context: RenderContext,
    budget: Budget,
    region: tuple[int, int, int, int],
    crop: tuple[slice, slice],
    tiles: list[Tile],
    available: Truth,
    begin: tuple[float, float],
    *,
    counted: bool,
) -> Progress:
    """Progress of a render that has not begun."""
    first_row, end_row, first_column, end_column = region
    shape, camera = (end_row - first_row, end_column - first_column), context.camera
    radiance = 1.0
    if context.scene is not None:
        from plenoptic.scene.scene_record import brightest_radiance

        radiance = brightest_radiance(context.scene)
    return Progress(
        tiles,
        (*shape, context.channels),
        budget,
        FilmRegion(first_row, first_column, camera.sensor.fill_factor, radiance, camera.deflection is not None, crop),
        empty_truth(available, shape),
        status_codes(camera),
        counted=counted,
        begin=begin,
    )


def _warn(setup: RenderSetup, subject: Subject, shot: Exposure, *, interrupted: bool, particle_seconds: float) -> None:
    """Warn of a render that was interrupted or late, or whose image is black."""
    progress, limit = setup.progress, setup.progress.budget.time_limit
    if interrupted:
        counts = np.array([shot.samples]) if shot.sample_counts is None else shot.sample_counts
        hint = "" if counts.all() else "; pixels without samples are black, with infinite errors"
        warn(f"the render was interrupted with {samples_text(counts)}{hint}", BudgetWarning)
        return
    warn_if_late(progress, limit, time.perf_counter() - setup.begin[0], particle_seconds)
    lit, meshes = bool(shot.image.any()), setup.context.intersector is not None
    explained = lit or setup.is_dark
    if progress.done.all() and not (explained and (progress.scene_hits or not meshes)):
        from plenoptic.rendering.black_image import warn_of_darkness

        warn_of_darkness(setup.context, subject.scene, progress, lit=explained)
