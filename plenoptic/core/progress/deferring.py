"""Ctrl-C during compilation: noted at once, raised when the kernel is ready."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from plenoptic.core.progress.compiling import compiling


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Context manager in which Ctrl-C is noted; KeyboardInterrupt is raised at its end.

    Raised at once it would be lost in the compiler's callbacks to Python, and the program would go on. Only the main
    thread receives Ctrl-C, and handlers installed by others stay.
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
