"""Costs of a render per pixel, from its pilot runs."""

from __future__ import annotations

import math
import statistics
from typing import NamedTuple, cast

import numpy as np

from plenoptic.camera.cache import MAX_CACHED_BYTES
from plenoptic.camera.sampling.aperture_regions import cells_per_pixel
from plenoptic.core.files.atomic_file import temporary_folder
from plenoptic.rendering.context import RenderContext
from plenoptic.rendering.estimation.decisions import (
    FLAT,
    STEEP,
    USUAL,
    mean_samples,
    predicted_samples,
    relative_spread,
    steps_to,
)
from plenoptic.rendering.estimation.estimated import Estimated
from plenoptic.rendering.estimation.memory import PUPIL_BYTES
from plenoptic.rendering.estimation.pilot import PilotRun, PilotTile, Region, pilot_tiles, run_pilot, whole_tiles
from plenoptic.rendering.exposure_files import texts_of
from plenoptic.rendering.film import in_whole_blocks, pools_errors
from plenoptic.rendering.plan.stages import Stage, Subject
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.tiling import cut_into_tiles

_SIDE = 8
"""Side of squares of pixels with given samples: small ones are from more parts of the frame."""
_ALONG = 24
"""Maximum number of squares along the side of a pilot's tile: larger tiles cost less per pixel."""
_FEWEST_RUNS, _MOST_RUNS = 2, 8
"""Range of the number of pilot runs of the same kind, whose variance gives the uncertainty: more if they differ."""
_PATHS, _FEWEST, _MOST, _MOST_TILES = 1 << 17, 1 << 11, 1 << 15, 64
"""Paths of a pilot run, its minimum and maximum pixels (illuminated pupils take time, too), and its maximum tiles."""
_MOST_SAMPLES = 256
"""Maximum samples of pilot runs; the cost of more is extrapolated."""
_DECIDED, _FEWEST_DECIDING, _MOST_DECIDING = 8, 2, 8
"""Maximum tiles of a pilot run that decides on samples, and range of the number of such runs: more if tiles differ."""
_DECIDED_SECONDS = 20.0
"""Approximate processor time per thread for these runs, unless twice the samples of the first decision take longer."""
_UNKNOWN = 0.08
"""Relative uncertainty of times beyond the variance of pilot runs: caches, other programs, the end of a render."""
_HEAD_BYTES = 500
"""Bytes of an EXR file besides its texts."""
_KEPT_PIXELS = MAX_CACHED_BYTES // PUPIL_BYTES
"""Approximate pixels of frames whose illuminated pupils are cached."""


class Costs(NamedTuple):
    """Costs per pixel, from pilot runs."""

    cpu_seconds: Estimated
    samples: Estimated
    most_samples: Estimated
    """Of any pixel."""
    steps: float
    """Average number of renders of a tile."""
    busy: float
    """Fraction of the threads' time in which a pilot run was busy."""
    head_bytes: float
    exposure_bytes: float
    cached_bytes: float
    runs: tuple[PilotRun, ...]
    """Two runs with some of the samples, or all."""


