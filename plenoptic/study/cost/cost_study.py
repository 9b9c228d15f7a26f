"""The study of costs: CPU time of each part of a render, measured by leaving it out."""

from __future__ import annotations

import dataclasses
import itertools
import math
import statistics
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.progress.bar import load_tqdm
from plenoptic.core.values import Floats, check_kind, seed_number, whole
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.stages import Plan, Stage, Subject
from plenoptic.study.cost.ablation import Ablation, Inseparable, ablations
from plenoptic.study.exposures import Region, central_pixel, expose, region_bounds
from plenoptic.study.study_table import Cell, StudyTable, run_until_interrupt

_SIDE = 128
"""Pixels along the middle of the sensor that are render_seconds by default."""

_NORMAL_SPREAD = 1.4826
"""Standard deviation over the median absolute deviation of normal numbers."""

_SIGNIFICANT = 3.0
"""Standard errors by which a change of the picture must exceed 0."""

_SET_UPS = 3
"""Rounds in which set-up is measured."""


class CostRow(NamedTuple):
    """Cost of one stage of a render.

    Examples
    --------
    See `StudyTable`.
    """

    stage: Stage
    instead: str
    """Done in place of the stage."""
    with_it: float
    """CPU seconds per million paths beyond set-up, median over the rounds; nan if a render took no longer than that."""
    without_it: float
    """The same without the stage."""
    percent: float
    """Share of the whole, median over the rounds; negative if the render is slower without the stage."""
    standard_error: float | None
    """Of `percent`; None with fewer than 3 rounds."""
    set_up: float
    """CPU seconds of set-up of the stage, for any number of paths."""
    picture_change: float | None
    """Root mean square change of the image without the stage, over its mean, in per cent; 0 where noise hides it.

    None if the image is black.
    """
    also: tuple[Stage, ...] = ()
    """Stages that stop together with this one: their costs are part of it."""

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Texts with the heads of their columns."""
        return (
            ("stage", stage_text(self.stage)),
            ("without it", self.instead),
            ("s with", _number(self.with_it, ".3g")),
            ("s without", _number(self.without_it, ".3g")),
            ("% of CPU", _number(self.percent, ".1f")),
            ("+-", "" if self.standard_error is None else f"{self.standard_error:.1f}"),
            ("set-up s", f"{round(self.set_up, 3) + 0.0:.3f}"),
            ("picture %", "" if self.picture_change is None else f"{float(f'{self.picture_change:.2g}'):g}"),
            ("stops too", ", ".join(map(stage_text, self.also))),
        )


def stage_text(stage: Stage) -> str:
    """The name of a stage in words."""
    return stage.name.lower().replace("_", " ")


def _number(number: float, form: str) -> str:
    return "" if math.isnan(number) else format(number, form)


def cost_of(
    plan: Plan,
    *,
    samples: int = 16,
    region: Region | None = None,
    rounds: int = 5,
    seed: int = 0,
    threads: int = 1,
    progress: bool = True,
) -> StudyTable[CostRow]:
    """Measure the CPU time of each part of a render by leaving it out, one at a time.

    The whole render and one without a part take turns, round after round: each time without is compared with the
    two times of the whole before and after it. Set-up (tables, bounds on pupils, the tree of triangles) is measured by
    renders of a single path, stated apart and subtracted: take so many paths that it is the smaller part. A first
    render of each is not counted; it compiles.

    Parameters
    ----------
    plan : Plan
        From `plenoptic.plan`.
    samples : int, optional
        Paths per pixel, in place of those of the plan.
    region : (slice, slice), optional
        As for `render`; None: the middle of the sensor, at most 128 x 128 pixels.
    rounds : int, optional
        At least 2: the spread over the rounds tells the noise of the pictures. Standard errors take at least 3.
    seed : int, optional
        First seed; each render has another.
    threads : int, optional
        1 disturbs measurements least.
    progress : bool, optional
        True shows a progress bar.

    Returns
    -------
    StudyTable
        Its rows are `CostRow`, the dearest stage first. After Ctrl-C it is `interrupted`, with the parts measured.

    Raises
    ------
    InvalidValueError
        If the plan has no subject, or an argument is impossible.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
    >>> table = pl.study.cost_of(pl.plan(None, camera), samples=8, rounds=2)
    >>> sorted(row.stage.name for row in table.rows)
    ['LENS', 'STANDARD_ERROR', 'UNVIGNETTED_CORE']
    """
    whole(rounds, "rounds", at_least=2)
    seed_number(seed)
    check_kind(plan, "plan", Plan, "pl.plan(scene, camera)")
    stages = ablations(plan)
    assert plan.subject is not None
    separable = [stage for stage in stages if isinstance(stage, Ablation)]
    if not separable:
        raise InvalidValueError("nothing that the plan runs can be left out; choose a richer camera or scene")
    window = region_bounds(plan.subject.camera.sensor.shape, region, _SIDE)
    run = _Run(samples, window, seed, threads)
    rows, set_ups = zip(*_measure_all(plan.subject, separable, run, rounds, progress), strict=True)
    dearest_first = sorted(rows, key=lambda row: -row.percent if math.isfinite(row.percent) else math.inf)
    notes = [_summary(rows, statistics.median(set_ups), run, rounds)]
    notes += [f"Not left out: {stage_text(s.stage)}: {s.reason}." for s in stages if isinstance(s, Inseparable)]
    return StudyTable(dearest_first, notes, interrupted=len(rows) < len(separable))


def _summary(rows: Sequence[CostRow], set_up: float, run: _Run, rounds: int) -> str:
    cpu_per_million = statistics.median([row.with_it for row in rows if math.isfinite(row.with_it)] or [math.nan])
    height, width = (part.stop - part.start for part in run.region)
    text = (
        f"{height} x {width} pixels, {run.samples} samples, {run.threads} thread{'s' * (run.threads != 1)}, {rounds} "
        f"rounds; s are CPU seconds per million paths, {cpu_per_million:.3g} for all of it, beside {set_up:.2g} s of "
        "set-up."
    )
    if any(math.isnan(row.percent) for row in rows):
        text += " Empty: renders took no longer than set-up, too short to tell; take more samples or pixels."
    if any(row.percent < 0 for row in rows):
        text += " Negative: without it paths do more. Shares overlap and do not add up."
    return text


class _Run(NamedTuple):
    samples: int
    region: Region
    seed: int
    threads: int


def _exposure(subject: Subject, run: _Run, number: int) -> Exposure:
    """One render, without warnings of scenes that are dark or out of sight."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        subject = dataclasses.replace(subject, samples=run.samples)
        return expose(subject, seed=run.seed + number, region=run.region, threads=run.threads)


