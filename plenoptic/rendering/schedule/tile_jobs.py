"""Tile jobs for engines: threads of this process, or workers of a cluster."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from plenoptic.core.engines.engine import ThreadEngine
from plenoptic.core.numba.parallel_compilation import compile_in_parallel
from plenoptic.core.parallel import Cancelled
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext, batch_of, render_context
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.tile import Tile, TileResult, render_tile
from plenoptic.truth.channels import Truth
from plenoptic.truth.ground_truth import truth_record
from plenoptic.truth.truth_stages import TruthRecord

_EMPTY = Tile(0, 0, 0, 0)


class TileJob(NamedTuple):
    """Samples `first` ... `first` + `samples` - 1 of a tile, the i-th of a render."""

    i: int
    tile: Tile
    first: int
    samples: int
    before: Floats | None
    """Sums of the tile's earlier samples."""
    nbytes: int
    """Size of the sums."""

    @property
    def size(self) -> float:
        """Number of paths."""
        return self.samples * self.tile.pixels


def tile_job(context: RenderContext, i: int, tile: Tile, samples: tuple[int, int], before: Floats | None) -> TileJob:
    """Job of the next samples of a tile: `samples` are the first one and their number."""
    return TileJob(i, tile, *samples, before, 8 * tile.pixels * (context.replicates + 1) * context.channels)


def render_job(
    context: RenderContext, truth: TruthRecord | None, job: TileJob, stopped: Callable[[], bool] | None = None
) -> TileResult | None:
    """Render a tile job; truth is computed with the first samples only. Returns None as `render_tile` does."""
    batch, requested_truth = batch_of(context, job.first, job.samples), truth if job.first == 0 else None
    return render_tile(context, job.tile, batch, requested_truth, job.before, stopped=stopped)


def compile_tiles(context: RenderContext, truth: TruthRecord | None) -> None:
    """Compile the kernels of tiles by rendering an empty one."""
    render_tile(context, _EMPTY, batch_of(context, 0, 1), truth)


def thread_engine(
    context: RenderContext, truth: TruthRecord | None, clock: Clock, threads: int
) -> ThreadEngine[TileJob, TileResult | None]:
    """Engine on threads of this process; they abandon a tile when its result is no longer needed."""

    def render(job: TileJob, given_up: Callable[[], bool]) -> TileResult | None:
        try:
            return render_job(context, truth, job, stopped=lambda: given_up() or clock.late())
        except Cancelled:  # interrupted during compilation
            return None

    return ThreadEngine(render, threads, ahead=clock.ahead)


class RenderTask(NamedTuple):
    """Common data of all tile jobs of a render, as values that pickle."""

    subject: Subject
    seed: int
    truth: Truth
    steps: bool
    """True if tiles are rendered more than once, so that their illuminated pixels are worth keeping."""


def tile_renderer(task: RenderTask, threads: int) -> Callable[[TileJob], TileResult]:
    """Function that renders the tile jobs of a task in another process, compiled with `threads` processes."""
    context = render_context(task.subject, task.seed)
    context.prepared.set_tiles((_EMPTY,), steps=task.steps)  # the tiles are not known here
    truth = truth_record(task.subject.camera, context.camera, task.truth)
    with compile_in_parallel(lambda: compile_tiles(context, truth), threads=threads):
        compile_tiles(context, truth)

    def render(tile_job: TileJob) -> TileResult:
        result = render_job(context, truth, tile_job)
        assert result is not None
        return result._replace(batch=result.batch._replace(net=result.batch.net[:, :0]))  # not needed: transfer less

    return render
