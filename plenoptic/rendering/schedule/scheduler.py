"""Driver of a render: tiles on threads or a cluster, batch after batch, until the budget is used."""

from __future__ import annotations

import contextlib
import functools
import math
import os
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.checks import sensor_region
from plenoptic.camera.sampling.aperture_regions import cells_per_pixel
from plenoptic.core.engines.choice import cluster_of
from plenoptic.core.engines.engine import Engine
from plenoptic.core.lost_rays import lost_rays
from plenoptic.core.numba.parallel_compilation import compile_in_parallel
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.relative_error import light_is_rare, relative_error
from plenoptic.core.values import flag, seed_number, whole
from plenoptic.core.warn import warn
from plenoptic.errors import BlackImageWarning, BudgetWarning
from plenoptic.rendering.context import RenderContext, render_context
from plenoptic.rendering.crop import samples_text
from plenoptic.rendering.exposure import MOST_NAMES, Exposure
from plenoptic.rendering.film import OWN_ERRORS, in_whole_blocks
from plenoptic.rendering.plan.scene_stages import is_dark
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.schedule.interrupts import Interrupts
from plenoptic.rendering.schedule.progress import FilmRegion, Progress
from plenoptic.rendering.schedule.progress_bar import ProgressBar
from plenoptic.rendering.schedule.sums import Sums, SumsInMemory
from plenoptic.rendering.schedule.tile_jobs import (
    RenderTask,
    TileJob,
    compile_tiles,
    thread_engine,
    tile_job,
    tile_renderer,
)
from plenoptic.rendering.schedule.time_history import time_history
from plenoptic.rendering.stats import RenderStats, StopReason
from plenoptic.rendering.tile import Tile, TileResult, status_codes
from plenoptic.rendering.tiling import cut_into_tiles
from plenoptic.truth.channels import GroundTruth, Truth
from plenoptic.truth.ground_truth import truth_record
from plenoptic.truth.truth_arrays import available_truth, empty_truth, mark_unknown

if TYPE_CHECKING:
    from plenoptic.core.files.record_log import Entry
    from plenoptic.optics.lens.analysis.conditioning import Conditioning
    from plenoptic.rendering.schedule.checkpoint import Checkpoint

Image = NDArray[Any]
_MISSED_RATIO = 1.25
"""Ratio of the final error to its target that causes a warning."""
_OVERRUN, _OVERRUN_SECONDS = 0.1, 0.5
"""Overrun of a time limit, relative and in seconds, that causes no warning."""
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


def run(subject: Subject, budget: Budget, options: RenderOptions) -> Exposure:
    """Render a subject; see `render`."""
    begin = time.perf_counter(), time.process_time()
    with ProgressBar(begin[0], show=flag(options.progress, "progress")) as bar, contextlib.ExitStack() as files:
        return _run(subject, budget, options, begin, bar, files)


