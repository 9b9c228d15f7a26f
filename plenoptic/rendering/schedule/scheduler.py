"""The one driver loop: tiles over threads or a cluster, batch after batch, until there is enough."""

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
from plenoptic.camera.sampling.pixel_regions import cells_per_pixel
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
from plenoptic.truth.arrays import available_truth, empty_truth, forget_truth
from plenoptic.truth.channels import GroundTruth, Truth
from plenoptic.truth.ground_truth import truth_record

if TYPE_CHECKING:
    from plenoptic.core.files.record_log import Entry
    from plenoptic.optics.lens.analysis.conditioning import Conditioning
    from plenoptic.rendering.schedule.checkpoint import Checkpoint

Image = NDArray[Any]
_MISSED = 1.25
"""Ratio of the error reached to the one wanted that is worth a warning."""
_LATE, _LATE_SECONDS = 0.1, 0.5
"""Parts of a time limit, and seconds, beyond it that are not."""

_MOST_CONDITIONED = 1 << 20
"""Paths whose conditioning is told: they are traced in one bundle."""


class RenderOptions(NamedTuple):
    """What is to be rendered, and how it is gone about; see `render`."""

    region: tuple[slice, slice] | None
    seed: int
    threads: int | None
    tile_side: int | None
    progress: bool
    conditioning: int | None
    checkpoint: str | os.PathLike[str] | None
    checkpoint_interval: float
    client: Any = None


def run(subject: Subject, budget: Budget, work: RenderOptions) -> Exposure:
    """Render; see `render`."""
    begin = time.perf_counter(), time.process_time()
    with ProgressBar(begin[0], show=flag(work.progress, "progress")) as bar, contextlib.ExitStack() as files:
        return _run(subject, budget, work, begin, bar, files)


def _run(
    subject: Subject,
    budget: Budget,
    work: RenderOptions,
    begin: tuple[float, float],
    bar: ProgressBar,
    files: contextlib.ExitStack,
) -> Exposure:
    camera = subject.camera
    seed, cluster = seed_number(work.seed), cluster_of(work.client, work.threads)
    workers = thread_count(work.threads) if cluster is None else cluster.threads
    region = asked = sensor_region(camera.sensor.shape, work.region)
    if 2 <= budget.replicates < OWN_ERRORS:  # errors, or their bits would be others at the rim of a region
        region = in_whole_blocks(asked, camera.sensor.shape)
    if work.conditioning is not None:
        whole(work.conditioning, "conditioning", at_least=1, at_most=_MOST_CONDITIONED)
    context = render_context(subject, seed)
    if dark := context.scene is not None and is_dark(context.scene):
        assert subject.scene is not None
        dull = "no light shines on anything" if subject.scene.lights else "nothing in the scene shines"
        warn(f"{dull} and the image will be black; give it lights=[...] above 0 or a background=", BlackImageWarning)
    meshes = context.intersector is not None
    kept = available_truth(subject.truth, meshes=meshes, microlenses=camera.microlenses is not None)
    checkpoint = _checkpoint(subject, budget, work, context, region, kept)
    if checkpoint is not None:
        files.callback(checkpoint.close)
    wanted = work.tile_side if checkpoint is None or work.tile_side is not None else checkpoint.tile_side
    shared = context.camera.spread is not None
    side, tiles = cut_into_tiles(region, budget, wanted, cells_per_pixel(context.camera), shared=shared)
    steps = budget.steps or budget.passes
    context.prepared.cut_into(tuple(tiles), steps=steps)
    here = slice(asked[0] - region[0], asked[1] - region[0]), slice(asked[2] - region[2], asked[3] - region[2])
    clock = Clock(begin[0], budget.time_limit, sum(tile.pixels for tile in tiles) * context.channels)
    counted = steps or (checkpoint is not None and checkpoint.holds)
    most = [clock.samples_per_batch(tile.pixels, _step(context, clock)) for tile in tiles]
    counted |= any(samples < budget.max_samples for samples in most)
    progress = progress_of(context, budget, region, here, tiles, kept, begin, counted=counted)
    if cluster is not None:
        progress.film.processors = cluster.processors
    found = None
    if work.conditioning is not None:
        from plenoptic.camera.conditioning import camera_conditioning

        found = camera_conditioning(context.camera, asked, seed=seed, rays=work.conditioning)
    if checkpoint is not None:
        checkpoint.begin(progress, side)
    bar.start(progress, None if cluster is not None else time_history.of(subject, budget, asked, workers))
    engine: Engine[TileJob, TileResult | None]
    with contextlib.ExitStack() as stack:
        if cluster is None:
            truth = truth_record(camera, context.camera, kept)
            ahead = compile_in_parallel(lambda: compile_tiles(context, truth), threads=workers, shown=work.progress)
            stack.enter_context(ahead)
            engine = thread_engine(context, truth, clock, workers)
        else:
            job = RenderTask(subject, seed, kept, steps)
            late = None if budget.time_limit is None else clock.late
            engine = stack.enter_context(cluster.engine(tile_renderer, job, late=late))
        interrupted = drive(progress, context, engine, clock, checkpoint, bar)
    if cluster is not None:
        progress.film.processors = tuple(dict.fromkeys(progress.film.processors + cluster.processors))
    shot = exposure_of(progress, subject, work, workers, found, interrupted=interrupted)
    if interrupted:
        counts = np.array([shot.samples]) if shot.sample_counts is None else shot.sample_counts
        left = "" if counts.all() else "; pixels without samples are black, with infinite errors"
        warn(f"the render was interrupted with {samples_text(counts)}{left}", BudgetWarning)
    elif budget.time_limit is not None:
        _warn_where_late(progress, budget.time_limit, time.perf_counter() - begin[0])
    lit = bool(shot.image.any())
    if progress.done.all() and not interrupted and not dark and not (lit and (progress.met or not meshes)):
        from plenoptic.rendering.black_image import warn_of_darkness

        warn_of_darkness(context, subject.scene, progress, lit=lit)
    return shot