class Pilots:
    """Pilot runs of one render."""

    def __init__(self, context: RenderContext, subject: Subject, budget: Budget, region: Region, threads: int) -> None:
        self.context, self.subject, self.region, self.threads = context, subject, region, threads
        self.budget = budget = budget._replace(with_core=context.plan.runs(Stage.UNVIGNETTED_CORE))
        self.asked_pixels = (region[1] - region[0]) * (region[3] - region[2])
        pooled = pools_errors(budget.replicates, deflected=subject.camera.diffraction is not None)
        self.frame = frame = in_whole_blocks(region, subject.camera.sensor.shape) if pooled else region
        self.pixels = (frame[1] - frame[0]) * (frame[3] - frame[2])
        cells, shared = cells_per_pixel(context.camera), context.camera.diffraction_kernel is not None
        self.side, self.tiles = cut_into_tiles(frame, budget, None, cells, shared=shared)

    def run(self, samples: int, seed: int, paths: int = _PATHS) -> PilotRun:
        """Pilot run with a number of samples, in tiles as large as the render's, and no more pixels than the frame."""
        side = self._fitting(_SIDE if self.side >= _SIDE else self.side)
        max_squares = math.isqrt(self.pixels // (2 * self.threads * side**2))
        squares = max(min(self.side // _SIDE, _ALONG, max_squares), 1) ** 2
        pixels = min(max(paths // samples, _FEWEST), _MOST)
        n = max(min(-(-pixels // (squares * side * side)), _MOST_TILES), self.threads)
        budget = Budget(samples, None, None, min(self.budget.replicates, samples))
        return self._run(budget, pilot_tiles(self.frame, n, squares, side, seed))

    def samples_to_decide(self, per_sample: float) -> int:
        """Maximum samples of deciding tiles, from the seconds per sample."""
        pixels = sum(tile.pixels for tile in self.tiles) / len(self.tiles) * self._deciding_tiles
        once = _FEWEST_DECIDING * pixels * max(per_sample, 1e-12)
        return int(min(max(_DECIDED_SECONDS * self.threads / once, 2 * self.budget.enough), _MOST_SAMPLES))

    def may_decide_again(self, runs: list[PilotRun]) -> bool:
        """True if there is time for one more deciding run, and the runs cover less than half of the frame."""
        spent = sum(run.cpu_seconds for run in runs) * (1 + 1 / len(runs))
        max_runs = min(len(self.tiles) // (2 * self._deciding_tiles), _MOST_DECIDING)
        return len(runs) < max_runs and spent < _DECIDED_SECONDS * self.threads

    @property
    def _deciding_tiles(self) -> int:
        """Tiles of a deciding run: two runs cover small frames."""
        return min(_DECIDED, -(-len(self.tiles) // _FEWEST_DECIDING))

    def run_deciding(self, samples: int, number: int) -> PilotRun:
        """Pilot run, the first having the number 0, whose tiles end at the target error or at a number of samples.

        The tiles are the frame's, cut ones too, in the order of a render: those of each run are spread over the frame.
        """
        n, budget = self._deciding_tiles, self.budget._replace(samples=min(samples, self.budget.max_samples))
        tiles = [self.tiles[i % len(self.tiles)] for i in range(number * n, (number + 1) * n)]
        return self._run(budget, whole_tiles(tiles))

    def run_on(self, other: PilotRun, samples: int) -> PilotRun:
        """Pilot run on the pixels of another, with at most a number of samples."""
        few = min(samples, _MOST_SAMPLES, max(4 * _PATHS // other.pixels, self.budget.replicates))
        budget = Budget(few, None, None, min(self.budget.replicates, few))
        return self._run(budget, cast("list[PilotTile]", other.progress.tiles))

    def _run(self, budget: Budget, tiles: list[PilotTile]) -> PilotRun:
        keeps = (self.budget.steps or self.budget.passes) and self.pixels < _KEPT_PIXELS
        return run_pilot(self.context, self.subject, budget, tiles, self.threads, keeps=keeps)

    def _fitting(self, side: int) -> int:
        """Side limited by the sides of the frame."""
        return max(min(side, self.frame[1] - self.frame[0], self.frame[3] - self.frame[2]), 1)


def costs_by_samples(pilots: Pilots) -> Costs:
    """Costs for a given number of samples."""
    few = min(samples := pilots.budget.max_samples, _MOST_SAMPLES)
    pilots.run(min(few, 4), 0, paths=0)  # compilation and caches
    runs = [pilots.run(few, seed) for seed in range(_FEWEST_RUNS)]
    each = [run.cpu_seconds / run.pixels for run in runs]
    while len(runs) < _MOST_RUNS and (cost := interval(each)).high > (1 + 3 * _UNKNOWN) * cost.value:
        runs.append(pilots.run(few, len(runs)))
        each.append(runs[-1].cpu_seconds / runs[-1].pixels)
    if samples > few:
        quarter_runs = [pilots.run(few // 4, seed) for seed in range(len(runs))]
        slopes = [(a - b.cpu_seconds / b.pixels) / (few - few // 4) for a, b in zip(each, quarter_runs, strict=True)]
        each = [a + max(slope, a / (2 * few)) * (samples - few) for a, slope in zip(each, slopes, strict=True)]
    final_samples, steps = Estimated(samples, samples, samples), 2.0 if pilots.budget.passes else 1.0
    busy, few_runs = _busy(runs, pilots), tuple(runs[:_FEWEST_RUNS])
    return Costs(interval(each), final_samples, final_samples, steps, busy, *_bytes(runs[0]), few_runs)


def costs_by_error(pilots: Pilots) -> Costs:
    """Costs for a target error."""
    few = min(pilots.budget.enough, _MOST_SAMPLES)
    pilots.run(4, 0, paths=0)
    pairs = [(pilots.run(few // 4, seed, 2 * _PATHS), pilots.run(few, seed, 2 * _PATHS)) for seed in (0, 1)]
    costs = [(a.cpu_seconds / a.pixels, b.cpu_seconds / b.pixels) for a, b in pairs]
    per_sample = max(statistics.mean(b - a for a, b in costs) / (few - few // 4), 0.25 * costs[0][1] / few)
    once = max(statistics.mean(b for _, b in costs) - per_sample * few, 0.0)
    runs = _deciding(pilots, pilots.samples_to_decide(per_sample))
    predicted, done = [run.progress for run in runs], np.concatenate([run.progress.done for run in runs])
    steps = steps_to(pilots.budget, predicted_samples(predicted))
    pilot_steps, pilot_pixels = steps_to(pilots.budget, done), sum(run.pixels for run in runs)
    per_pixel = sum(run.cpu_seconds for run in runs) / pilot_pixels
    each_step = max((per_pixel - once - per_sample * float(done.mean())) / max(pilot_steps - 1.0, 1.0), 0.0)
    means = mean_samples(predicted, pilots.budget, len(pilots.tiles))
    cost = [once + per_sample * mean + each_step * (steps - 1.0) for mean in means]
    each = Estimated(cost[0], cost[1] * (1 - 2 * _UNKNOWN), cost[2] * (1 + 2 * _UNKNOWN))
    low, high = max(means[1] * (1 - _UNKNOWN), pilots.budget.enough), means[2] * (1 + _UNKNOWN)
    samples = Estimated(means[0], low, min(high, pilots.budget.max_samples))
    most = (predicted_samples(predicted, fall).max() for fall in (USUAL, STEEP, FLAT))
    most_samples = Estimated(
        *(min(max(float(number), pilots.budget.enough), pilots.budget.max_samples) for number in most)
    )
    busy, few_runs = _busy(runs, pilots), tuple(run for _, run in pairs)
    return Costs(each, samples, most_samples, steps, busy, *_bytes(runs[0]), few_runs)


def _deciding(pilots: Pilots, samples: int) -> list[PilotRun]:
    """Deciding runs, until they determine the mean sample number, or take too long."""
    runs = [pilots.run_deciding(samples, seed) for seed in range(_FEWEST_DECIDING)]
    while pilots.may_decide_again(runs) and relative_spread([run.progress for run in runs]) > _UNKNOWN:
        runs.append(pilots.run_deciding(samples, len(runs)))
    return runs


def interval(numbers: list[float]) -> Estimated:
    """Mean and interval of numbers."""
    mean = statistics.mean(numbers)
    off = 2 * statistics.stdev(numbers) / math.sqrt(len(numbers)) + 2 * _UNKNOWN * mean
    return Estimated(mean, max(mean - off, 0.0), mean + off)


def _busy(runs: list[PilotRun], pilots: Pilots) -> float:
    return min(max(0.1, *(run.cpu_seconds / (run.seconds * pilots.threads) for run in runs)), 1.0)


def _bytes(run: PilotRun) -> tuple[float, float, float]:
    """Bytes of an EXR file's metadata, of a pixel in it (noise hardly compresses), and of an illuminated pupil."""
    texts = texts_of(run.exposure)
    head = _HEAD_BYTES + sum(len(name) + len(text) for name, text in texts.items())
    with temporary_folder() as folder:
        path = folder / "pilot.exr"
        run.exposure.save(path)
        return head, max(path.stat().st_size - head, 0) / run.pixels, run.kept_bytes / run.pixels
