"""Progress bar of a render: progress, remaining time and error."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Any

from plenoptic.core.progress.bar import DELAY, Poller, load_tqdm
from plenoptic.core.progress.compiling import ENDING, compiling, compiling_text
from plenoptic.rendering.schedule.progress import Progress

_INTERVAL = 0.5
_SHARE = 50
"""Ratio of the interval between two error estimates to their duration, so that these take 2 % of the time at most."""


class ProgressBar:
    """Progress bar of tqdm, in terminals and notebooks. It shows progress towards the nearest end: samples, time or
    error.

    It is entered before the preparation, appears at `start`, or earlier if compilation takes a second, and disappears
    on an exception.
    """

    def __init__(self, begin: float, *, show: bool) -> None:
        self._begin, self._watch = begin, Poller(self._on_watch) if show else None
        self._progress: Progress | None = None
        self._error: float | None = None
        self._first_batch: tuple[float, float] | None = None
        """Time of the first batch, after all compilation, and the progress at that time."""
        self._expected: float | None = None
        """Estimated total time in s."""
        self._drawn = self._measured = self._moved = time.perf_counter()
        self._error_seconds = 0.0
        self._ending = False
        self._bar: Any = None
        self._drawing = threading.RLock()
        """Lock for drawing, taken by the render, the watch, and the handler of Ctrl-C within these."""

    def __enter__(self) -> ProgressBar:
        if self._watch is not None:
            self._watch.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._watch is not None:
            self._watch.__exit__(kind, error, trace)
        if self._bar is not None:
            self._bar.leave = kind is None
            self._bar.close()

    def start(self, progress: Progress, expected: float | None = None) -> None:
        """Begin: all is prepared. `expected` is the estimated total time in s."""
        self._progress, self._expected = progress, expected
        if self._watch is not None:
            self._show()

    def update(self) -> None:
        """Redraw, twice a second at most."""
        now = self._moved = time.perf_counter()
        if self._bar is None or self._progress is None:
            return
        if self._first_batch is None:
            self._first_batch = (now, self._fraction())
        if now - self._drawn < _INTERVAL:
            return
        self._drawn = now
        if now - self._measured > max(_INTERVAL, _SHARE * self._error_seconds):
            self._error = self._progress.error()
            self._error_seconds, self._measured = time.perf_counter() - now, now
        self._show()

    def end(self) -> None:
        """Report that Ctrl-C was received, and running batches are being finished."""
        self._ending = True
        if self._bar is not None:
            self._show()

    def close(self, *, finished: bool) -> None:
        """Draw the final state."""
        if self._bar is None or self._progress is None:
            return
        self._error = self._progress.error()
        self._show(1.0 if finished else None)

    def _on_watch(self) -> None:
        """Called by the watch during compilation and after it."""
        if self._bar is not None or time.perf_counter() - self._begin > DELAY:
            self._show()

    def _fraction(self) -> float:
        """Finished fraction of the work, by the condition that will end it first."""
        progress = self._progress
        if progress is None:
            return 0.0
        budget = progress.budget
        shares = [0.0]
        if budget.samples is not None:
            shares.append(float((progress.done / budget.samples).mean()))
        if budget.time_limit is not None:
            shares.append((time.perf_counter() - self._begin) / budget.time_limit)
        if budget.target_error is not None:
            begun, closed = float((progress.done > 0).mean()), 1 - float(progress.open.any(axis=1).mean())
            # Errors fall about as n^-0.6 to n^-0.7; see docs/error_and_time.md.
            reached = min((budget.target_error / self._error) ** 1.5, 0.99) if self._error else 0.0
            shares.append(max(closed, reached) if begun == 1 else begun * reached)
        return min(max(shares), 1.0)

    def _remaining(self, fraction: float) -> float | None:
        """Remaining time in s: a mean of the estimate and of the actual pace, weighted by progress; None without both.

        The pace is measured since the first batch, and unknown if there has been no progress since.
        """
        if self._progress is None or fraction >= 1:
            return None
        now, limit, total = time.perf_counter(), self._progress.budget.time_limit, self._expected
        if self._first_batch is not None and self._first_batch[1] < fraction:
            pace = (now - self._first_batch[0]) / (fraction - self._first_batch[1])
            total = pace if total is None else fraction * pace + (1 - fraction) * total
        if total is None:
            return None
        remaining = (1 - fraction) * total
        return remaining if limit is None else max(min(remaining, self._begin + limit - now), 0.0)

    def _show(self, fraction: float | None = None) -> None:
        with self._drawing:
            if self._bar is None:
                self._bar = load_tqdm()(total=100.0, bar_format="{percentage:3.0f}%|{bar}| {elapsed}{postfix}")
                if not self._bar.disable:  # by the variable TQDM_DISABLE
                    self._bar.start_t -= time.perf_counter() - self._begin
            fraction = self._fraction() if fraction is None else fraction
            self._bar.n = 100 * fraction
            self._bar.set_postfix_str(", ".join(self._facts(fraction)), refresh=False)
            self._bar.refresh()

    def _facts(self, fraction: float) -> list[str]:
        """Texts next to the bar."""
        facts, remaining = [], self._remaining(fraction)
        if self._ending:
            facts.append("interrupted, ending" if compiling.since() is None else ENDING)
        elif time.perf_counter() - self._moved > DELAY and (text := compiling_text("scene", after=DELAY)):
            facts.append(text)
        elif remaining is not None:
            facts.append(f"{_duration(remaining)} left")
        if self._progress is not None and self._error is not None and self._error == self._error:
            scope = "" if (self._progress.done > 0).all() else " of finished tiles"
            facts.append(f"error {100 * self._error:.2g} %{scope}")
        return facts


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