def _checkpoint(
    subject: Subject, budget: Budget, work: RenderOptions, context: RenderContext, region: tuple[int, ...], kept: Truth
) -> Checkpoint | None:
    """The checkpoint of a render, if it is to have one: that of any other with the same paths."""
    if work.checkpoint is None:
        return None
    from plenoptic.rendering.schedule.checkpoint import Checkpoint
    from plenoptic.rendering.schedule.identity import identity

    facts = {"seed": work.seed, "replicates": budget.replicates, "region": region, "truth": kept}
    facts["settings"] = subject.settings
    return Checkpoint(work.checkpoint, work.checkpoint_interval, identity(context.scene, subject.camera, **facts))


def progress_of(
    context: RenderContext,
    budget: Budget,
    region: tuple[int, int, int, int],
    asked: tuple[slice, slice],
    tiles: list[Tile],
    kept: Truth,
    begin: tuple[float, float],
    *,
    counted: bool,
) -> Progress:
    """Nothing is rendered yet."""
    first_row, end_row, first_column, end_column = region
    shape = (end_row - first_row, end_column - first_column)
    radiance = 1.0
    if context.scene is not None:
        from plenoptic.scene.compile import brightest_radiance

        radiance = brightest_radiance(context.scene)
    return Progress(
        tiles,
        (*shape, context.channels),
        budget,
        FilmRegion(first_row, first_column, context.camera.sensor.fill_factor, radiance, asked),
        empty_truth(kept, shape),
        status_codes(context.camera),
        counted=counted,
        begin=begin,
    )


def _step(context: RenderContext, clock: Clock) -> int:
    """What the samples of a batch are a multiple of; the least where time is limited, and batches are short."""
    return context.replicates if clock.limited else context.together


def drive(
    progress: Progress,
    context: RenderContext,
    engine: Engine[TileJob, TileResult | None],
    clock: Clock,
    checkpoint: Checkpoint | None,
    bar: ProgressBar,
) -> bool:
    """Render batches until nothing is pending, time is over or somebody interrupts, which is returned."""
    replicates, step, interrupts = context.replicates, _step(context, clock), Interrupts(bar.end)
    kept, pixels = progress.paths, sum(tile.pixels for tile in progress.tiles)
    sums: Sums = SumsInMemory() if checkpoint is None else checkpoint

    def recorded() -> Iterator[tuple[int, Entry]]:
        assert checkpoint is not None
        for i in progress.pending():
            done, most = int(progress.done[i]), progress.next_samples(i)
            # Where no decision rests on how many samples there are, more of them do no harm.
            further = most if progress.budget.target_error is not None else progress.budget.max_samples - done
            if (entry := checkpoint.recorded(i, done, further, replicates)) is not None:
                yield i, entry

    def orders() -> Iterator[TileJob]:
        for i in progress.pending():
            tile, done = progress.tiles[i], int(progress.done[i])
            samples = min(progress.next_samples(i), clock.samples_per_batch(tile.pixels, step))
            if not clock.has_time(samples * tile.pixels):
                return
            yield tile_job(context, i, tile, (done, samples), sums.of(i) if done else None)

    def found() -> Iterator[tuple[int, TileResult | None, Entry | None]]:
        """What the checkpoint has of tiles that are pending, and then what is rendered of the others."""
        while checkpoint is not None and (entries := list(recorded())):
            read = functools.partial(_read, checkpoint, context)
            yield from run_in_order(read, entries, threads=min(engine.threads, thread_count(None)))
        left, stopped = len(progress.pending()), lambda: interrupts.asked
        for done in engine.results(orders(), left=left, given_up=stopped) if left else ():
            if done.result is not None:
                clock.note(int(done.order.size), done.seconds)
                progress.before = progress.before[0], progress.before[1] + done.elsewhere
            yield done.order.i, done.result, None

    with interrupts:
        while progress.pending() and not clock.over and not interrupts.asked:
            for i, result, entry in found():
                if result is not None:
                    progress.take(i, result)
                    sums.keep(i, result, progress, entry)
                if checkpoint is not None:
                    checkpoint.flush()
                bar.update()
                if interrupts.asked:
                    break
            progress.decide(clock.affordable(progress.paths - kept) / pixels)
        if checkpoint is not None:
            checkpoint.flush(at_once=True)
        bar.close(finished=not interrupts.asked)
        return interrupts.asked


