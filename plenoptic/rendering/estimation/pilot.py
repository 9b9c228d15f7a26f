"""Pilot runs: a few pixels from all over a frame, rendered like the frame."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.cache import PreparedCamera
from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.checks import BLOCK
from plenoptic.camera.sampling.aperture_regions import pixel_centres
from plenoptic.core.values import Floats
from plenoptic.rendering.context import RenderContext
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.schedule.outcome import exposure_of
from plenoptic.rendering.schedule.progress import Progress
from plenoptic.rendering.schedule.progress_bar import ProgressBar
from plenoptic.rendering.schedule.run import progress_of
from plenoptic.rendering.schedule.scheduler import Scheduler
from plenoptic.rendering.schedule.tile_jobs import thread_engine
from plenoptic.rendering.tile import Tile
from plenoptic.truth.ground_truth import truth_record

Region = tuple[int, int, int, int]


class PilotTile(NamedTuple):
    """A tile that consists of squares of pixels from different parts of the sensor."""

    row: int
    column: int
    """Position on the film of the pilot run."""
    rows: int
    columns: int
    side: int
    """Side of a square, which divides rows and columns."""
    places: tuple[tuple[int, int], ...]
    """Row and column of each square on the sensor, in their order in the tile, row by row."""

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.rows * self.columns

    def centres(self, camera: CameraRecord) -> Floats:
        """Pixel centres (rows * columns, 2); see `pixel_centres`."""
        return self._in_order([pixel_centres(camera, (r, r + self.side), (c, c + self.side)) for r, c in self.places])

    def numbers(self, camera: CameraRecord) -> NDArray[np.int64]:
        """Pixel numbers (rows * columns,) on the whole sensor."""
        numbers = [Tile(r, c, self.side, self.side).numbers(camera) for r, c in self.places]
        return self._in_order(numbers)

    def _in_order(self, squares: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Reorder the pixels of squares (side * side, ...) by the rows of the tile."""
        high, wide, side = self.rows // self.side, self.columns // self.side, self.side
        value_shape = squares[0].shape[1:]
        grid = np.stack(squares).reshape(high, wide, side, side, *value_shape)
        return np.ascontiguousarray(np.swapaxes(grid, 1, 2)).reshape(self.pixels, *value_shape)


def pilot_tiles(region: Region, n: int, per_tile: int, side: int, seed: int) -> list[PilotTile]:
    """Tiles of `per_tile` (a square number) squares of a side, one below the other, each from all over a region.

    The region is divided into as many cells as there are squares, and each square covers a random pixel of its cell.
    Squares lie on a grid, so that pixels at the rim are covered as often as others.
    """
    first_row, end_row, first_column, end_column = region
    high, wide = end_row - first_row, end_column - first_column
    squares, across = n * per_tile, max(1, round(math.sqrt(n * per_tile * wide / high)))
    down = -(-squares // across)
    rng = np.random.default_rng(seed)
    cells = rng.permutation(down * across)[:squares]
    row = first_row + _on_grid((cells // across + rng.random(squares)) * high / down, high, side)
    column = first_column + _on_grid((cells % across + rng.random(squares)) * wide / across, wide, side)
    places = [(int(r), int(c)) for r, c in zip(row, column, strict=True)]
    whole = side * math.isqrt(per_tile)
    return [PilotTile(whole * i, 0, whole, whole, side, tuple(places[i::n])) for i in range(n)]


def whole_tiles(tiles: Sequence[Tile]) -> list[PilotTile]:
    """Pilot tiles that are tiles of the frame, cut ones too, one below the other."""
    pilots, film_row = [], 0
    for tile in tiles:
        side = math.gcd(tile.rows, tile.columns)
        across, down = (range(0, length, side) for length in (tile.columns, tile.rows))
        places = tuple((tile.row + row, tile.column + column) for row in down for column in across)
        pilots.append(PilotTile(film_row, 0, tile.rows, tile.columns, side, places))
        film_row += tile.rows
    return pilots


def _on_grid(place: Floats, length: int, side: int) -> NDArray[np.int64]:
    """Start of the squares that contain positions between 0 and a length: on blocks, limited by the end."""
    step = -(-side // BLOCK) * BLOCK
    last = (length - side) // BLOCK * BLOCK
    return np.minimum(place // step * step, last).astype(np.int64)


class PilotRun(NamedTuple):
    """Time, state and exposure of a pilot run."""

    pixels: int
    seconds: float
    cpu_seconds: float
    progress: Progress
    exposure: Exposure
    kept_bytes: int
    """Bytes of the illuminated pupils of its pixels, if these are cached."""


def run_pilot(
    context: RenderContext, subject: Subject, budget: Budget, tiles: list[PilotTile], threads: int, *, keeps: bool
) -> PilotRun:
    """Render pilot tiles; `keeps`: cache the illuminated pupils between steps, as for a small frame."""
    context = context._replace(prepared=PreparedCamera(context.camera))
    if keeps:
        context.prepared.set_tiles(tuple(tiles), steps=True)
    begin = time.perf_counter(), time.process_time()
    rows, columns = tiles[-1].row + tiles[-1].rows, max(tile.columns for tile in tiles)
    clock = Clock(begin[0], None)
    counted = budget.steps or budget.passes
    counted |= any(clock.samples_per_batch(tile.pixels, context.together) < budget.max_samples for tile in tiles)
    whole, crop, film_tiles = (0, rows, 0, columns), (slice(None), slice(None)), cast("list[Tile]", tiles)
    progress = progress_of(context, budget, whole, crop, film_tiles, subject.truth, begin, counted=counted)
    truth = truth_record(subject.camera, context.camera, subject.truth)
    engine = thread_engine(context, truth, clock, threads)
    if Scheduler(context, progress, engine, clock, ProgressBar(begin[0], show=False)).run():
        raise KeyboardInterrupt
    exposure = exposure_of(progress, subject, None, 0, threads, None, interrupted=True)
    seconds = time.perf_counter() - begin[0], time.process_time() - begin[1]
    return PilotRun(sum(tile.pixels for tile in tiles), *seconds, progress, exposure, context.prepared.cached_bytes)
