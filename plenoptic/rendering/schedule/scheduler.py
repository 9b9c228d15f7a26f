"""The one driver loop: tiles over threads, batch after batch, until there is enough."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.checks import sensor_region
from plenoptic.camera.sampling.pixel_regions import cells_per_pixel
from plenoptic.camera.sampling.record import Batch
from plenoptic.core.ahead import compiled_ahead
from plenoptic.core.lost_rays import lost_rays
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.values import flag, seed_number, whole
from plenoptic.core.warn import warn
from plenoptic.errors import BlackImageWarning, BudgetWarning
from plenoptic.rendering.context import RenderContext, render_context
from plenoptic.rendering.exposure import MOST_NAMES, Exposure, samples_text
from plenoptic.rendering.film import OWN_ERRORS, in_whole_blocks
from plenoptic.rendering.plan.scene_stages import is_dark
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.schedule.interrupts import Interrupts
from plenoptic.rendering.schedule.progress import FilmRegion, Progress
from plenoptic.rendering.schedule.progress_bar import ProgressBar
from plenoptic.rendering.stats import RenderStats, StopReason
from plenoptic.rendering.tile import Tile, TileResult, batch_of, render_tile, status_codes
from plenoptic.rendering.tiling import cut_into_tiles
from plenoptic.truth.arrays import available_truth, empty_truth, forget_truth
from plenoptic.truth.channels import GroundTruth, Truth
from plenoptic.truth.ground_truth import truth_record
from plenoptic.truth.stages import TruthRecord

if TYPE_CHECKING:
    from plenoptic.optics.lens.analysis.conditioning import Conditioning
    from plenoptic.rendering.schedule.checkpoint import Checkpoint

_MISSED = 1.25
"""Ratio of the error reached to the one wanted that is worth a warning."""
_LATE, _LATE_SECONDS = 0.1, 0.5
"""Parts of a time limit, and seconds, beyond it that are not."""


class Work(NamedTuple):
    """What is to be rendered, and how it is gone about; see `render`."""

    region: tuple[slice, slice] | None
    seed: int
    threads: int | None
    tile_side: int | None
    progress: bool
    conditioning: int | None
    checkpoint: str | os.PathLike[str] | None
    checkpoint_interval: float


def run(subject: Subject, budget: Budget, work: Work) -> Exposure:
    """Render; see `render`."""
    begin = time.perf_counter(), time.process_time()
    camera, checkpoint = subject.camera, None
    if work.checkpoint is not None:
        from plenoptic.rendering.schedule.checkpoint import Checkpoint

        checkpoint = Checkpoint(work.checkpoint, work.checkpoint_interval)
    seed = seed_number(work.seed)
    workers, show = thread_count(work.threads), flag(work.progress, "progress")
    region = asked = sensor_region(camera.sensor.shape, work.region)
    if 2 <= budget.replicates < OWN_ERRORS:  # errors, or their bits would be others at the rim of a region
        region = in_whole_blocks(asked, camera.sensor.shape)
    if work.conditioning is not None:
        whole(work.conditioning, "conditioning", at_least=1)
    context = render_context(subject, seed)
    if dark := context.scene is not None and is_dark(context.scene):
        assert subject.scene is not None
        dull = "no light shines on anything" if subject.scene.lights else "nothing in the scene shines"
        warn(f"{dull} and the image will be black; give it lights=[...] above 0 or a background=", BlackImageWarning)
    meshes = context.intersector is not None
    kept = available_truth(subject.truth, meshes=meshes, microlenses=camera.microlenses is not None)
    side, tiles = cut_into_tiles(region, budget, work.tile_side, cells_per_pixel(context.camera))
    context.prepared.cut_into(tuple(tiles), steps=budget.steps)
    clock = Clock(begin[0], budget.time_limit, sum(tile.pixels for tile in tiles) * context.channels)
    here = slice(asked[0] - region[0], asked[1] - region[0]), slice(asked[2] - region[2], asked[3] - region[2])
    progress = _progress(context, budget, region, here, tiles, kept, clock, begin)
    if checkpoint is not None:
        facts: dict[str, object] = {"seed": seed, "samples": budget.samples, "target_error": budget.target_error}
        if budget.target_error is not None:
            # What is kept for decisions, and how they are made.
            facts["decided by"] = "errors over expected brightness, up to a twentieth, in predicted steps"
        facts |= {"time_limit": None if budget.time_limit is None else "given", "replicates": budget.replicates}
        facts |= {
            "errors from": "samples and replicates",
            "region": region,
            "truth": kept,
            "settings": subject.settings,
            "tile_side": side,
        }
        checkpoint.resume(progress, context.scene, camera, facts)
    found = None
    if work.conditioning is not None:
        from plenoptic.camera.conditioning import camera_conditioning

        found = camera_conditioning(context.camera, asked, seed=seed, rays=work.conditioning)
    bar = ProgressBar(progress, begin[0], show=show)
    truth, batch = truth_record(camera, context.camera, kept), batch_of(context, 0, 1)
    with compiled_ahead(lambda: render_tile(context, Tile(0, 0, 0, 0), batch, truth), threads=workers):
        interrupted = _drive(progress, context, truth, clock, workers, checkpoint, bar)
    reason = _reason(progress, interrupted=interrupted)
    shot = _exposure(progress, reason, subject, work, workers, found)
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


def _progress(
    context: RenderContext,
    budget: Budget,
    region: tuple[int, int, int, int],
    asked: tuple[slice, slice],
    tiles: list[Tile],
    kept: Truth,
    clock: Clock,
    begin: tuple[float, float],
) -> Progress:
    """Nothing is rendered yet."""
    first_row, end_row, first_column, end_column = region
    shape = (end_row - first_row, end_column - first_column)
    radiance = 1.0
    if context.scene is not None:
        from plenoptic.scene.compile import brightest_radiance

        radiance = brightest_radiance(context.scene)
    batch = min(clock.samples_per_batch(tile.pixels, budget.replicates) for tile in tiles)
    return Progress(
        tiles,
        (*shape, context.channels),
        budget,
        FilmRegion(first_row, first_column, context.camera.sensor.fill_factor, radiance, asked),
        empty_truth(kept, shape),
        status_codes(context.camera),
        batches=batch < budget.max_samples,
        begin=begin,
    )


def _drive(
    progress: Progress,
    context: RenderContext,
    truth: TruthRecord | None,
    clock: Clock,
    workers: int,
    checkpoint: Checkpoint | None,
    bar: ProgressBar,
) -> bool:
    """Render batches until nothing is pending, time is over or somebody interrupts, which is returned."""
    replicates, interrupts = context.replicates, Interrupts(bar.end)
    kept, pixels = progress.paths, sum(tile.pixels for tile in progress.tiles)

    def batches() -> Iterator[tuple[int, Batch]]:
        for i in progress.pending():
            tile = progress.tiles[i]
            samples = min(progress.next_samples(i), clock.samples_per_batch(tile.pixels, replicates))
            if not clock.has_time(samples * tile.pixels):
                return
            yield i, batch_of(context, int(progress.done[i]), samples)

    def work(task: tuple[int, Batch]) -> tuple[int, TileResult | None]:
        i, batch = task
        tile, begin = progress.tiles[i], time.perf_counter()
        wanted = truth if batch.first == 0 else None  # is found once
        before = progress.sums_of(i)
        result = render_tile(context, tile, batch, wanted, before, stopped=lambda: interrupts.asked or clock.late())
        clock.note(batch.samples * tile.pixels, time.perf_counter() - begin)
        return i, result

    with interrupts:
        while (left := len(progress.pending())) and not clock.over and not interrupts.asked:
            for i, result in run_in_order(work, batches(), threads=min(workers, left), ahead=clock.ahead):
                if result is not None:
                    progress.take(i, result)
                if checkpoint is not None:
                    checkpoint.save_if_due(progress)
                bar.update()
                if interrupts.asked:
                    break
            progress.decide(clock.affordable(progress.paths - kept) / pixels)
        if checkpoint is not None:
            checkpoint.save(progress)
        bar.close(finished=not interrupts.asked)
        return interrupts.asked


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


def _reason(progress: Progress, *, interrupted: bool) -> StopReason:
    """Why it has ended; a warning where that is not the error that was wanted."""
    target = progress.budget.target_error
    if interrupted:  # also where all was done at that moment: loops of renders are to hear of it
        return StopReason.INTERRUPTED
    if progress.pending():
        return StopReason.TIME_LIMIT
    if progress.capped or target is None:
        return StopReason.SAMPLES
    reached, rare = progress.error(), progress.light_is_rare()
    if reached is None or not (rare or _MISSED * target < reached):  # nan where nothing can be lit
        return StopReason.TARGET_ERROR
    wanted = f"{100 * target:.2g} %"
    if rare:
        warn(
            f"light is so rare that few pixels have met it: the error is {100 * reached:.2g} % or more, and whether it "
            f"is {wanted} is not known; give samples, a larger lamp or caustics=pl.rendering.Caustics.LEFT_OUT",
            BudgetWarning,
        )
    elif reached < math.inf:  # otherwise the image is black, of which there is a warning of its own
        warn(
            f"the error reached is {100 * reached:.2g} % instead of {wanted}: light comes by rare paths, or too few "
            "pixels are lit to decide for each other; give samples",
            BudgetWarning,
        )
    return StopReason.TARGET_MISSED


def _exposure(
    progress: Progress,
    reason: StopReason,
    subject: Subject,
    work: Work,
    workers: int,
    conditioning: Conditioning | None,
) -> Exposure:
    """What has been found, of the region that was asked for."""
    film, counts = progress.film, progress.sample_counts()
    if counts is not None:
        forget_truth(progress.truth, counts == 0)
    error, agreeing = film.standard_error(progress.one_sample), _agreeing(progress, counts)
    here = progress.region.asked
    truth, counts = (
        {name: array[here] for name, array in progress.truth.items()},
        None if counts is None else counts[here],
    )
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
        stopped_by=reason,
        conditioning=conditioning,
        processors=film.processors,
    )
    return Exposure(
        image=film.image()[here],
        standard_error=None if error is None else error[here],
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


def _agreeing(progress: Progress, counts: NDArray[np.int32] | None) -> NDArray[np.bool_]:
    """(rows, columns): pixels that light can reach and whose samples or replicates are all the same."""
    agreeing = progress.film.agreeing()
    if agreeing is None or progress.one_sample is None:
        return np.zeros(progress.film.mean.shape[:2], dtype=bool)
    return agreeing & (progress.one_sample > 0) & (True if counts is None else counts > 0)
