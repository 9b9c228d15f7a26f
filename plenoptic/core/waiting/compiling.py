"""Register of present compilations, for progress bars; it needs no Numba: the compiler reports to it.

There is no lock, for which a process that is forked off meanwhile would wait for ever: steps are single operations on
dictionaries, and the display may be a moment old.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_PACE = 1.7e-4
"""Seconds for each byte of Python's code, on one core of a server that does nothing else: kernels of a render were
measured, whose times have a correlation of 0.91 with their bytes."""
_BELIEVED = 5000.0
"""Bytes after which what is measured counts as much as that."""
_FEW = 10.0
"""Seconds that are a few: where it is not known what there is to be compiled, it takes as long, or something is odd."""
_PAUSE = 0.5
"""Seconds without compiling after which it begins anew."""


class Compiling:
    """Threads that compile, or wait for a helper that does, and the number of kernels to be compiled."""

    def __init__(self) -> None:
        self._active: dict[int, float] = {}
        self._begin = self._end = 0.0
        self._watchers: dict[int, Callable[[], None]] = {}
        self.names: list[str] = []
        """Of the kernels that have been compiled in this process, in order."""
        self._seconds, self._bytes = _PACE * _BELIEVED, _BELIEVED
        self._now: tuple[str, float] | None = None
        """The kernel that this process compiles, and since when."""
        self.left: dict[str, int] = {}
        """Kernels that are known to be needed and are not compiled yet, with the bytes of their code."""
        self.interrupted = False
        """Whether Ctrl-C was heard, and is obeyed when the present kernel is ready."""
        self.workers = 1
        """Processes that compile them."""

    @contextmanager
    def noted(self, name: str | None) -> Iterator[None]:
        """Context manager of a thread that compiles a kernel; None: it waits for one. Nested ones do not count."""
        thread, now = threading.get_ident(), time.perf_counter()
        if thread in self._active:
            yield
            return
        if not self._active and now - self._end > _PAUSE:
            self._begin = now
        self._active[thread] = now
        self._now = None if name is None else (name, now)
        for begins in list(self._watchers.values()):
            begins()
        try:
            yield
        finally:
            self._active.pop(thread, None)
            self._end = time.perf_counter()
            if name is not None:
                self.names.append(name)
                self._now = None
                if size := self.left.pop(name, 0):
                    self._seconds, self._bytes = self._seconds + self._end - now, self._bytes + size

    @contextmanager
    def watched(self, begins: Callable[[], None]) -> Iterator[None]:
        """While it is entered, `begins` is called whenever a thread begins to compile, in that thread."""
        key = id(begins)
        self._watchers[key] = begins
        try:
            yield
        finally:
            del self._watchers[key]

    def since(self) -> float | None:
        """Time at which compilation began, on the clock; None while nothing is compiled."""
        return self._begin if self._active else None

    def seconds_left(self) -> float | None:
        """About how long it takes still, at the pace until now; None where it is not known."""
        left, current = dict(self.left), self._now
        if not left:
            return None
        seconds, size, done = self._seconds, self._bytes, 0.0
        if current is not None and (own := left.get(current[0])):
            running = time.perf_counter() - current[1]
            done = min(running * size / seconds, own)
            seconds, size = (seconds, size) if done < own else (seconds + running, size + own)
        return (sum(left.values()) - done) * seconds / (size * self.workers)


ENDING = "interrupted, ending in a few seconds, when what is being compiled is ready"

compiling = Compiling()
"""Of this process."""

if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=compiling.__init__)  # type: ignore[misc]


def compiling_text(kind: str, *, after: float) -> str:
    """Text shown while something is compiled, with the elapsed time; empty in the first seconds.

    `kind`: of the kernels compiled for the first time. `after`: so many seconds.
    """
    since = compiling.since()
    if compiling.interrupted:
        return ENDING
    if since is None or time.perf_counter() - since < after:
        return ""
    text, left = f"compiling, first time for this kind of {kind}", compiling.seconds_left()
    if left is None:
        return f"{text}, a few seconds" if time.perf_counter() - since < _FEW else text
    return f"{text}, {_about(left)}"


def _about(seconds: float) -> str:
    """A duration as exactly as it is known."""
    if seconds < _FEW / 2:
        return "a few seconds"
    return f"about {5 * round(seconds / 5)} s"
