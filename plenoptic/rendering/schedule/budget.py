"""Budget of a render: when it ends, and the steps of its sample number."""

from __future__ import annotations

import math
from typing import NamedTuple

from plenoptic.core.values import positive, whole
from plenoptic.errors import InvalidValueError

_FEWEST_REPLICATES = 2
"""Minimum number of replicates for a standard error."""
_MOST_REPLICATES = 1 << 16
_START, _FEWEST_OF_EACH = 32, 4
"""Samples before the first decision, and minimum samples of each replicate."""
_STEEP, _FLAT = 0.9, 0.5
"""Exponents of the decrease of errors with samples: the steepest accepted, and that of independent samples."""
_USUAL, _NEXT = 0.6, 4
"""Exponent before one has been measured, and the largest factor of the sample number then: too small costs a step, too
large wastes samples.
"""
_NEAR = 1.05
"""Ratio of the error to its target at which tiles end: another step would cost a quarter more samples for little gain.
"""
_COARSE, _PASSES = 16, 256
"""Divisor of the sample number in the first of two passes, and the sample number from which there are two. The first
pass covers all regions in case of an interruption. Each pass recomputes the illuminated pixels of large frames.
"""
_WITH_CORE = 1.0
"""Exponent of white images with an unvignetted core: it depends on the numbers of samples, and cannot be measured."""
_PART = 0.6
"""Fraction of the affordable samples taken in a step, since the future pace is uncertain."""
ENOUGH_OF_RARE = 1 << 12
"""Maximum samples spent on estimating the error of rare light, without given samples and time limit."""
MAX_SAMPLES = (1 << 31) - 1
"""Maximum samples of a pixel: counts have 32 bits, and Sobol points end at 2^32 of a replicate."""


class Budget(NamedTuple):
    """Conditions that end a render, whichever comes first; None for no condition."""

    samples: int | None
    time_limit: float | None
    """Seconds from the call."""
    target_error: float | None
    replicates: int
    with_core: bool = False
    """True for white images with an unvignetted core: few samples may suffice, and most of them form good nets."""

    @property
    def steps(self) -> bool:
        """True if samples are added step by step, since the final number is unknown."""
        return self.time_limit is not None or self.target_error is not None

    @property
    def passes(self) -> bool:
        """True if tiles are rendered more than once."""
        return self.following(0) < self.max_samples

    @property
    def max_samples(self) -> int:
        """Maximum number of samples of a pixel."""
        return MAX_SAMPLES if self.samples is None else self.samples

    @property
    def enough(self) -> int:
        """Number of samples from which errors are evaluated."""
        return min(self._start * self.replicates, self.max_samples)

    @property
    def _start(self) -> int:
        """Samples of each replicate in the first step, a power of 2."""
        few = 0 if self.with_core else 1 << (_START // self.replicates).bit_length() >> 1
        return max(few, _FEWEST_OF_EACH)

    @property
    def enough_of_rare(self) -> int:
        """Number of samples from which an error that rests on few pixels is accepted."""
        return ENOUGH_OF_RARE if self.samples is None and self.time_limit is None else self.max_samples

    def following(self, done: int) -> int:
        """Number of samples after the next step, at most a quarter more, or half below 32 samples.

        Steps are 4, 5, 6, 7 times the replicates times powers of 2, so that four of them double the samples; the first
        one has about 32 samples. With a core it has 4 of each replicate, and steps are 4 and 6 times powers of 2 up to
        32 samples. Under a time limit powers of 2 come before, so that all pixels get samples soon.
        """
        if not self.steps:
            coarse = self.max_samples // _COARSE // self.replicates * self.replicates
            return coarse if not done and coarse and self.max_samples >= _PASSES else self.max_samples
        each = done // self.replicates
        if each < self._start:
            first = max(2 * each, 1) if self.time_limit is not None else self._start
            return min(first * self.replicates, self.max_samples)
        step = 1 << (each.bit_length() - 3)
        if self.with_core and done < _START:
            step = _FEWEST_OF_EACH
        return min((each + step) * self.replicates, self.max_samples)

    def within(self, done: int, affordable: float) -> int:
        """Number of samples of the next step if only time limits the render: most of the affordable samples.

        Each step has an overhead worth some samples, so that few steps are better. The last ones are small, so that all
        pixels end with similar sample numbers.
        """
        step = self.following(done)
        while self.target_error is None and step < (after := self.following(step)) <= done + _PART * affordable:
            step = after
        return step

    def is_near(self, error: float) -> bool:
        """True if an error has reached the target, or is hardly larger."""
        assert self.target_error is not None
        return error <= _NEAR * self.target_error

    def towards(self, done: int, error: float, before: tuple[float, float]) -> int:
        """Number of samples at which the target should be reached, on the steps of `following`.

        `before` are a smaller sample number and its error, which give the rate of decrease; 0 without them. The number
        is doubled if the error is unknown (0), and under a time limit, which might otherwise end with all samples in
        some pixels and few in others.
        """
        assert self.target_error is not None
        predicted, exponent, limit = 2.0 * done, _USUAL, _NEXT * done
        if before[0] and 0 < error < before[1] < math.inf:
            limit = self.max_samples
            exponent = min(max(math.log(before[1] / error) / math.log(done / before[0]), _FLAT), _STEEP)
        if self.with_core:
            exponent = _WITH_CORE
        if self.target_error < error < math.inf and self.time_limit is None:
            predicted = done * (error / self.target_error) ** (1 / exponent)
        step, predicted = self.following(done), min(predicted, limit, self.max_samples)
        while step < predicted and (not self.with_core or self.following(step) <= predicted):
            step = self.following(step)
        return step


def checked_target(target_error: float, name: str = "target_error") -> float:
    """Return a relative target error above 0 and below 1; raise InvalidValueError otherwise."""
    target = positive(target_error, name)
    if target >= 1:
        raise InvalidValueError(
            f"{name} is {target:g}, which is {100 * target:g} %; it must be below 1, and 0.02 is 2 %"
        )
    return target


def checked_budget(
    samples: int | None, time_limit: float | None, target_error: float | None, replicates: int
) -> Budget:
    """Budget of valid numbers, at least one of them given."""
    if samples is None and time_limit is None and target_error is None:
        raise InvalidValueError(
            "samples, time_limit and target_error are all None and the render would never end; give one of them, "
            "such as samples=64"
        )
    limit = None if time_limit is None else positive(time_limit, "time_limit", "s")
    target = None if target_error is None else checked_target(target_error)
    max_samples = None if samples is None else whole(samples, "samples", at_least=1)
    if max_samples is not None and max_samples > MAX_SAMPLES:
        raise InvalidValueError(f"samples is {max_samples}; it must be at most {MAX_SAMPLES} of a pixel")
    independent = whole(replicates, "replicates", at_least=1)
    if independent > _MOST_REPLICATES:
        raise InvalidValueError(f"replicates is {independent}; it must be at most {_MOST_REPLICATES}")
    if target is not None and independent < _FEWEST_REPLICATES:
        raise InvalidValueError(
            f"replicates is {independent}; with a target_error it must be at least {_FEWEST_REPLICATES}, or there "
            "would be no error to stop by"
        )
    return Budget(max_samples, limit, target, independent if max_samples is None else min(independent, max_samples))
