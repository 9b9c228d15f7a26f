"""Ctrl-C: the first one ends a render gracefully, the second one ends the program."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any


class Interrupts:
    """Context manager: the first SIGINT sets `asked`, further ones call the previous handler.

    Signals reach the main thread only. In other threads, or if Python does not handle SIGINT, nothing changes.
    """

    def __init__(self, on_first: Callable[[], None] = lambda: None) -> None:
        """`on_first` is called at the first SIGINT."""
        self.asked = False
        self._on_first = on_first
        self._previous_handler: Any = None

    def __enter__(self) -> Interrupts:
        handler = signal.getsignal(signal.SIGINT)
        if threading.current_thread() is threading.main_thread() and callable(handler):
            self._previous_handler = handler
            signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._previous_handler is not None:
            signal.signal(signal.SIGINT, self._previous_handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            self._previous_handler(number, frame)
            return
        self.asked = True
        self._on_first()
