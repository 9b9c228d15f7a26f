"""Rows of an error study: renders that take turns, timed and split."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

from plenoptic.rendering.exposure import Exposure
from plenoptic.study.error_time.rows import ErrorRow
from plenoptic.study.error_time.split import Reference, split_error
from plenoptic.study.interruption import until_interrupted

T = TypeVar("T")

_SETUPS = 5
"""Calls of one path each, of which the median is what setting up costs."""

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


def measured_rows(
    expose: Expose,
    variants: Sequence[str],
    runs: Runs,
    reference: Reference,
    *,
    set_up: Callable[[str], object] = lambda name: None,
    done: Callable[[int], object] = lambda samples: None,
) -> list[ErrorRow]:
    """Expose each variant with each number of samples and several seeds, and split its error.

    Variants take turns, so that what disturbs the machine disturbs all of them. Rows of different numbers of samples
    have seeds of their own, so that their errors are independent. `set_up` renders next to nothing in a variant, and
    `done` is called after each render, with its samples. An interrupt ends it with the rows that are done.
    """
    samples, seeds, seed, repeats = runs
    for name in variants:  # compiles, and traces pupils, which are kept
        expose(name, samples[0], seed)
    starting = {name: _median([_timed(set_up, name)[1] for _ in range(_SETUPS)]) for name in variants}

    def measure(place: int) -> list[ErrorRow]:
        n = samples[place]
        shots: dict[str, list[Exposure]] = {name: [] for name in variants}
        costs: dict[str, list[Cost]] = {name: [] for name in variants}
        for number in range(seed + place * seeds, seed + (place + 1) * seeds):
            for repeat in range(repeats):
                for name in variants:
                    shot, cost = _timed(expose, name, n, number)
                    costs[name].append(cost)
                    if repeat == 0:
                        shots[name].append(shot)
                    done(n)
        return [
            ErrorRow(name, n, *_median(costs[name]), *starting[name], **split_error(shots[name], reference)._asdict())
            for name in variants
        ]

    return [row for rows in until_interrupted(measure, range(len(samples))) for row in rows]


def _timed(call: Callable[..., T], *arguments: object) -> tuple[T, Cost]:
    wall, cpu = time.perf_counter(), time.process_time()
    result = call(*arguments)
    return result, (time.process_time() - cpu, time.perf_counter() - wall)


def _median(costs: Sequence[Cost]) -> Cost:
    """Median of CPU and of wall time, each by itself."""
    cpu, wall = (statistics.median(seconds) for seconds in zip(*costs, strict=True))
    return cpu, wall
