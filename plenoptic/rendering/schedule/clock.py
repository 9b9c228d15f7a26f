"""Time limit of a render."""

from __future__ import annotations

import math
import statistics
import time
from collections import deque

PATHS_PER_BATCH = 1 << 20
"""A batch is what an interruption may have to wait for, and what may be lost."""
_SHORTEST, _LONGEST = 0.05, 0.5
"""Seconds that a batch may take where time is limited."""
_FIRST = 1 << 13
"""Paths of a batch before any has been timed."""
_LATE = 0.1
"""Seconds after the limit at which batches are given up."""
_FINISHING = 7e-8
"""Seconds that image and errors take in the end, for each pixel and channel."""


class Clock:
    """Amount of work that fits into a time limit."""

    def __init__(self, begin: float, limit: float | None, numbers: int = 0) -> None:
        """`numbers`: of the image, pixels times channels."""
        self._end = math.inf if limit is None else begin + limit - min(_FINISHING * numbers, 0.5 * limit)
        self._batch = 0.0 if limit is None else min(max(0.02 * limit, _SHORTEST), _LONGEST)
        self._rates: deque[float] = deque(maxlen=9)
        self._first: float | None = None
        """When the first batch began."""
        self.over = False

    @property
    def limited(self) -> bool:
        """True if there is a limit."""
        return self._end < math.inf

    @property
    def ahead(self) -> int:
        """Batches for each thread that may be begun before the first is taken: few where time is limited."""
        return 2 if self.limited else 4

    def paths_per_batch(self) -> int:
        """Paths that a batch may have."""
        if not self.limited:
            return PATHS_PER_BATCH
        if not self._rates:
            return _FIRST
        return min(int(self._batch / statistics.median(self._rates)), PATHS_PER_BATCH)

    def samples_per_batch(self, pixels: int, step: int) -> int:
        """Samples of each pixel that a batch may have: as many steps as fit, and at least one."""
        return max(self.paths_per_batch() // (pixels * step), 1) * step

    def has_time(self, paths: int) -> bool:
        """True if a batch of `paths` paths would end in time, if another one is finished before it begins."""
        if self.limited:
            needed = 1.5 * paths * statistics.median(self._rates) if self._rates else 0.0
            self.over |= time.perf_counter() + needed > self._end
        return not self.over

    def affordable(self, paths: int) -> float:
        """Number of further paths that the time allows at the pace so far; 0 without a limit."""
        if not self.limited or self._first is None:
            return 0.0
        now = time.perf_counter()
        return max(self._end - now, 0.0) * paths / max(now - self._first, 1e-9)

    def late(self) -> bool:
        """True if an unfinished batch is no longer awaited."""
        return time.perf_counter() > self._end + _LATE

    def note(self, paths: int, seconds: float) -> None:
        """Learn from a batch that was done."""
        if self.limited:
            self._rates.append(seconds / max(paths, 1))
            if self._first is None:
                self._first = time.perf_counter() - seconds
