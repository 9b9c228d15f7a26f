"""Error against run time: variants of a render, timed, and compared with a converged reference."""

from __future__ import annotations

import dataclasses
import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import load_tqdm
from plenoptic.core.values import seed_number, whole, wrong_kind
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.stages import Subject
from plenoptic.scene.scene import Scene
from plenoptic.study.error_time.error_split import Reference, reference_of, split_error
from plenoptic.study.error_time.error_table import ErrorRow, ErrorTable
from plenoptic.study.error_time.variants import Variant, checked_variants, default_variants
from plenoptic.study.exposures import Region, central_pixel, expose, region_bounds
from plenoptic.study.study_table import run_until_interrupt
from plenoptic.truth.channels import Truth

REFERENCE_SEED = 1_000_003
"""Added to the first seed for the reference: rows use seeds from the first one on, far fewer than these."""

REFERENCE_FACTOR = 16
"""Samples of the reference over the largest number of samples, by default."""

SIDE = 64
"""Pixels along the central region that is rendered by default."""

_SETUPS = 5
"""Calls of one path each, whose median is the time of setting up."""

_BAR = "{percentage:3.0f}%|{bar}| {elapsed}, {remaining} left"


def error_against_time(  # noqa: PLR0913
    scene: Scene | None,
    camera: PlenopticCamera,
    variants: Mapping[str, Variant] | None = None,
    *,
    samples: Sequence[int] = (16, 32, 64, 128, 256),
    region: Region | None = None,
    seeds: int = 8,
    seed: int = 0,
    repeats: int = 1,
    reference: Variant | Exposure | None = None,
    reference_samples: int | None = None,
    threads: int = 1,
    title: str | None = None,
    progress: bool = True,
) -> ErrorTable:
    """Measure time and error of variants of a render against a converged reference.

    Each variant is rendered with several numbers of samples and several seeds. The variance among seeds is noise; the
    difference of their mean from the reference, beyond noise, is bias. The reference's own squared error is known from
    its standard errors and subtracted. Errors are relative root mean squares over lit pixels: those above 0.1 of the
    reference's 99th percentile, in the mean over the channels.

    Parameters
    ----------
    scene : Scene or None
        None: the white image.
    camera : PlenopticCamera
    variants : mapping of str to Variant, optional
        By their names; None: `default_variants`, of which the first is the camera as it is.
    samples : sequence of int, optional
        Paths per pixel, rising.
    region : (slice, slice), optional
        Rows and columns of the sensor; None: the central 64 x 64 pixels.
    seeds : int, optional
        Renders of each row, at least 2.
    seed : int, optional
        The first seed.
    repeats : int, optional
        Number of times that each render is timed; times are medians over seeds and repeats.
    reference : Variant or Exposure, optional
        Variant of the reference; None: ``Variant()``. Or an exposure of the same region with standard errors, rendered
        with another seed.
    reference_samples : int, optional
        Paths per pixel of the reference; None: 16 times the largest number in `samples`.
    threads : int, optional
        Of the renders that are timed.
    title : str, optional
        Of the table.
    progress : bool, optional
        True shows a progress bar.

    Returns
    -------
    ErrorTable
        `print` shows it; `plot()`, `recommend(target_error)`, `slope(variant)`, `bias_floor(variant)`, `pareto()`,
        `to_csv()`, `to_markdown()`. After Ctrl-C it is `interrupted`, with the numbers of samples that were done.

    Raises
    ------
    InvalidValueError
        If an argument is impossible, or the reference is black or does not fit.

    Notes
    -----
    Setting up is timed by calls that render one path, once everything is compiled, and pupils and the scene's tree are
    known from a call before.
    Errors are relative to the reference, so that a poor one makes them too large, by some three times its own squared
    error, and biases that all pixels share by more. Its error should be below the smallest that is studied.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=1.0), stop_to_microlenses=130.0)
    >>> table = pl.study.error_against_time(None, camera, samples=(64, 256), seeds=3, progress=False)
    >>> table.variants
    ('EXACT lens', 'PARAXIAL lens', 'THIN lens', 'RANDOM sampler', '1 replicate')
    >>> table.bias_floor("EXACT lens"), table.bias_floor("PARAXIAL lens") > 0.02
    (0.0, True)
    >>> table.recommend(0.02).variant in table.variants
    True
    """
    check_scene_and_camera(scene, camera)
    count, rounds = whole(seeds, "seeds", at_least=2), whole(repeats, "repeats", at_least=1)
    runs, workers = Runs(_rising(samples), count, seed_number(seed), rounds), thread_count(threads)
    chosen = default_variants(scene, camera) if variants is None else checked_variants(variants)
    window = region_bounds(camera.sensor.shape, region, SIDE)
    if isinstance(reference, Exposure):
        _check_region(reference, window)
    elif reference is not None and not isinstance(reference, Variant):
        raise wrong_kind(reference, "reference", "Variant or an Exposure", "Variant(max_bounces=32)")
    converged = REFERENCE_FACTOR * runs.samples[-1] if reference_samples is None else reference_samples
    whole(converged, "reference_samples", at_least=2)
    subjects = {name: _subject(variant, scene, camera) for name, variant in chosen.items()}

    def render(name: str, n: int, seed: int) -> Exposure:
        """Render a variant; with 0 samples one path only, which is setting up."""
        if n == 0:
            return expose(subjects[name], seed=0, region=central_pixel(window), threads=workers)
        subject = dataclasses.replace(subjects[name], samples=n)
        return expose(subject, seed=seed, region=window, threads=workers)

    total = converged + len(chosen) * sum(runs.samples) * runs.seeds * runs.repeats
    with load_tqdm(show=progress)(total=total, bar_format=_BAR) as bar:
        if not isinstance(reference, Exposure):
            subject = dataclasses.replace(_subject(reference or Variant(), scene, camera), samples=converged)
            # On all processors: it is not timed, and its bits do not depend on them.
            reference = expose(subject, seed=runs.seed + REFERENCE_SEED, region=window, threads=None)
        truth = reference_of(reference)
        bar.update(converged)
        for name in chosen:  # compiles, and finds pupils
            render(name, runs.samples[0], runs.seed)
        # With one thread, this one renders; other threads of the process do not count.
        clock = time.thread_time if workers == 1 else time.process_time
        rows = measure_rows(render, list(chosen), runs, truth, clock=clock, done=bar.update)
    return ErrorTable(
        title=title or ("white image" if scene is None else repr(scene)),
        rows=rows,
        pixels=int(truth.lit.size),
        lit_pixels=int(truth.lit.sum()),
        seeds=runs.seeds,
        threads=workers,
        reference_samples=reference.samples or converged,
        reference_error=math.sqrt(truth.squared_error),
        interrupted=len(rows) < len(chosen) * len(runs.samples),
    )