class Picture:
    """Mean of images with independent noise, and the variance of that mean."""

    def __init__(self) -> None:
        self.count, self.mean, self._squares = 0, np.zeros(()), np.zeros(())

    def add(self, image: NDArray[np.float32]) -> None:
        """Add one image, the mean of its channels."""
        grey = image.mean(axis=2, dtype=np.float64)
        self.count += 1
        deviation = grey - self.mean
        self.mean = self.mean + deviation / self.count
        self._squares = self._squares + deviation * (grey - self.mean)

    @property
    def variance(self) -> Floats:
        """Variance of the mean."""
        return np.asarray(self._squares / (self.count * (self.count - 1)))


def _measure_all(
    subject: Subject, separable: list[Ablation], run: _Run, rounds: int, progress: bool
) -> list[tuple[CostRow, float]]:
    """For each part: render the whole, without the part, the whole, and so on; its row, and set-up of the whole.

    Only two cameras take turns at a time, so that the caches of the cameras used last hold.
    """
    set_ups = min(rounds, _SET_UPS)
    one_path = run._replace(samples=1, region=central_pixel(run.region))
    numbers = itertools.count(1)
    with load_tqdm(show=progress)(total=len(separable) * (2 * rounds + 3 + 2 * set_ups)) as bar:

        def render_stats(subject: Subject, run: _Run, picture: Picture | None = None) -> tuple[float, int]:
            exposure = _exposure(subject, run, next(numbers))
            bar.update()
            assert exposure.stats is not None
            if picture is not None:
                picture.add(exposure.image)
            return exposure.stats.cpu_seconds, exposure.stats.paths

        def measure(ablation: Ablation) -> tuple[CostRow, float]:
            subjects, pictures = (subject, ablation.subject), (Picture(), Picture())
            for each in subjects:  # compiles
                render_stats(each, run)
            set_up = np.median([[render_stats(each, one_path)[0] for each in subjects] for _ in range(set_ups)], axis=0)

            def per_million(part: int) -> float:
                """CPU seconds beyond set-up; nan if the render took no longer than that."""
                seconds, paths = render_stats(subjects[part], run, pictures[part])
                return 1e6 * (seconds - set_up[part]) / max(paths, 1) if seconds > set_up[part] else math.nan

            whole, without = [per_million(0)], []
            for _ in range(rounds):
                without.append(per_million(1))
                whole.append(per_million(0))
            neighbours = 0.5 * (np.array(whole[:-1]) + whole[1:])
            row = CostRow(
                *(ablation.stage, ablation.instead, float(np.median(neighbours)), float(np.median(without))),
                *share_of(np.array(without), neighbours),
                float(set_up[0] - set_up[1]),
                picture_change(*pictures),
                ablation.also,
            )
            return row, float(set_up[0])

        return run_until_interrupt(measure, separable)


def share_of(without: Floats, whole: Floats) -> tuple[float, float | None]:
    """Median over the rounds of the per cent of the whole that a part takes, and its standard error.

    `without` and `whole`, (rounds,): costs in the same round. The error is None with fewer than 3 rounds; nan and None
    if a cost is nan.
    """
    shares = (100.0 * (1.0 - without / whole)).tolist()
    if not all(map(math.isfinite, shares)):
        return math.nan, None
    median = statistics.median(shares)
    if len(shares) < 3:
        return median, None
    spread = _NORMAL_SPREAD * statistics.median(abs(share - median) for share in shares)
    # The median of n normal numbers has a standard error of sqrt(pi / 2) / sqrt(n) standard deviations.
    return median, math.sqrt(0.5 * math.pi / len(shares)) * spread


def picture_change(picture: Picture, other: Picture) -> float | None:
    """Root mean square difference of two pictures over the mean of the first, noise subtracted, in per cent.

    0 if it does not exceed 3 of its standard errors; None if the first picture is black.
    """
    mean = float(picture.mean.mean())
    if not mean > 0.0:
        return None
    squares = (picture.mean - other.mean) ** 2 - picture.variance - other.variance
    mean_square, error = float(squares.mean()), float(squares.std()) / math.sqrt(squares.size)
    return 100.0 * math.sqrt(mean_square) / mean if mean_square > _SIGNIFICANT * error else 0.0
