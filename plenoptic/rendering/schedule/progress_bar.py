"""The bar that shows how far a render is, how long it will take, and its error."""

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
"""The error is found anew after this many times the time that finding it took, so that it takes 2 % at most."""


class ProgressBar:
    """Shown with tqdm, in terminals and notebooks. Its position is that of the nearest end: samples, time or error.

    It is entered before anything is prepared, shows itself from `start` on, or sooner where something is compiled for a
    second, and vanishes where an error is raised.
    """

    def __init__(self, begin: float, *, show: bool) -> None:
        self._begin, self._watch = begin, Poller(self._look) if show else None
        self._progress: Progress | None = None
        self._error: float | None = None
        self._from: tuple[float, float] | None = None
        """When the first batch was there, after all compiling, and the share that was done then."""
        self._expected: float | None = None
        """Seconds that the whole was to take, by an estimate."""
        self._shown = self._measured = self._moved = time.perf_counter()
        self._took = 0.0
        self._ending = False
        self._bar: Any = None
        self._drawing = threading.RLock()
        """Held by whoever draws: the render, the watch, and within these what hears Ctrl-C."""

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
        """Show that rendering begins, with the estimated seconds where there are some."""
        self._progress, self._expected = progress, expected
        if self._watch is not None:
            self._show()

    def update(self) -> None:
        """Show the present state, twice a second at most."""
        now = self._moved = time.perf_counter()
        if self._bar is None or self._progress is None:
            return
        if self._from is None:
            self._from = (now, self._share())
        if now - self._shown < _INTERVAL:
            return
        self._shown = now
        if now - self._measured > max(_INTERVAL, _SHARE * self._took):
            self._error = self._progress.error()
            self._took, self._measured = time.perf_counter() - now, now
        self._show()

    def end(self) -> None:
        """Show that unfinished tiles are completed after Ctrl-C."""
        self._ending = True
        if self._bar is not None:
            self._show()

    def close(self, *, finished: bool) -> None:
        """Show the end."""
        if self._bar is None or self._progress is None:
            return
        self._error = self._progress.error()
        self._show(1.0 if finished else None)

    def _look(self) -> None:
        """Poll from a thread while something is compiled, and after that."""
        if self._bar is not None or time.perf_counter() - self._begin > DELAY:
            self._show()

    def _share(self) -> float:
        """Finished part of the work, by the limit that will be reached first."""
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

    def _left(self, share: float) -> float | None:
        """Remaining seconds by the estimate and, increasingly, by the pace; None without both.

        The pace is that since the first batch, and None where nothing has been gained since.
        """
        if self._progress is None or share >= 1:
            return None
        now, limit, whole = time.perf_counter(), self._progress.budget.time_limit, self._expected
        if self._from is not None and self._from[1] < share:
            pace = (now - self._from[0]) / (share - self._from[1])
            whole = pace if whole is None else share * pace + (1 - share) * whole
        if whole is None:
            return None
        left = (1 - share) * whole
        return left if limit is None else max(min(left, self._begin + limit - now), 0.0)

    def _show(self, share: float | None = None) -> None:
        with self._drawing:
            if self._bar is None:
                self._bar = load_tqdm()(total=100.0, bar_format="{percentage:3.0f}%|{bar}| {elapsed}{postfix}")
                if not self._bar.disable:  # by the variable TQDM_DISABLE
                    self._bar.start_t -= time.perf_counter() - self._begin
            share = self._share() if share is None else share
            self._bar.n = 100 * share
            self._bar.set_postfix_str(", ".join(self._facts(share)), refresh=False)
            self._bar.refresh()

    def _facts(self, share: float) -> list[str]:
        """Texts beside the bar."""
        facts, left = [], self._left(share)
        if self._ending:
            facts.append("interrupted, ending" if compiling.since() is None else ENDING)
        elif time.perf_counter() - self._moved > DELAY and (text := compiling_text("scene", after=DELAY)):
            facts.append(text)
        elif left is not None:
            facts.append(f"{_duration(left)} left")
        if self._progress is not None and self._error is not None and self._error == self._error:
            partly = "" if (self._progress.done > 0).all() else " of what is there"
            facts.append(f"error {100 * self._error:.2g} %{partly}")
        return facts


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
