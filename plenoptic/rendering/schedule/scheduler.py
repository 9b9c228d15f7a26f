"""Rounds of a render: records of the checkpoint, batches on threads or a cluster, decisions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from plenoptic.core.engines.engine import Engine, EngineLostError
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.warn import warn
from plenoptic.rendering.context import RenderContext
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.schedule.interrupts import Interrupts
from plenoptic.rendering.schedule.progress import Progress
from plenoptic.rendering.schedule.progress_bar import ProgressBar
from plenoptic.rendering.schedule.sums import Sums, SumsInMemory
from plenoptic.rendering.schedule.tile_jobs import TileJob, tile_job
from plenoptic.rendering.tile import TileResult

if TYPE_CHECKING:
    from plenoptic.core.files.record_log import Entry
    from plenoptic.rendering.schedule.checkpoint import Checkpoint


def batch_divisor(context: RenderContext, clock: Clock) -> int:
    """Divisor of the samples of a batch; the smallest one under a time limit, for short batches."""
    return context.replicates if clock.limited else context.together


class Scheduler:
    """Renders the batches of a render in rounds: read records of the checkpoint, render the others, decide."""

    def __init__(
        self,
        context: RenderContext,
        progress: Progress,
        engine: Engine[TileJob, TileResult | None],
        clock: Clock,
        bar: ProgressBar,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        self._context, self._progress, self._engine, self._clock, self._bar = context, progress, engine, clock, bar
        self._checkpoint = checkpoint
        self._sums: Sums = SumsInMemory() if checkpoint is None else checkpoint
        self._interrupts = Interrupts(bar.end)

    def run(self) -> bool:
        """Render until nothing is pending, time is over or an interrupt arrives; return True if interrupted."""
        progress, clock = self._progress, self._clock
        paths_before, pixels = progress.paths, sum(tile.pixels for tile in progress.tiles)
        with self._interrupts as interrupts:
            while progress.pending() and not clock.over and not interrupts.asked:
                self._read_records()
                try:
                    self._render_batches()
                except EngineLostError as error:
                    warn(str(error))
                    interrupts.asked = True
                progress.decide(clock.affordable(progress.paths - paths_before) / pixels)
            if self._checkpoint is not None:
                self._checkpoint.flush(at_once=True)
            self._bar.close(finished=not interrupts.asked)
            return interrupts.asked

    def _read_records(self) -> None:
        """Take results of pending tiles from the checkpoint, as long as it has some."""
        if self._checkpoint is None:
            return
        checkpoint, context = self._checkpoint, self._context

        def read(task: tuple[int, Entry]) -> tuple[int, TileResult | None, Entry | None]:
            return task[0], checkpoint.result(*task, context), task[1]

        threads = min(self._engine.threads, thread_count(None))
        while not self._interrupts.asked and (entries := self._usable_entries(checkpoint)):
            for i, result, entry in run_in_order(read, entries, threads=threads):
                self._take(i, result, entry)
                if self._interrupts.asked:
                    break

    def _usable_entries(self, checkpoint: Checkpoint) -> list[tuple[int, Entry]]:
        """Longest records with the next samples of pending tiles."""
        progress, usable = self._progress, []
        for i in progress.pending():
            done, following = int(progress.done[i]), progress.next_samples(i)
            # Without a target error, no decision depends on the number of samples, and longer records are usable.
            limit = following if progress.budget.target_error is not None else progress.budget.max_samples - done
            entry = checkpoint.longest_record(i, done, limit, self._context.replicates)
            if entry is not None:
                usable.append((i, entry))
        return usable

    def _render_batches(self) -> None:
        """Render the next batch of each pending tile."""
        n_jobs, interrupts = len(self._progress.pending()), self._interrupts
        if interrupts.asked or not n_jobs:
            return
        for done in self._engine.results(self._jobs(), n_jobs=n_jobs, is_cancelled=lambda: interrupts.asked):
            if done.result is not None:
                self._clock.record_batch(int(done.job.size), done.seconds)
                wall_clock, processor = self._progress.before
                self._progress.before = wall_clock, processor + done.remote_cpu_seconds
            self._take(done.job.i, done.result, None)
            if interrupts.asked:
                break

    def _jobs(self) -> Iterator[TileJob]:
        """Next batches of pending tiles, until time is over; the engine draws them one by one."""
        progress, clock, step = self._progress, self._clock, batch_divisor(self._context, self._clock)
        for i in progress.pending():
            tile, done = progress.tiles[i], int(progress.done[i])
            samples = min(progress.next_samples(i), clock.samples_per_batch(tile.pixels, step))
            if not clock.has_time(samples * tile.pixels):
                return
            yield tile_job(self._context, i, tile, (done, samples), self._sums.of(i) if done else None)

    def _take(self, i: int, result: TileResult | None, entry: Entry | None) -> None:
        """Add a result to the film and store its sums; None is a batch that was abandoned or a damaged record."""
        if result is not None:
            self._progress.take(i, result)
            self._sums.keep(i, result, self._progress, entry)
        if self._checkpoint is not None:
            self._checkpoint.flush()
        self._bar.update()