def _run(
    subject: Subject,
    budget: Budget,
    options: RenderOptions,
    begin: tuple[float, float],
    bar: ProgressBar,
    files: contextlib.ExitStack,
) -> Exposure:
    camera = subject.camera
    seed, cluster = seed_number(options.seed), cluster_of(options.client, options.threads)
    workers = thread_count(options.threads) if cluster is None else cluster.threads
    region = requested = sensor_region(camera.sensor.shape, options.region)
    if 2 <= budget.replicates < OWN_ERRORS:  # so that errors at the rim of a region have the same bits
        region = in_whole_blocks(requested, camera.sensor.shape)
    if options.conditioning is not None:
        whole(options.conditioning, "conditioning", at_least=1, at_most=_MAX_CONDITIONED)
    context = render_context(subject, seed)
    if dark := context.scene is not None and is_dark(context.scene):
        assert subject.scene is not None
        cause = "no light of the scene emits" if subject.scene.lights else "nothing in the scene emits light"
        warn(f"{cause}, and the image will be black; give it lights=[...] above 0 or a background=", BlackImageWarning)
    meshes = context.intersector is not None
    available = available_truth(subject.truth, meshes=meshes, microlenses=camera.microlenses is not None)
    checkpoint = _checkpoint(subject, budget, options, context, region, available)
    if checkpoint is not None:
        files.callback(checkpoint.close)
    tile_side = options.tile_side if checkpoint is None or options.tile_side is not None else checkpoint.tile_side
    shared = context.camera.diffraction_kernel is not None
    side, tiles = cut_into_tiles(region, budget, tile_side, cells_per_pixel(context.camera), shared=shared)
    steps = budget.steps or budget.passes
    context.prepared.set_tiles(tuple(tiles), steps=steps)
    top, bottom, left, right = requested
    crop = slice(top - region[0], bottom - region[0]), slice(left - region[2], right - region[2])
    clock = Clock(begin[0], budget.time_limit, sum(tile.pixels for tile in tiles) * context.channels)
    counted = steps or (checkpoint is not None and checkpoint.has_records)
    batch_samples = [clock.samples_per_batch(tile.pixels, _step(context, clock)) for tile in tiles]
    counted |= any(samples < budget.max_samples for samples in batch_samples)
    progress = progress_of(context, budget, region, crop, tiles, available, begin, counted=counted)
    if cluster is not None:
        progress.film.processors = cluster.processors
    conditioning = None
    if options.conditioning is not None:
        from plenoptic.camera.conditioning import camera_conditioning

        conditioning = camera_conditioning(context.camera, requested, seed=seed, rays=options.conditioning)
    if checkpoint is not None:
        checkpoint.begin(progress, side)
    bar.start(progress, None if cluster is not None else time_history.seconds_of(subject, budget, requested, workers))
    engine: Engine[TileJob, TileResult | None]
    with contextlib.ExitStack() as stack:
        if cluster is None:
            truth = truth_record(camera, context.camera, available)
            kernels = functools.partial(compile_tiles, context, truth)
            stack.enter_context(compile_in_parallel(kernels, threads=workers, shown=options.progress))
            engine = thread_engine(context, truth, clock, workers)
        else:
            job = RenderTask(subject, seed, available, steps)
            is_late = None if budget.time_limit is None else clock.late
            engine = stack.enter_context(cluster.engine(tile_renderer, job, out_of_time=is_late))
        interrupted = drive(progress, context, engine, clock, checkpoint, bar)
    if cluster is not None:
        progress.film.processors = tuple(dict.fromkeys(progress.film.processors + cluster.processors))
    shot = exposure_of(progress, subject, options, workers, conditioning, interrupted=interrupted)
    if interrupted:
        counts = np.array([shot.samples]) if shot.sample_counts is None else shot.sample_counts
        hint = "" if counts.all() else "; pixels without samples are black, with infinite errors"
        warn(f"the render was interrupted with {samples_text(counts)}{hint}", BudgetWarning)
    elif budget.time_limit is not None:
        _warn_if_late(progress, budget.time_limit, time.perf_counter() - begin[0])
    lit = bool(shot.image.any())
    if progress.done.all() and not interrupted and not dark and not (lit and (progress.scene_hits or not meshes)):
        from plenoptic.rendering.black_image import warn_of_darkness

        warn_of_darkness(context, subject.scene, progress, lit=lit)
    return shot


def _checkpoint(
    subject: Subject,
    budget: Budget,
    options: RenderOptions,
    context: RenderContext,
    region: tuple[int, ...],
    kept: Truth,
) -> Checkpoint | None:
    """Open the checkpoint of a render, if one is requested: that of any render with the same paths."""
    if options.checkpoint is None:
        return None
    from plenoptic.rendering.schedule.checkpoint import Checkpoint
    from plenoptic.rendering.schedule.identity import identity

    facts = {"seed": options.seed, "replicates": budget.replicates, "region": region, "truth": kept}
    facts["settings"] = subject.settings
    return Checkpoint(options.checkpoint, options.checkpoint_interval, identity(context.scene, subject.camera, **facts))


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
    shape = (end_row - first_row, end_column - first_column)
    radiance = 1.0
    if context.scene is not None:
        from plenoptic.scene.scene_record import brightest_radiance

        radiance = brightest_radiance(context.scene)
    return Progress(
        tiles,
        (*shape, context.channels),
        budget,
        FilmRegion(first_row, first_column, context.camera.sensor.fill_factor, radiance, crop),
        empty_truth(available, shape),
        status_codes(context.camera),
        counted=counted,
        begin=begin,
    )


