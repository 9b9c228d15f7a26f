"""Rows of an error study: renders that take turns, timed and split."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from plenoptic.core.engines.engine import Engine
from plenoptic.rendering.exposure import Exposure
from plenoptic.study.error_time.rows import ErrorRow
from plenoptic.study.error_time.split import Reference, split_error
from plenoptic.study.interruption import until_interrupted

_SETUPS = 5
"""Calls of one path each, of which the median is what setting up costs."""
_PIXEL_BYTES = 32
"""Of an exposure without truth, at most."""

Expose = Callable[[str, int, int], Exposure]
"""From the name of a variant, the number of samples and the seed."""

Cost = tuple[float, float]
"""Seconds of all processors together, and on the clock."""


class Runs(NamedTuple):
    """How often each variant is rendered."""

    samples: Sequence[int]
    """Paths per pixel, one row each."""
    seeds: int
    """How many, each row."""
    seed: int = 0
    """The first one."""
    repeats: int = 1
    """How often each render is timed."""


class Call(NamedTuple):
    """A render that is timed, as engines are given it."""

    variant: str
    samples: int
    """0: next to nothing is rendered, which tells what setting up costs."""
    seed: int
    kept: bool
    """Whether its exposure is wanted, and not only how long it took."""
    pixels: int

    @property
    def size(self) -> float:
        """Paths."""
        return (self.samples or 1) * self.pixels

    @property
    def nbytes(self) -> int:
        """Of its exposure."""
        return _PIXEL_BYTES * self.pixels if self.kept else 0


Timed = tuple[Exposure | None, Cost]


def timed(expose: Expose, set_up: Callable[[str], object], call: Call, clock: Callable[[], float]) -> Timed:
    """Carry out a call; `clock` tells the time of processors."""
    wall, cpu = time.perf_counter(), clock()
    shot = expose(call.variant, call.samples, call.seed) if call.samples else None
    if not call.samples:
        set_up(call.variant)
    cost = clock() - cpu, time.perf_counter() - wall
    return shot if call.kept else None, cost


def measured_rows(
    engine: Engine[Call, Timed],
    variants: Sequence[str],
    runs: Runs,
    reference: Reference,
    *,
    done: Callable[[int], object] = lambda samples: None,
) -> list[ErrorRow]:
    """Expose each variant with each number of samples and several seeds, and split its error.

    Variants take turns, so that what disturbs the machine disturbs all of them. Rows of different numbers of samples
    have seeds of their own, so that their errors are independent. `done` is called after each render, with its samples.
    An interrupt ends it with the rows that are done.
    """
    pixels, (samples, seeds, seed, repeats) = int(reference.lit.size), runs

    def carried_out(calls: list[Call]) -> Iterator[tuple[Call, Exposure | None, Cost]]:
        for each in engine.results(iter(calls), n_jobs=len(calls), is_cancelled=lambda: False):
            yield each.job, *each.result

    starting: dict[str, list[Cost]] = {name: [] for name in variants}
    for call, _, cost in carried_out([Call(name, 0, seed, False, 1) for name in variants for _ in range(_SETUPS)]):
        starting[call.variant].append(cost)

    def measure(place: int) -> list[ErrorRow]:
        n, first = samples[place], seed + place * seeds
        calls = [
            Call(name, n, number, repeat == 0, pixels)
            for number in range(first, first + seeds)
            for repeat in range(repeats)
            for name in variants
        ]
        shots: dict[str, dict[int, Exposure]] = {name: {} for name in variants}
        costs: dict[str, list[Cost]] = {name: [] for name in variants}
        for call, shot, cost in carried_out(calls):
            costs[call.variant].append(cost)
            if shot is not None:
                shots[call.variant][call.seed] = shot
            done(n)
        return [
            ErrorRow(
                name,
                n,
                *_median(costs[name]),
                *_median(starting[name]),
                **split_error([shot for _, shot in sorted(shots[name].items())], reference)._asdict(),
            )
            for name in variants
        ]

    return [row for rows in until_interrupted(measure, range(len(samples))) for row in rows]


def _median(costs: Sequence[Cost]) -> Cost:
    """Median of CPU and of wall time, each by itself."""
    cpu, wall = (statistics.median(seconds) for seconds in zip(*costs, strict=True))
    return cpu, wall
