"""Ctrl-C while something is compiled: heard at once, and obeyed when it is ready."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from plenoptic.core.waiting.compiling import compiling


@contextmanager
def interrupts_deferred() -> Iterator[None]:
    """While it is entered, Ctrl-C is noted; KeyboardInterrupt follows at its end.

    Raised at once it would be lost where the compiler calls back to Python, and all would go on. Only the main thread
    hears of Ctrl-C, and handlers of others' stay.
    """
    default = signal.default_int_handler
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGINT) is not default:
        yield
        return

    def note(number: int, frame: FrameType | None) -> None:
        compiling.interrupted = True

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, default)
        interrupted, compiling.interrupted = compiling.interrupted, False
    if interrupted:
        raise KeyboardInterrupt
