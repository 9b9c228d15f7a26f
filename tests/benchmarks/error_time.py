"""Error against time on a crop of the white image, beside what Blender needs; of other scenes see `pl.study`."""

import statistics
import time
from typing import NamedTuple

import numpy as np
import reference
from table import Table
from timing import Task, cost_of, median

CROP = np.s_[224:288, 224:288]  # the central 64 x 64 pixels
PIXELS = 64 * 64
LIT = 0.5  # of the reference's 99th percentile
REFERENCE_SEED = 1_000_003
GOAL = 0.01
WANTED, AIM = 500, 1000

BLENDER = ((256, 0.85, 0.104), (1024, 3.2, 0.041), (4096, 12.7, 0.0173), (10_000, 31.0, 0.01))
"""Paths per pixel, CPU ms per pixel and relative RMS error of `white` in Blender 3.4; the last one extrapolated."""


class Measured(NamedTuple):
    """One row: what a number of samples costs per pixel and how far it is off."""

    samples: int
    ms: float
    error: float
    true_over_standard: float | None


def tables(*, quick):
    numbers = (16, 32, 64) if quick else (16, 32, 64, 128, 256, 512, 1024)
    converged, seeds = (256, 2) if quick else (1 << 14, 8)
    camera = reference.camera()
    truth = Converged(camera, converged)
    nothing = _next_to_nothing(camera)
    cost_of(nothing)
    setup = median([cost_of(nothing) for _ in range(11)]).cpu
    runs = {k: [measured(camera, truth, n, k, seeds) for n in numbers] for k in (8, 1)}
    yield _error_table(runs, truth, setup, seeds)
    yield _blender_table(runs)


class Converged:
    """A converged crop with its own relative variance, and which pixels count."""

    def __init__(self, camera, samples):
        shot = reference.exposed(None, camera, samples=samples, region=CROP, seed=REFERENCE_SEED)
        image = shot.image.astype(np.float64)
        self.samples = samples
        self.lit = image > LIT * np.percentile(image, 99)
        self.image = image[self.lit]
        self.variance = float(np.mean((shot.standard_error[self.lit] / self.image) ** 2))

    def relative(self, image):
        """What lies on the lit pixels, in units of the truth."""
        return image[self.lit] / self.image


def _next_to_nothing(camera):
    """A call that sets everything up and renders a single path."""
    settings = {"samples": 1, "region": np.s_[256:257, 256:257], "threads": 1}
    return Task(lambda _: reference.exposed(None, camera, **settings))


def measured(camera, truth, samples, replicates, seeds):
    """Render the crop with several seeds: the median of the costs, the root of the mean of squared errors."""
    nothing = _next_to_nothing(camera)
    seconds, squares, variances = [], [], []
    for seed in range(seeds):
        setup = cost_of(nothing).cpu  # beside each run, because it is as long as a run of few samples
        begin = time.process_time()
        how = {"samples": samples, "seed": seed, "replicates": replicates}
        shot = reference.exposed(None, camera, region=CROP, threads=1, **how)
        seconds.append(time.process_time() - begin - setup)
        squares.append(np.mean((truth.relative(shot.image) - 1.0) ** 2) - truth.variance)
        if shot.standard_error is not None:
            variances.append(np.mean(truth.relative(shot.standard_error) ** 2))
    error = float(np.sqrt(max(np.mean(squares), 0.0)))
    ms = 1e3 * statistics.median(seconds) / PIXELS
    return Measured(samples, ms, error, error / float(np.sqrt(np.mean(variances))) if variances else None)


def time_at(rows, error):
    """CPU ms per pixel at an error, straight between two rows in logarithms; None outside the rows."""
    errors, ms = np.array([r.error for r in rows]), np.array([r.ms for r in rows])
    if not errors.min() <= error <= errors.max():
        return None
    order = np.argsort(errors)
    return float(np.exp(np.interp(np.log(error), np.log(errors[order]), np.log(ms[order]))))


def _error_table(runs, truth, setup, seeds):
    rows = []
    for eight, one in zip(runs[8], runs[1], strict=True):
        found = (eight.ms, 100 * eight.error, eight.true_over_standard, one.ms, 100 * one.error)
        rows.append((eight.samples, *found, time_ratio(eight, runs[1])))
    columns = (
        "samples | 8 replicates: CPU ms per pixel | relative RMS error % | true error over standard error | 1 "
        "replicate: CPU ms per pixel | relative RMS error % | time of 8 over time of 1 at equal error"
    )
    remark = (
        f"{np.count_nonzero(truth.lit)} lit pixels, {seeds} seeds a row, reference of {truth.samples} samples with "
        f"another seed; its own error, {100 * truth.variance**0.5:.2g} %, is subtracted. Setting up costs "
        f"{1e3 * setup:.1f} CPU ms a call and is left out. One thread."
    )
    return Table("Error against time: `white`, mode 2.0, central 64 x 64 pixels", columns, rows, [remark])


def time_ratio(row, others):
    """Time of a row over the time in which other rows reach its error."""
    other = time_at(others, row.error)
    return None if other is None else row.ms / other


def _blender_table(runs):
    rows = []
    for paths, ms, error in BLENDER:
        eight, one = time_at(runs[8], error), time_at(runs[1], error)
        wanted = f"{WANTED}, aim {AIM}" if error == GOAL else None
        rows.append((f"{100 * error:.3g}", paths, ms, eight, eight and ms / eight, one, one and ms / one, wanted))
    columns = (
        "relative RMS error % | Blender: paths | CPU ms per pixel | 8 replicates: CPU ms per pixel | Blender's time "
        "over it | 1 replicate: CPU ms per pixel | Blender's time over it | wanted"
    )
    remark = (
        "Blender's figures are quoted, not measured here (Cycles on a processor, Blender 3.4; 1 % extrapolated). "
        "Times at an error are interpolated; cells are empty where the table above does not reach it."
    )
    return Table("`white` at the errors that Blender reaches", columns, rows, [remark])
