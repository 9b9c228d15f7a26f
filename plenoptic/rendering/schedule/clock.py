"""Time limit of a render, and the batch sizes that fit into it."""

from __future__ import annotations

import math
import statistics
import time
from collections import deque

PATHS_PER_BATCH = 1 << 20
"""Paths of a batch, whose end an interruption waits for, and which a crash can lose."""
_SHORTEST, _LONGEST = 0.05, 0.5
"""Duration of a batch under a time limit, s."""
_FIRST = 1 << 13
"""Paths of the first batches, before any has been timed."""
_LEAST = 0.25
"""Fraction of the limit that batches have if other stages took all of it."""
_LATE = 0.1
"""Seconds after the limit at which unfinished batches are abandoned."""
_FINISHING = 7e-8
"""Seconds per pixel and channel for computing image and errors at the end."""


class Clock:
    """Work that can be done within a time limit."""

    def __init__(self, begin: float, limit: float | None, numbers: int = 0) -> None:
        """`numbers` is the size of the image: pixels times channels."""
        self._end = math.inf if limit is None else begin + limit - min(_FINISHING * numbers, 0.5 * limit)
        self._limit = limit
        self._batch_seconds = 0.0 if limit is None else min(max(0.02 * limit, _SHORTEST), _LONGEST)
        self._seconds_per_path: deque[float] = deque(maxlen=9)
        self._first_begin: float | None = None
        """Time at which the first batch began."""
        self.over = False

    @property
    def limited(self) -> bool:
        """True if there is a limit."""
        return self._end < math.inf

    @property
    def ahead(self) -> int:
        """Batches per thread that may begin before the first result is taken: few under a time limit."""
        return 2 if self.limited else 4

    def postpone(self) -> None:
        """Leave some time from now, after stages before the first batch that took too long."""
        if self._limit is not None:
            self._end = max(self._end, time.perf_counter() + _LEAST * self._limit)

    def paths_per_batch(self) -> int:
        """Number of paths that a batch may have."""
        if not self.limited:
            return PATHS_PER_BATCH
        if not self._seconds_per_path:
            return _FIRST
        return min(int(self._batch_seconds / statistics.median(self._seconds_per_path)), PATHS_PER_BATCH)

    def samples_per_batch(self, pixels: int, step: int) -> int:
        """Number of samples per pixel that a batch may have: as many steps as fit, and at least one."""
        return max(self.paths_per_batch() // (pixels * step), 1) * step

    def has_time(self, paths: int) -> bool:
        """True if a batch of this many paths would end in time, even if another batch is finished first."""
        if self.limited:
            needed = 1.5 * paths * statistics.median(self._seconds_per_path) if self._seconds_per_path else 0.0
            self.over |= time.perf_counter() + needed > self._end
        return not self.over

    def affordable(self, paths: int) -> float:
        """Number of further paths that fit into the remaining time at the average pace; 0 without a limit."""
        if not self.limited or self._first_begin is None:
            return 0.0
        now = time.perf_counter()
        return max(self._end - now, 0.0) * paths / max(now - self._first_begin, 1e-9)

    def late(self) -> bool:
        """True if unfinished batches are no longer waited for."""
        return time.perf_counter() > self._end + _LATE

    def record_batch(self, paths: int, seconds: float) -> None:
        """Record the duration of a finished batch."""
        if self.limited:
            self._seconds_per_path.append(seconds / max(paths, 1))
            if self._first_begin is None:
                self._first_begin = time.perf_counter() - seconds
