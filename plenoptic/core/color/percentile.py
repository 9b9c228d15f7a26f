"""Percentile near 100 of numbers that arrive in batches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


class HighPercentile:
    """`np.percentile` of all numbers added, with memory for the highest of them only."""

    def __init__(self, percentile: float, *, max_count: int) -> None:
        """`max_count`: upper limit of the count of numbers added."""
        self._fraction = percentile / 100.0
        self._n_highest = max_count - math.floor(self._rank(max_count))
        self._parts: list[NDArray[Any]] = []
        self._lower_bound = -np.inf
        """Numbers below are not among the highest."""
        self.count = 0

    def _rank(self, count: int) -> float:
        """Fractional rank of the percentile among `count` sorted numbers, from 0."""
        return max(count - 1, 0) * self._fraction

    def add(self, numbers: NDArray[Any]) -> None:
        """Add numbers (n,), none of them nan."""
        self.count += numbers.size
        self._parts.append(numbers[numbers >= self._lower_bound])
        if sum(part.size for part in self._parts) > 2 * self._n_highest:
            highest = np.concatenate(self._parts)
            highest.partition(highest.size - self._n_highest)
            self._parts = [highest[-self._n_highest :].copy()]
            self._lower_bound = float(self._parts[0].min())

    def value(self) -> float:
        """The percentile; nan where there are no numbers."""
        if not self.count:
            return math.nan
        highest, rank = np.concatenate(self._parts), self._rank(self.count)
        # Interpolate from the lower of the two neighbours of the rank; the upper one is absent at the very end.
        n_above = self.count - 1 - math.floor(rank)
        neighbours = [highest.size - 1 - n_above, highest.size - 1 - max(n_above - 1, 0)]
        highest.partition(neighbours)
        return float(np.quantile(highest[neighbours], rank - math.floor(rank)))
