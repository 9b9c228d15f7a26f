"""What each part of a render costs, measured by leaving it out."""

from __future__ import annotations

import dataclasses
import itertools
import math
import statistics
import warnings
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.progress.bar import load_tqdm
from plenoptic.core.values import Floats, check_kind, seed_number, whole
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.plan.stages import Plan, Subject
from plenoptic.study.cost.ablation import Ablation, Inseparable, ablations
from plenoptic.study.cost.table import NOT_MEASURED, CostRow, CostTable
from plenoptic.study.exposures import central_pixel, complete, expose, studied_region
from plenoptic.study.interruption import until_interrupted

if TYPE_CHECKING:
    from plenoptic.rendering.exposure import Exposure

SIDE = 128
"""Pixels along the middle of the sensor that are rendered where no region is given."""

SHARE = 1.4826
"""Standard deviation over the median absolute deviation of normal numbers."""

SEEN = 3.0
"""Standard errors by which a change of the picture must be beyond noise to be one."""


def cost_of(
    plan: Plan,
    *,
    samples: int = 16,
    region: tuple[slice, slice] | None = None,
    rounds: int = 5,
    seed: int = 0,
    threads: int = 1,
    progress: bool = True,
) -> CostTable:
    """Measure what each part of a render costs, by leaving it out, one at a time.

    The whole render and one without a part take turns, round after round: each time without is compared with the
    two times of the whole before and after it. Times are those of the processor. Set-up (tables, bounds on pupils, the
    tree of triangles) is measured by renders of a single path, given apart and subtracted: have so many paths that
    it is the smaller part. A first render of each is not counted; it compiles.

    Parameters
    ----------
    plan : Plan
        From `plenoptic.plan`, which tells it what for.
    samples : int, optional
        Paths per pixel, in place of those of the plan.
    region : (slice, slice), optional
        As for `render`; None: the middle of the sensor, at most 128 x 128 pixels.
    rounds : int, optional
        At least 2: from its spread over the rounds comes the noise of the pictures. Standard errors take at least 3.
    seed : int, optional
        Of the random numbers; each render has others.
    threads : int, optional
        1 disturbs measurements least.
    progress : bool, optional
        Whether to show a progress bar.

    Returns
    -------
    CostTable
        `print` shows it; `to_markdown()`, `to_csv()`, and `rows` with the numbers. After Ctrl-C it is `interrupted`,
        with the parts that were done.

    Raises
    ------
    InvalidValueError
        Where the plan does not know what it was made for, or an argument is impossible.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
    >>> table = pl.study.cost_of(pl.plan(None, camera), samples=8, rounds=2)
    >>> [row.stage.name for row in table.rows]
    ['CERTAIN_LIGHT', 'LENS', 'STANDARD_ERROR']
    """
    whole(rounds, "rounds", at_least=2)
    seed_number(seed)
    check_kind(plan, "plan", Plan, "pl.plan(scene, camera)")
    found = ablations(plan)
    assert plan.subject is not None
    out = [one for one in found if isinstance(one, Ablation)]
    if not out:
        raise InvalidValueError("nothing that the plan runs can be left out; choose a richer camera or scene")
    window = studied_region(plan.subject.camera.sensor.shape, region, SIDE)
    run = _Run(samples, window, seed, threads)
    took = _turns(plan.subject, out, run, rounds, progress)
    measured, missing = out[: took.measured], out[took.measured :]
    everything = np.concatenate([_per_path(took, k)[0] for k in range(len(measured))])
    kept = [(one.stage, one.reason) for one in found if isinstance(one, Inseparable)]
    return CostTable(
        [_row(one, k, took) for k, one in enumerate(measured)],
        [*kept, *((one.stage, NOT_MEASURED) for one in missing)],
        1e6 * float(np.nanmedian(everything)) if np.isfinite(everything).any() else math.nan,
        float(np.median(took.set_up[: len(measured), 0])),
        samples=samples,
        rounds=rounds,
        pixels=(window[0].stop - window[0].start, window[1].stop - window[1].start),
        threads=threads,
    )


_SET_UPS = 3
"""Rounds in which set-up is measured."""


class _Run(NamedTuple):
    samples: int
    region: tuple[slice, slice]
    seed: int
    threads: int


