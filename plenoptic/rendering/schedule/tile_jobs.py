"""What is to be rendered of a tile, as engines are given it: here on threads, or in the workers of a cluster."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from plenoptic.core.engines.engine import ThreadEngine
from plenoptic.core.numba.parallel_compilation import compile_in_parallel
from plenoptic.core.parallel import GivenUp
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext, batch_of, render_context
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.tile import Tile, TileResult, render_tile
from plenoptic.truth.channels import Truth
from plenoptic.truth.ground_truth import truth_record
from plenoptic.truth.stages import TruthRecord

_EMPTY = Tile(0, 0, 0, 0)


class TileJob(NamedTuple):
    """Samples `first` ... `first` + `samples` - 1 of a tile, the i-th of a render."""

    i: int
    tile: Tile
    first: int
    samples: int
    before: Floats | None
    """Its sums until then."""
    nbytes: int
    """Of its sums."""

    @property
    def size(self) -> float:
        """Paths."""
        return self.samples * self.tile.pixels


def tile_job(context: RenderContext, i: int, tile: Tile, samples: tuple[int, int], before: Floats | None) -> TileJob:
    """The next samples of a tile: `samples` are the first one and their number."""
    return TileJob(i, tile, *samples, before, 8 * tile.pixels * (context.replicates + 1) * context.channels)


def render_job(
    context: RenderContext, truth: TruthRecord | None, order: TileJob, stopped: Callable[[], bool] | None = None
) -> TileResult | None:
    """Carry out an order; truth is found once, with the first samples. None: see `render_tile`."""
    batch, wanted = batch_of(context, order.first, order.samples), truth if order.first == 0 else None
    return render_tile(context, order.tile, batch, wanted, order.before, stopped=stopped)


def compile_tiles(context: RenderContext, truth: TruthRecord | None) -> None:
    """Render nothing, which compiles what tiles need."""
    render_tile(context, _EMPTY, batch_of(context, 0, 1), truth)


def thread_engine(
    context: RenderContext, truth: TruthRecord | None, clock: Clock, threads: int
) -> ThreadEngine[TileJob, TileResult | None]:
    """Threads of this process, which let go of a tile where its result is no longer wanted."""

    def render(order: TileJob, given_up: Callable[[], bool]) -> TileResult | None:
        try:
            return render_job(context, truth, order, stopped=lambda: given_up() or clock.late())
        except GivenUp:  # interrupted while something was to be compiled
            return None

    return ThreadEngine(render, threads, ahead=clock.ahead)


class RenderTask(NamedTuple):
    """What all orders of a render have in common, as values that pickle."""

    subject: Subject
    seed: int
    truth: Truth
    steps: bool
    """Whether tiles are rendered more than once, so that what feeds their pixels is worth keeping."""


def tile_renderer(job: RenderTask, threads: int) -> Callable[[TileJob], TileResult]:
    """What carries out the orders of a job in another process, compiled with `threads` processes."""
    context = render_context(job.subject, job.seed)
    context.prepared.cut_into((_EMPTY,), steps=job.steps)  # whichever tiles come
    truth = truth_record(job.subject.camera, context.camera, job.truth)
    with compile_in_parallel(lambda: compile_tiles(context, truth), threads=threads):
        compile_tiles(context, truth)

    def render(order: TileJob) -> TileResult:
        result = render_job(context, truth, order)
        assert result is not None
        return result._replace(batch=result.batch._replace(net=result.batch.net[:, :0]))  # is in the way only

    return render