def _read(
    checkpoint: Checkpoint, context: RenderContext, task: tuple[int, Entry]
) -> tuple[int, TileResult | None, Entry | None]:
    """What the checkpoint has of a tile."""
    return task[0], checkpoint.result(*task, context), task[1]


def _warn_where_late(progress: Progress, limit: float, took: float) -> None:
    why = "set-up, compiling what is used for the first time, and finishing take long; give more time"
    begun = float((progress.done > 0).mean())
    if not begun:
        warn(f"nothing has been rendered within {limit:g} s, and the image is black: {why}", BudgetWarning)
    elif begun < 1:
        warn(
            f"only {math.floor(100 * begun)} % of the tiles were begun within {limit:g} s; the other pixels are black, "
            "with infinite errors",
            BudgetWarning,
        )
    elif took > limit + max(_LATE * limit, _LATE_SECONDS):
        warn(f"rendering took {took:.3g} s instead of {limit:g} s: {why}", BudgetWarning)


def _reason(progress: Progress, image: Image, errors: Image | None, *, interrupted: bool) -> StopReason:
    """Why it has ended; a warning where that is not the error that was wanted."""
    target = progress.budget.target_error
    if interrupted:  # also where all was done at that moment: loops of renders are to hear of it
        return StopReason.INTERRUPTED
    if progress.pending():
        return StopReason.TIME_LIMIT
    if progress.capped or target is None:
        return StopReason.SAMPLES
    assert errors is not None
    reached, rare = relative_error(image, errors), light_is_rare(image, errors)
    if not (rare or _MISSED * target < reached):  # nan where nothing can be lit
        return StopReason.TARGET_ERROR
    wanted = f"{100 * target:.2g} %"
    if rare:
        warn(
            f"light is so rare that few pixels have met it: the error is {100 * reached:.2g} % or more, and whether it "
            f"is {wanted} is not known; give samples, a larger lamp or caustics=pl.rendering.Caustics.EXCLUDE",
            BudgetWarning,
        )
    elif reached < math.inf:  # otherwise the image is black, of which there is a warning of its own
        warn(
            f"the error reached is {100 * reached:.2g} % instead of {wanted}: light comes by rare paths, or too few "
            "pixels are lit to decide for each other; give samples",
            BudgetWarning,
        )
    return StopReason.TARGET_MISSED


def exposure_of(
    progress: Progress,
    subject: Subject,
    work: RenderOptions,
    workers: int,
    conditioning: Conditioning | None,
    *,
    interrupted: bool,
) -> Exposure:
    """What has been found, of the region that was asked for. The film is used up: its arrays are those of the shot."""
    film, counts, here = progress.film, progress.sample_counts(), progress.region.asked
    if counts is not None:
        forget_truth(progress.truth, counts == 0)
    agreeing = _agreeing(progress, counts)
    error = film.standard_error(progress.one_sample, out=film.between)
    film.between = film.within = None
    image, errors = _part(film.mean, here), None if error is None else _part(error, here)
    truth = {name: _part(array, here) for name, array in progress.truth.items()}
    counts = None if counts is None else counts[here]
    most = progress.budget.max_samples if counts is None else int(counts.max())
    names = subject.scene.object_names if subject.scene is not None and "object" in progress.truth else None
    progress.note_time()
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
        zero_variance=int(np.count_nonzero(agreeing[here])),
        stopped_by=_reason(progress, image, errors, interrupted=interrupted),
        conditioning=conditioning,
        processors=film.processors,
    )
    return Exposure(
        image=image,
        standard_error=errors,
        truth=GroundTruth(**truth) if truth else None,
        samples=most,
        replicates=min(progress.budget.replicates, max(most, 1)),
        seed=int(work.seed),
        camera=subject.camera,
        region=None if work.region is None else sensor_region(subject.camera.sensor.shape, work.region),
        stats=stats,
        sample_counts=None if counts is None or counts.min() == most else counts,
        settings=subject.settings,
        white=subject.scene is None,
        object_names=names if names is None or len(names) <= MOST_NAMES else None,
    )


def _part(array: Image, here: tuple[slice, slice]) -> Image:
    """The part of an array that was asked for; read-only, so that the exposure need not copy it where that is all."""
    part = array[here]
    part = array if part.shape == array.shape else part.copy()
    part.flags.writeable = False
    return part


def _agreeing(progress: Progress, counts: NDArray[np.int32] | None) -> NDArray[np.bool_]:
    """(rows, columns): pixels that light can reach and whose samples or replicates are all the same."""
    agreeing = progress.film.agreeing()
    if agreeing is None or progress.one_sample is None:
        return np.zeros(progress.film.mean.shape[:2], dtype=bool)
    return agreeing & (progress.one_sample > 0) & (True if counts is None else counts > 0)