class Runs(NamedTuple):
    """Renders of each variant."""

    samples: Sequence[int]
    """Paths per pixel, one row each."""
    seeds: int
    """Number of seeds of each row."""
    seed: int = 0
    """The first seed."""
    repeats: int = 1
    """Number of times that each render is timed."""


def measure_rows(
    render: Callable[[str, int, int], Exposure],
    variants: Sequence[str],
    runs: Runs,
    reference: Reference,
    *,
    clock: Callable[[], float],
    done: Callable[[int], object] = lambda samples: None,
) -> list[ErrorRow]:
    """Render each variant with each number of samples and several seeds, time it and split its error.

    Variants take turns, so that a disturbance of the machine disturbs all of them. Rows of different numbers of samples
    have seeds of their own, so that their errors are independent. `render` takes a variant, the samples (0: set-up
    alone) and a seed; `clock` is that of the processors; `done` is called after each render, with its samples. An
    interrupt ends it with the rows that are done.
    """

    def time_render(name: str, n: int, seed: int) -> tuple[Exposure, tuple[float, float]]:
        wall, cpu = time.perf_counter(), clock()
        exposure = render(name, n, seed)
        return exposure, (clock() - cpu, time.perf_counter() - wall)

    setups = {name: [time_render(name, 0, runs.seed)[1] for _ in range(_SETUPS)] for name in variants}

    def measure(place: int) -> list[ErrorRow]:
        n, first = runs.samples[place], runs.seed + place * runs.seeds
        exposures: dict[str, list[Exposure]] = {name: [] for name in variants}
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in variants}
        for seed in range(first, first + runs.seeds):
            for repeat in range(runs.repeats):
                for name in variants:
                    exposure, seconds = time_render(name, n, seed)
                    times[name].append(seconds)
                    if repeat == 0:
                        exposures[name].append(exposure)
                    done(n)
        return [
            ErrorRow(
                name,
                n,
                *map(statistics.median, zip(*times[name], strict=True)),
                *map(statistics.median, zip(*setups[name], strict=True)),
                **split_error(exposures[name], reference)._asdict(),
            )
            for name in variants
        ]

    return [row for rows in run_until_interrupt(measure, range(len(runs.samples))) for row in rows]


def _subject(variant: Variant, scene: Scene | None, camera: PlenopticCamera) -> Subject:
    """Renders of a variant, with one sample and without ground truth."""
    return Subject(scene, variant.camera_from(camera), 1, variant.replicates, Truth.NONE, variant.settings)


def _rising(samples: Sequence[int]) -> list[int]:
    if isinstance(samples, str | bytes) or not isinstance(samples, Sequence) or not samples:
        raise wrong_kind(samples, "samples", "sequence of whole numbers", "(16, 64, 256)")
    numbers = [whole(n, "samples", at_least=1) for n in samples]
    if any(b <= a for a, b in pairwise(numbers)):
        raise InvalidValueError(f"samples is {tuple(samples)}; each number must be above the one before")
    return numbers


def _check_region(reference: Exposure, window: Region) -> None:
    """Raise if a reference is not of the region studied."""
    shape = tuple(part.stop - part.start for part in window)
    place = (window[0].start, window[0].stop, window[1].start, window[1].stop)
    if reference.image.shape[:2] != shape or (reference.region is not None and reference.region != place):
        raise InvalidValueError(
            f"the reference has {reference.image.shape[:2]} pixels of region {reference.region}; it must be of "
            f"rows and columns {place}, as the study is: give it region="
        )
