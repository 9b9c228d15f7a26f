"""End of a render, and the steps towards it."""

from __future__ import annotations

import math
from typing import NamedTuple

from plenoptic.core.values import positive, whole
from plenoptic.errors import InvalidValueError

_FEWEST_REPLICATES = 2
"""Replicates from which there are errors to stop by."""
_MOST_REPLICATES = 1 << 16
_START, _FEWEST_OF_EACH = 32, 4
"""Samples before anything is decided, and those of each replicate."""
_STEEP, _FLAT = 0.9, 0.5
"""Exponents with which errors fall: the steepest that is believed, and that of independent samples."""
_USUAL, _NEXT = 0.6, 4
"""The exponent where none is known yet, and how many times the samples may then be: too few cost a step, too many are
lost."""
_NEAR = 1.05
"""Error over the one wanted up to which tiles end: another step would take a quarter more samples for as little."""
_COARSE, _PASSES = 16, 256
"""A given number of samples is rendered in two passes from the second number on: a part of them everywhere, and then
the rest, so that what is interrupted has all regions. Each pass finds anew what feeds the pixels of large frames."""
_PART = 0.6
"""Of what fits into a time limit: how fast the rest will go is not known exactly."""
ENOUGH_OF_RARE = 1 << 12
"""Samples up to which it is tried to know the error of rare light, where neither samples nor a time limit is given."""
MAX_SAMPLES = (1 << 31) - 1
"""Of a pixel: they are counted in 32 bits, and Sobol points end at 2^32 of a replicate."""


class Budget(NamedTuple):
    """Limits of a render, of which the first one ends it; None is no limit."""

    samples: int | None
    time_limit: float | None
    """Seconds since the call."""
    target_error: float | None
    replicates: int

    @property
    def steps(self) -> bool:
        """True if samples are added step by step, because their number is not known beforehand."""
        return self.time_limit is not None or self.target_error is not None

    @property
    def passes(self) -> bool:
        """True if tiles are rendered more than once."""
        return self.following(0) < self.max_samples

    @property
    def max_samples(self) -> int:
        """The largest number of samples of a pixel."""
        return MAX_SAMPLES if self.samples is None else self.samples

    @property
    def enough(self) -> int:
        """Samples from which on errors are looked at."""
        return min(self._start * self.replicates, self.max_samples)

    @property
    def _start(self) -> int:
        """Samples of each replicate, a power of 2."""
        return max(1 << (_START // self.replicates).bit_length() >> 1, _FEWEST_OF_EACH)

    @property
    def enough_of_rare(self) -> int:
        """Samples from which on an error counts that rests on few pixels."""
        return ENOUGH_OF_RARE if self.samples is None and self.time_limit is None else self.max_samples

    def following(self, done: int) -> int:
        """Number of samples after the next step: at most a quarter more.

        Steps are 4, 5, 6, 7 times the replicates times powers of 2, so that four of them double the samples; the first
        has about 32 samples. With a time limit powers of 2 come before, so that all pixels have something soon.
        """
        if not self.steps:
            coarse = self.max_samples // _COARSE // self.replicates * self.replicates
            return coarse if not done and coarse and self.max_samples >= _PASSES else self.max_samples
        each = done // self.replicates
        if each < self._start:
            first = max(2 * each, 1) if self.time_limit is not None else self._start
            return min(first * self.replicates, self.max_samples)
        return min((each + (1 << (each.bit_length() - 3))) * self.replicates, self.max_samples)

    def within(self, done: int, affordable: float) -> int:
        """Number of samples of the next step, where time alone is limited: most of the affordable ones.

        Each step costs as much as some samples do, and the fewer there are the better; the last ones are small, so that
        all pixels end with about as many.
        """
        step = self.following(done)
        while self.target_error is None and step < (after := self.following(step)) <= done + _PART * affordable:
            step = after
        return step

    def is_near(self, error: float) -> bool:
        """True if an error is below the target, or hardly above it."""
        assert self.target_error is not None
        return error <= _NEAR * self.target_error

    def towards(self, done: int, error: float, before: tuple[float, float]) -> int:
        """The number of samples at which the target should be reached, on the steps of `following`.

        `before` are fewer samples and the error that they left, which tell how fast it falls; 0 where there are none.
        Twice as many samples where the error is not known (0), and with a time limit, which might be over when some
        pixels have all and others next to nothing.
        """
        assert self.target_error is not None
        wanted, falls, most = 2.0 * done, _USUAL, _NEXT * done
        if before[0] and 0 < error < before[1] < math.inf:
            most = self.max_samples
            falls = min(max(math.log(before[1] / error) / math.log(done / before[0]), _FLAT), _STEEP)
        if self.target_error < error < math.inf and self.time_limit is None:
            wanted = done * (error / self.target_error) ** (1 / falls)
        step, wanted = self.following(done), min(wanted, most, self.max_samples)
        while step < wanted:
            step = self.following(step)
        return step


def checked_target(target_error: float, name: str = "target_error") -> float:
    """A relative error that can be aimed at: above 0 and below 1."""
    target = positive(target_error, name)
    if target >= 1:
        raise InvalidValueError(
            f"{name} is {target:g}, which is {100 * target:g} %; it must be below 1, and 0.02 is 2 %"
        )
    return target


def checked_budget(
    samples: int | None, time_limit: float | None, target_error: float | None, replicates: int
) -> Budget:
    """A budget of possible numbers, at least one of them given."""
    if samples is None and time_limit is None and target_error is None:
        raise InvalidValueError(
            "samples, time_limit and target_error are all None and the render would never end; give one of them, "
            "such as samples=64"
        )
    limit = None if time_limit is None else positive(time_limit, "time_limit", "s")
    target = None if target_error is None else checked_target(target_error)
    most = None if samples is None else whole(samples, "samples", at_least=1)
    if most is not None and most > MAX_SAMPLES:
        raise InvalidValueError(f"samples is {most}; it must be at most {MAX_SAMPLES} of a pixel")
    independent = whole(replicates, "replicates", at_least=1)
    if independent > _MOST_REPLICATES:
        raise InvalidValueError(f"replicates is {independent}; it must be at most {_MOST_REPLICATES}")
    if target is not None and independent < _FEWEST_REPLICATES:
        raise InvalidValueError(
            f"replicates is {independent}; with a target_error it must be at least {_FEWEST_REPLICATES}, or there "
            "would be no error to stop by"
        )
    return Budget(most, limit, target, independent if most is None else min(independent, most))