def _step(context: RenderContext, clock: Clock) -> int:
    """Divisor of the samples of a batch; the smallest one under a time limit, for short batches."""
    return context.replicates if clock.limited else context.together


def drive(
    progress: Progress,
    context: RenderContext,
    engine: Engine[TileJob, TileResult | None],
    clock: Clock,
    checkpoint: Checkpoint | None,
    bar: ProgressBar,
) -> bool:
    """Render batches until nothing is pending, time is over or an interrupt arrives; return True if interrupted."""
    replicates, step, interrupts = context.replicates, _step(context, clock), Interrupts(bar.end)
    paths_before, pixels = progress.paths, sum(tile.pixels for tile in progress.tiles)
    sums: Sums = SumsInMemory() if checkpoint is None else checkpoint

    def checkpoint_entries() -> Iterator[tuple[int, Entry]]:
        assert checkpoint is not None
        for i in progress.pending():
            done, following = int(progress.done[i]), progress.next_samples(i)
            # Without a target error, no decision depends on the number of samples, and longer records are usable.
            limit = following if progress.budget.target_error is not None else progress.budget.max_samples - done
            if (entry := checkpoint.longest_record(i, done, limit, replicates)) is not None:
                yield i, entry

    def jobs() -> Iterator[TileJob]:
        for i in progress.pending():
            tile, done = progress.tiles[i], int(progress.done[i])
            samples = min(progress.next_samples(i), clock.samples_per_batch(tile.pixels, step))
            if not clock.has_time(samples * tile.pixels):
                return
            yield tile_job(context, i, tile, (done, samples), sums.of(i) if done else None)

    def results() -> Iterator[tuple[int, TileResult | None, Entry | None]]:
        """Results of pending tiles from the checkpoint, then rendered results of the others."""
        while checkpoint is not None and (entries := list(checkpoint_entries())):
            read = functools.partial(_read, checkpoint, context)
            yield from run_in_order(read, entries, threads=min(engine.threads, thread_count(None)))
        pending, stopped = len(progress.pending()), lambda: interrupts.asked
        for done in engine.results(jobs(), n_jobs=pending, is_cancelled=stopped) if pending else ():
            if done.result is not None:
                clock.record_batch(int(done.job.size), done.seconds)
                progress.before = progress.before[0], progress.before[1] + done.remote_cpu_seconds
            yield done.job.i, done.result, None

    with interrupts:
        while progress.pending() and not clock.over and not interrupts.asked:
            for i, result, entry in results():
                if result is not None:
                    progress.take(i, result)
                    sums.keep(i, result, progress, entry)
                if checkpoint is not None:
                    checkpoint.flush()
                bar.update()
                if interrupts.asked:
                    break
            progress.decide(clock.affordable(progress.paths - paths_before) / pixels)
        if checkpoint is not None:
            checkpoint.flush(at_once=True)
        bar.close(finished=not interrupts.asked)
        return interrupts.asked


def _read(
    checkpoint: Checkpoint, context: RenderContext, task: tuple[int, Entry]
) -> tuple[int, TileResult | None, Entry | None]:
    """Read a tile's result from the checkpoint."""
    return task[0], checkpoint.result(*task, context), task[1]


def _warn_if_late(progress: Progress, limit: float, seconds: float) -> None:
    remedy = "set-up, compilation on first use, and finishing take long; give more time"
    begun_fraction = float((progress.done > 0).mean())
    if not begun_fraction:
        warn(f"nothing has been rendered within {limit:g} s, and the image is black: {remedy}", BudgetWarning)
    elif begun_fraction < 1:
        warn(
            f"only {math.floor(100 * begun_fraction)} % of the tiles were begun within {limit:g} s; the other pixels "
            "are black, with infinite errors",
            BudgetWarning,
        )
    elif seconds > limit + max(_OVERRUN * limit, _OVERRUN_SECONDS):
        warn(f"rendering took {seconds:.3g} s instead of {limit:g} s: {remedy}", BudgetWarning)