def _exposed(subject: Subject, run: _Run, number: int) -> Exposure:
    """One render; scenes without light or out of sight are no news here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        subject = dataclasses.replace(subject, samples=run.samples)
        return expose(subject, seed=run.seed + number, region=run.region, threads=run.threads)


class Picture:
    """Mean of images with independent noise, and their squared deviations from it."""

    def __init__(self) -> None:
        self.count, self.mean, self._squares = 0, np.zeros(()), np.zeros(())

    def add(self, image: NDArray[np.float32]) -> None:
        """One more image, the mean of its channels."""
        seen = image.mean(axis=2, dtype=np.float64)
        self.count += 1
        off = seen - self.mean
        self.mean = self.mean + off / self.count
        self._squares = self._squares + off * (seen - self.mean)

    @property
    def variance(self) -> Floats:
        """Of the mean."""
        return np.asarray(self._squares / (self.count * (self.count - 1)))


class _Times(NamedTuple):
    """CPU seconds of n comparisons, and what they show."""

    whole: Floats
    """(n, rounds + 1)."""
    without: Floats
    """(n, rounds)."""
    set_up: Floats
    """(n, 2, _SET_UPS or less): of the whole, and without the part."""
    paths: Floats
    """(n + 1,): of the whole, and without each part."""
    pictures: list[Picture]
    measured: int
    """How many of the comparisons are there: all but after an interrupt."""


def _turns(subject: Subject, out: list[Ablation], run: _Run, rounds: int, progress: bool) -> _Times:
    """For each part: render all of it, without the part, all of it, without the part, and so on.

    Only two cameras take turns at a time, so that what is remembered of cameras used last stays.
    """
    n, set_ups = len(out), min(rounds, _SET_UPS)
    pictures = [Picture() for _ in range(n + 1)]
    times = _Times(
        np.empty((n, rounds + 1)), np.empty((n, rounds)), np.empty((n, 2, set_ups)), np.ones(n + 1), pictures, 0
    )
    one_path = run._replace(samples=1, region=central_pixel(run.region))
    numbers = itertools.count(1)
    with load_tqdm()(total=n * (2 * rounds + 3 + 2 * set_ups), disable=not progress) as bar:

        def seconds(one: Subject, run: _Run, picture: int | None = None) -> float:
            shot = complete(_exposed(one, run, next(numbers)))
            bar.update()
            assert shot.stats is not None
            if picture is not None:
                pictures[picture].add(shot.image)
                times.paths[picture] = max(shot.stats.paths, 1)
            return shot.stats.cpu_seconds

        def compare(k: int) -> None:
            one = out[k]
            both = (subject, one.subject)
            for each in both:  # compiles
                seconds(each, run)
            for turn in range(set_ups):
                times.set_up[k, :, turn] = [seconds(each, one_path) for each in both]
            times.whole[k, 0] = seconds(subject, run, 0)
            for round_ in range(rounds):
                times.without[k, round_] = seconds(one.subject, run, k + 1)
                times.whole[k, round_ + 1] = seconds(subject, run, 0)

        return times._replace(measured=len(until_interrupted(compare, range(n))))


def _per_path(took: _Times, k: int) -> tuple[Floats, Floats]:
    """CPU seconds per path beyond set-up, (rounds + 1,) of the whole and (rounds,) without part k.

    nan where a render took no longer than set-up: too short to tell.
    """
    whole = (took.whole[k] - np.median(took.set_up[k, 0])) / took.paths[0]
    without = (took.without[k] - np.median(took.set_up[k, 1])) / took.paths[k + 1]
    return np.where(whole > 0, whole, np.nan), np.where(without > 0, without, np.nan)


def _row(one: Ablation, k: int, took: _Times) -> CostRow:
    everything, without = _per_path(took, k)
    beside = 0.5 * (everything[:-1] + everything[1:])
    share, error = share_of(without, beside)
    set_up = np.median(took.set_up[k], axis=1)
    return CostRow(
        one.stage,
        one.instead,
        1e6 * float(np.median(beside)),
        1e6 * float(np.median(without)),
        share,
        error,
        float(set_up[0] - set_up[1]),
        picture_change(took.pictures[0], took.pictures[k + 1]),
        one.also,
    )


def share_of(without: Floats, beside: Floats) -> tuple[float, float | None]:
    """Median over the rounds of the per cent of the whole that a part takes, and its standard error.

    `without` and `beside`, (rounds,): costs without the part, and of the whole in the same round. There is no error
    with fewer than 3 rounds; nan and None where a cost is not known.
    """
    taken = (100.0 * (1.0 - without / beside)).tolist()
    if not all(map(math.isfinite, taken)):
        return math.nan, None
    middle = statistics.median(taken)
    if len(taken) < 3:
        return middle, None
    spread = SHARE * statistics.median(abs(part - middle) for part in taken)
    # The median of n normal numbers has a standard error of sqrt(pi / 2) / sqrt(n) standard deviations.
    return middle, math.sqrt(0.5 * math.pi / len(taken)) * spread


def picture_change(one: Picture, other: Picture) -> float | None:
    """Root mean square of the difference of two pictures over the mean of the first, noise subtracted, in per cent.

    0 where it is not beyond 3 of its standard errors; None where the first picture is black.
    """
    middle = float(one.mean.mean())
    if not middle > 0.0:
        return None
    squares = (one.mean - other.mean) ** 2 - one.variance - other.variance
    found, error = float(squares.mean()), float(squares.std()) / math.sqrt(squares.size)
    return 100.0 * math.sqrt(found) / middle if found > SEEN * error else 0.0
