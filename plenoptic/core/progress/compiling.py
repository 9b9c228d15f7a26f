"""State of the compilation of kernels, for progress bars; it needs no Numba, and the compiler updates it.

There is no lock, since a process forked off while it is held would wait for ever. Updates are single operations on
dictionaries, and the state shown may be slightly outdated.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_PACE = 2.2e-4
"""Seconds for each byte of Python's bytecode, on an idle core of a server. Times of a render's kernels, from which it
was measured, have a correlation of 0.91 with their bytes."""
_PRIOR_BYTES = 5000.0
"""Weight of that pace: after as many compiled bytes, the measured pace counts as much."""
_FEW = 5.0
"""Seconds below which they are shown as a few."""
_PAUSE = 0.5
"""Seconds without compilation after which the next one counts as a new beginning."""


class Compiling:
    """State of compilation in this process: compiling threads, and the code that remains."""

    def __init__(self) -> None:
        self._active: dict[int, float] = {}
        self._begin = self._end = 0.0
        self._callbacks: dict[int, Callable[[], None]] = {}
        self.names: list[str] = []
        """Names of the kernels compiled in this process, in order."""
        self._seconds, self._bytes = _PACE * _PRIOR_BYTES * _busy(), _PRIOR_BYTES
        self._current: tuple[str, float] | None = None
        """The kernel that this process compiles, and the time at which it began."""
        self.left: dict[str, int] = {}
        """Kernels that are needed and not compiled yet, with the bytes of their bytecode."""
        self._shown = math.inf
        """Seconds left that were shown last."""
        self.interrupted = False
        """True after Ctrl-C, until it takes effect at the end of the present kernel."""
        self.workers = 1
        """Number of processes that compile them."""

    @contextmanager
    def track(self, name: str | None) -> Iterator[None]:
        """Context manager of the compilation of a kernel, or of waiting for a helper (None); nested ones do nothing."""
        thread, now = threading.get_ident(), time.perf_counter()
        if thread in self._active:
            yield
            return
        if not self._active and now - self._end > _PAUSE:
            self._begin, self._shown = now, math.inf
        self._active[thread] = now
        self._current = None if name is None else (name, now)
        for callback in list(self._callbacks.values()):
            callback()
        try:
            yield
        finally:
            self._active.pop(thread, None)
            self._end = time.perf_counter()
            if name is not None:
                self.names.append(name)
                self._current = None
                if size := self.left.pop(name, 0):
                    self._seconds, self._bytes = self._seconds + self._end - now, self._bytes + size

    @contextmanager
    def call_on_begin(self, callback: Callable[[], None]) -> Iterator[None]:
        """Context manager in which `callback` is called whenever a thread begins to compile, in that thread."""
        key = id(callback)
        self._callbacks[key] = callback
        try:
            yield
        finally:
            del self._callbacks[key]

    def since(self) -> float | None:
        """Time at which compilation began, on the clock of `time.perf_counter`; None if nothing is being compiled."""
        return self._begin if self._active else None

    def seconds_left(self) -> float | None:
        """Estimated seconds until all kernels are compiled, at the pace so far; None if unknown.

        It does not grow while a user waits: a kernel that takes longer than its code lets expect holds it up.
        """
        left, current = dict(self.left), self._current
        if not left:
            self._shown = math.inf
            return None
        seconds, size, done_bytes = self._seconds, self._bytes, 0.0
        if current is not None and (current_bytes := left.get(current[0])):
            elapsed = time.perf_counter() - current[1]
            done_bytes = min(elapsed * size / seconds, current_bytes)
            if done_bytes >= current_bytes:
                seconds, size = seconds + elapsed, size + current_bytes
        self._shown = min(self._shown, (sum(left.values()) - done_bytes) * seconds / (size * self.workers))
        return self._shown


def _busy() -> float:
    """Programs that want to run for each processor, at least 1; 1 where the system does not say."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    return max(load / (os.cpu_count() or 1), 1.0)


ENDING = "interrupted, ending in a few seconds, when what is being compiled is ready"

compiling = Compiling()
"""State of this process."""

if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=compiling.__init__)  # type: ignore[misc]


def compiling_text(kind: str, *, after: float) -> str:
    """Text for a bar while something is compiled, with the time left; empty for the first `after` seconds.

    `kind` is the object in "first time for this kind of ...".
    """
    since = compiling.since()
    if compiling.interrupted:
        return ENDING
    if since is None or time.perf_counter() - since < after:
        return ""
    text, left = f"compiling, first time for this kind of {kind}", compiling.seconds_left()
    if left is None:
        return text
    return f"{text}, {'a few seconds' if left < _FEW else f'about {5 * math.ceil(left / 5)} s'}"