def _reason(progress: Progress, image: Image, errors: Image | None, *, interrupted: bool) -> StopReason:
    """Reason for which the render ended, with a warning if it missed the target error."""
    target = progress.budget.target_error
    if interrupted:  # even if all was done at that moment, so that loops of renders notice it
        return StopReason.INTERRUPTED
    if progress.pending():
        return StopReason.TIME_LIMIT
    if progress.capped or target is None:
        return StopReason.SAMPLES
    assert errors is not None
    reached, rare = relative_error(image, errors), light_is_rare(image, errors)
    if not (rare or _MISSED_RATIO * target < reached):  # nan if no pixel can be lit
        return StopReason.TARGET_ERROR
    target_text = f"{100 * target:.2g} %"
    if rare:
        warn(
            f"light is so rare that few pixels have sampled it: the error is {100 * reached:.2g} % or more, and may "
            f"exceed {target_text}; give samples, a larger lamp or caustics=pl.rendering.Caustics.EXCLUDE",
            BudgetWarning,
        )
    elif reached < math.inf:  # otherwise the image is black, which has its own warning
        warn(
            f"the error reached is {100 * reached:.2g} % instead of {target_text}: light comes by rare paths, or "
            "too few pixels are lit to decide for each other; give samples",
            BudgetWarning,
        )
    return StopReason.TARGET_MISSED


def exposure_of(
    progress: Progress,
    subject: Subject,
    options: RenderOptions,
    workers: int,
    conditioning: Conditioning | None,
    *,
    interrupted: bool,
) -> Exposure:
    """Exposure of the requested region. Takes ownership of the film's arrays."""
    film, counts, crop = progress.film, progress.sample_counts(), progress.region.crop
    if counts is not None:
        mark_unknown(progress.truth, counts == 0)
    zero_variance = _zero_variance_pixels(progress, counts)
    error = film.standard_error(progress.one_sample, out=film.between)
    film.between = film.within = None
    image, errors = _crop(film.mean, crop), None if error is None else _crop(error, crop)
    truth = {name: _crop(array, crop) for name, array in progress.truth.items()}
    counts = None if counts is None else counts[crop]
    max_samples = progress.budget.max_samples if counts is None else int(counts.max())
    names = subject.scene.object_names if subject.scene is not None and "object" in progress.truth else None
    progress.update_time()
    stats = RenderStats(
        seconds=progress.seconds,
        cpu_seconds=progress.cpu_seconds,
        paths=progress.paths,
        paths_through_lens=int(progress.counts[0]),
        lost=lost_rays(progress.counts),
        nonfinite=progress.nonfinite,
        threads=workers,
        clamped=progress.clamped / progress.light if progress.light > 0 else 0.0,
        nonfinite_paths=tuple(progress.nonfinite_paths),
        zero_variance=int(np.count_nonzero(zero_variance[crop])),
        stopped_by=_reason(progress, image, errors, interrupted=interrupted),
        conditioning=conditioning,
        processors=film.processors,
    )
    return Exposure(
        image=image,
        standard_error=errors,
        truth=GroundTruth(**truth) if truth else None,
        samples=max_samples,
        replicates=min(progress.budget.replicates, max(max_samples, 1)),
        seed=int(options.seed),
        camera=subject.camera,
        region=None if options.region is None else sensor_region(subject.camera.sensor.shape, options.region),
        stats=stats,
        sample_counts=None if counts is None or counts.min() == max_samples else counts,
        settings=subject.settings,
        white=subject.scene is None,
        object_names=names if names is None or len(names) <= MOST_NAMES else None,
    )


def _crop(array: Image, crop: tuple[slice, slice]) -> Image:
    """Crop of an array; read-only, so that the exposure need not copy the array if the crop is all of it."""
    cropped = array[crop]
    cropped = array if cropped.shape == array.shape else cropped.copy()
    cropped.flags.writeable = False
    return cropped


def _zero_variance_pixels(progress: Progress, counts: NDArray[np.int32] | None) -> NDArray[np.bool_]:
    """(rows, columns): lit pixels whose samples or replicates are all equal."""
    agreeing = progress.film.agreeing()
    if agreeing is None or progress.one_sample is None:
        return np.zeros(progress.film.mean.shape[:2], dtype=bool)
    return agreeing & (progress.one_sample > 0) & (True if counts is None else counts > 0)
