"""Estimate of a render's time, memory and file sizes, from pilot runs."""

from __future__ import annotations

import math
import statistics
import textwrap
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.cache import MAX_CACHED_BYTES
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera, sensor_region
from plenoptic.camera.sampling.aperture_regions import cells_per_pixel
from plenoptic.core.files.atomic_file import temporary_folder
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import seed_number, value
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.context import RenderContext, render_context
from plenoptic.rendering.estimation.decisions import mean_samples, predicted_samples, relative_spread, steps_to
from plenoptic.rendering.estimation.memory import resident_bytes, truth_bytes
from plenoptic.rendering.estimation.pilot import PilotRun, PilotTile, Region, pilot_tiles, run_pilot, whole_tiles
from plenoptic.rendering.exposure_files import texts_of
from plenoptic.rendering.film import in_whole_blocks, pools_errors
from plenoptic.rendering.plan.stages import Plan, Stage, Subject
from plenoptic.rendering.schedule.budget import Budget, checked_budget
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.schedule.time_history import time_history
from plenoptic.rendering.settings import Caustics, RenderSettings, Sampler
from plenoptic.rendering.tile import status_codes
from plenoptic.rendering.tiling import cut_into_tiles
from plenoptic.truth.channels import Truth
from plenoptic.truth.truth_arrays import available_truth

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

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
_DECIDED_BYTES = 100
"""Bytes per pixel while tiles are decided upon."""
_DECIDED, _FEWEST_DECIDING, _MOST_DECIDING = 8, 2, 8
"""Maximum tiles of a pilot run that decides on samples, and range of the number of such runs: more if tiles differ."""
_DECIDED_SECONDS = 20.0
"""Approximate processor time per thread for these runs, unless twice the samples of the first decision take longer."""
_UNKNOWN = 0.08
"""Relative uncertainty of times beyond the variance of pilot runs: caches, other programs, the end of a render."""
_FED_BYTES, _WORK_BYTES = 500, 1200
"""Bytes of the illuminated pupil of a pixel, and of a pixel of a tile being rendered."""
_HEAD_BYTES, _LOG_BYTES, _RECORD_BYTES = 500, 950, 650
"""Bytes of an EXR file besides its texts, of a checkpoint besides its records, and of a record besides its arrays."""
_KEPT_PIXELS = MAX_CACHED_BYTES // _FED_BYTES
"""Approximate pixels of frames whose illuminated pupils are cached."""


class Estimated(NamedTuple):
    """An estimate with its interval.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.Estimated(10.0, 8.0, 13.0).value
    10.0
    """

    value: float
    low: float
    high: float
    """Interval that contains the number in most cases."""


