"""A percentile near 100 of numbers that come in parts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


class HighPercentile:
    """`np.percentile` of all numbers that were added, of which only the highest are stored."""

    def __init__(self, percentile: float, *, most: int) -> None:
        """`most`: numbers that may be added."""
        self._share = percentile / 100.0
        self._wanted = most - math.floor(self._place(most))
        self._parts: list[NDArray[Any]] = []
        self._least = -np.inf
        """What is below is not among the highest."""
        self.added = 0

    def _place(self, count: int) -> float:
        """Position of the percentile in the order of so many numbers, from 0."""
        return max(count - 1, 0) * self._share

    def add(self, numbers: NDArray[Any]) -> None:
        """Numbers (n,), none of them nan."""
        self.added += numbers.size
        self._parts.append(numbers[numbers >= self._least])
        if sum(part.size for part in self._parts) > 2 * self._wanted:
            kept = np.concatenate(self._parts)
            kept.partition(kept.size - self._wanted)
            self._parts = [kept[-self._wanted :].copy()]
            self._least = float(self._parts[0].min())

    def found(self) -> float:
        """The percentile; nan where there are no numbers."""
        if not self.added:
            return math.nan
        kept, place = np.concatenate(self._parts), self._place(self.added)
        # From the lower one of the two numbers between which it lies, of which the latter is absent at the very end.
        above = self.added - 1 - math.floor(place)
        places = [kept.size - 1 - above, kept.size - 1 - max(above - 1, 0)]
        kept.partition(places)
        return float(np.quantile(kept[places], place - math.floor(place)))