@value
class Estimate:
    """Estimated time, memory and file sizes of a render.

    Parameters
    ----------
    cpu_seconds, seconds : Estimated
        Processor time and wall-clock time in s, without compilation.
    peak_memory : Estimated
        Peak memory of the process, bytes.
    file_size, checkpoint_size : Estimated
        Size of the exposure as EXR file, and of a checkpoint, bytes.
    samples : Estimated
        Mean paths of a pixel.
    plan : Plan
        Stages that will run.

    Examples
    --------
    See `estimate`.
    """

    cpu_seconds: Estimated
    seconds: Estimated
    peak_memory: Estimated
    file_size: Estimated
    checkpoint_size: Estimated
    samples: Estimated
    plan: Plan

    def __repr__(self) -> str:
        rows = [
            ("processor time", _text(self.cpu_seconds, *_time_unit(self.cpu_seconds.value))),
            ("time", _text(self.seconds, *_time_unit(self.seconds.value))),
            ("samples per pixel", _text(self.samples, 1.0, "")),
            ("peak memory", _text(self.peak_memory, 1e6, "MB")),
            ("EXR file", _text(self.file_size, 1e6, "MB")),
            ("checkpoint", _text(self.checkpoint_size, 1e6, "MB")),
        ]
        stages, every = [decision.name for decision in self.plan.decisions if decision.runs], len(self.plan.decisions)
        rows.append(("stages", f"{', '.join(stages)}; {every - len(stages)} others are left out"))
        return "\n".join(textwrap.fill(f"{name:<18} {text}", 110, subsequent_indent=19 * " ") for name, text in rows)


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
    truth: Truth = Truth.DEPTH,
    threads: int | None = None,
    progress: bool = True,
) -> Estimate:
    """Estimate the time, memory and file sizes of `render` in a few seconds, from pilot runs all over the frame.

    Parameters
    ----------
    scene : Scene or None
        None: a white image, as of `render_white`.
    camera : PlenopticCamera
    samples, target_error
        As for `render`; one of them, or both: whichever is reached first.
    region, replicates, sampler, max_bounces, caustics, clamp, truth, threads
        As for `render`.
    progress : bool, optional
        Whether to show that something is being compiled; compilation is not part of the estimate.

    Returns
    -------
    Estimate
        Times hold for this machine under its present load. The bar of a render with the same arguments starts with it.

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
    settings = RenderSettings(0 if scene is None else max_bounces, caustics, clamp, sampler)
    requested = Truth.NONE if scene is None else truth
    subject = Subject(scene, camera, budget.max_samples, budget.replicates, requested, settings)
    workers = thread_count(threads)
    with CallProgress("estimating", kind="scene", show=progress):
        context = render_context(subject, seed_number(0))
        meshes, microlenses = context.intersector is not None, camera.microlenses is not None
        available = available_truth(requested, meshes=meshes, microlenses=microlenses)
        reduced_subject = Subject(scene, camera, budget.max_samples, budget.replicates, available, settings)
        sensor_pixels = sensor_region(camera.sensor.shape, region)
        pilots = _Pilots(context, reduced_subject, budget, sensor_pixels, workers)
        by_error = target_error is not None and pilots.budget.enough < budget.max_samples
        costs = _by_error(pilots) if by_error else _by_samples(pilots)
        result = _estimate(pilots, costs)
        if scene is not None and scene.points is not None:
            from plenoptic.rendering.estimation.particles import with_particles

            result = with_particles(result, scene, camera, target_error, workers)
    time_history.record(subject, budget, sensor_pixels, workers, seconds=result.seconds.value)
    return result


class _Costs(NamedTuple):
    """Costs per pixel, from pilot runs."""

    cpu_seconds: Estimated
    samples: Estimated
    steps: float
    """Average number of renders of a tile."""
    busy: float
    """Fraction of the threads' time in which a pilot run was busy."""
    head_bytes: float
    exposure_bytes: float
    cached_bytes: float


class _Pilots:
    """Pilot runs of one render."""

    def __init__(self, context: RenderContext, subject: Subject, budget: Budget, region: Region, threads: int) -> None:
        self.context, self.subject, self.threads = context, subject, threads
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

    def _run(self, budget: Budget, tiles: list[PilotTile]) -> PilotRun:
        keeps = (self.budget.steps or self.budget.passes) and self.pixels < _KEPT_PIXELS
        return run_pilot(self.context, self.subject, budget, tiles, self.threads, keeps=keeps)

    def _fitting(self, side: int) -> int:
        """Side limited by the sides of the frame."""
        return max(min(side, self.frame[1] - self.frame[0], self.frame[3] - self.frame[2]), 1)


def _by_samples(pilots: _Pilots) -> _Costs:
    """Costs for a given number of samples."""
    few = min(samples := pilots.budget.max_samples, _MOST_SAMPLES)
    pilots.run(min(few, 4), 0, paths=0)  # compilation and caches
    runs = [pilots.run(few, seed) for seed in range(_FEWEST_RUNS)]
    each = [run.cpu_seconds / run.pixels for run in runs]
    while len(runs) < _MOST_RUNS and (cost := _interval(each)).high > (1 + 3 * _UNKNOWN) * cost.value:
        runs.append(pilots.run(few, len(runs)))
        each.append(runs[-1].cpu_seconds / runs[-1].pixels)
    if samples > few:
        quarter_runs = [pilots.run(few // 4, seed) for seed in range(len(runs))]
        slopes = [(a - b.cpu_seconds / b.pixels) / (few - few // 4) for a, b in zip(each, quarter_runs, strict=True)]
        each = [a + max(slope, a / (2 * few)) * (samples - few) for a, slope in zip(each, slopes, strict=True)]
    final_samples, steps = Estimated(samples, samples, samples), 2.0 if pilots.budget.passes else 1.0
    return _Costs(_interval(each), final_samples, steps, _busy(runs, pilots), *_bytes(runs[0]))


def _by_error(pilots: _Pilots) -> _Costs:
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
    return _Costs(each, samples, steps, _busy(runs, pilots), *_bytes(runs[0]))


def _deciding(pilots: _Pilots, samples: int) -> list[PilotRun]:
    """Deciding runs, until they determine the mean sample number, or take too long."""
    runs = [pilots.run_deciding(samples, seed) for seed in range(_FEWEST_DECIDING)]
    while pilots.may_decide_again(runs) and relative_spread([run.progress for run in runs]) > _UNKNOWN:
        runs.append(pilots.run_deciding(samples, len(runs)))
    return runs


def _interval(numbers: list[float]) -> Estimated:
    """Mean and interval of numbers."""
    mean = statistics.mean(numbers)
    off = 2 * statistics.stdev(numbers) / math.sqrt(len(numbers)) + 2 * _UNKNOWN * mean
    return Estimated(mean, max(mean - off, 0.0), mean + off)


def _busy(runs: list[PilotRun], pilots: _Pilots) -> float:
    return min(max(0.1, *(run.cpu_seconds / (run.seconds * pilots.threads) for run in runs)), 1.0)


def _bytes(run: PilotRun) -> tuple[float, float, float]:
    """Bytes of an EXR file's metadata, of a pixel in it (noise hardly compresses), and of an illuminated pupil."""
    texts = texts_of(run.exposure)
    head = _HEAD_BYTES + sum(len(name) + len(text) for name, text in texts.items())
    with temporary_folder() as folder:
        path = folder / "pilot.exr"
        run.exposure.save(path)
        return head, max(path.stat().st_size - head, 0) / run.pixels, run.kept_bytes / run.pixels


def _estimate(pilots: _Pilots, costs: _Costs) -> Estimate:
    n, budget, channels = pilots.pixels, pilots.budget, pilots.context.channels
    cpu = Estimated(*(n * part for part in costs.cpu_seconds))
    fastest, slowest = 1.0 / pilots.threads, 1.0 / (pilots.threads * costs.busy)
    wall = Estimated(cpu.value * math.sqrt(fastest * slowest), cpu.low * fastest, cpu.high * slowest)
    once, state = 8 + truth_bytes(pilots.subject.truth), 8 * channels * (budget.replicates + 1)
    pixels_in_memory, spread = pilots.threads * min(pilots.side**2, n), pilots.context.camera.diffraction_kernel
    shared = 0 if spread is None else state * spread.table.weights.shape[1]
    working_memory = pixels_in_memory * (4 * (state + once) + _WORK_BYTES + shared)
    cached = (costs.cached_bytes or _FED_BYTES) * n if budget.steps or budget.passes else 0
    memory = resident_bytes() + _film_bytes(pilots) * n + working_memory + min(cached, MAX_CACHED_BYTES)
    record = _RECORD_BYTES + 8 * status_codes(pilots.context.camera)
    records_per_tile = [costs.steps if budget.steps else _records(tile.pixels, pilots) for tile in pilots.tiles]
    log = sum((tile.pixels * state + record) * k for tile, k in zip(pilots.tiles, records_per_tile, strict=True))
    return Estimate(
        cpu_seconds=cpu,
        seconds=wall,
        peak_memory=_about(memory, 0.1),
        file_size=_about(costs.head_bytes + pilots.asked_pixels * costs.exposure_bytes, 0.15),
        checkpoint_size=_about(_LOG_BYTES + once * n + log, 0.3 if budget.steps else 0.02),
        samples=costs.samples,
        plan=pilots.context.plan,
    )


def _records(pixels: int, pilots: _Pilots) -> int:
    """Records of a tile in the checkpoint of a render with given samples: its number of batches."""
    done, batches, batch_samples = 0, 0, Clock(0.0, None).samples_per_batch(pixels, pilots.context.together)
    while done < pilots.budget.max_samples:
        done = min(done + batch_samples, pilots.budget.following(done))
        batches += 1
    return batches


def _film_bytes(pilots: _Pilots) -> float:
    """Bytes of a pixel during rendering and finishing."""
    budget, channels = pilots.budget, pilots.context.channels
    bytes_ = 4 * channels + truth_bytes(pilots.subject.truth)
    if budget.replicates >= 2:
        bytes_ += 2 * 4 * channels + 4
    if budget.steps or budget.passes:
        bytes_ += 4 + 8 * channels * (budget.replicates + 1)
    if budget.target_error is not None:
        bytes_ += 2 * 8 + _DECIDED_BYTES
    return bytes_


def _about(number: float, part: float) -> Estimated:
    return Estimated(number, number * (1 - part), number * (1 + part))


def _time_unit(seconds: float) -> tuple[float, str]:
    return (1.0, "s") if seconds < 100 else (60.0, "min") if seconds < 6000 else (3600.0, "h")


def _text(number: Estimated, unit: float, name: str) -> str:
    value, low, high = (f"{part / unit:.3g}" for part in number)
    between = f" ({low} to {high})" if low != high else ""
    return f"{value} {name}{between}".replace("  ", " ").rstrip()
