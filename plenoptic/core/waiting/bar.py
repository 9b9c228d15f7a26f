"""Progress bar of calls that take longer than a second, with a note while kernels are compiled first.

A call that ends sooner shows nothing and does not load tqdm. Only calls of the main thread show something, and of those
that call each other the outermost one.
"""

from __future__ import annotations

import contextvars
import threading
import time
import warnings
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Any

from plenoptic.core.values import flag
from plenoptic.core.waiting.compiling import compiling, compiling_text

DELAY = 1.0
"""Seconds of silence."""
_INTERVAL = 0.5
"""Seconds between two looks."""

_here = threading.local()


def load_tqdm() -> Any:
    """`tqdm.auto.tqdm`. Notebooks without ipywidgets get its bar of text, which needs no warning."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "IProgress not found")
        from tqdm.auto import tqdm
    return tqdm


class Watch:
    """While it is entered, and from when something is compiled, a thread looks twice a second: nobody else can.

    The thread keeps the context of its maker, from which notebooks know where to show its output.
    """

    def __init__(self, look: Callable[[], None]) -> None:
        self._look = look
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._context = contextvars.copy_context()
        self._watched = compiling.watched(self._begin)

    def __enter__(self) -> Watch:
        self._watched.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._watched.__exit__(None, None, None)
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _begin(self) -> None:
        # It changes the filters of warnings meanwhile, and in a thread of its own would leave those of others behind.
        load_tqdm()
        if self._thread is None:
            self._thread = threading.Thread(target=self._context.run, args=(self._watch,), daemon=True)
            self._thread.start()

    def _watch(self) -> None:
        while not self._ended.wait(_INTERVAL):
            self._look()


class Waiting:
    """A bar of a call: ``with Waiting("projecting", kind="camera", show=progress):``; `run_in_order` tells it how far.

    `what` names the step, `kind` the kernels that it may compile.
    """

    def __init__(self, what: str, *, kind: str, show: bool) -> None:
        self._what, self._kind = what, kind
        self._show = flag(show, "progress") and threading.current_thread() is threading.main_thread()
        self._outermost = False
        self._bar: Any = None
        self._drawing = threading.Lock()
        self._done, self._total = 0, 1
        self._around = ExitStack()

    def __enter__(self) -> Waiting:
        self._begin = self._looked = self._step_begun = time.perf_counter()
        self._outermost = getattr(_here, "waiting", None) is None
        if self._outermost:
            _here.waiting = self
            if self._show:
                self._around.enter_context(Watch(self._look))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._outermost:
            _here.waiting = None
            self._around.close()
            if self._bar is not None:
                self._bar.close()

    def step(self, done: int, total: int) -> None:
        """Show the done parts of the present step of the work; of many short steps none is shown."""
        if not self._show:
            return
        now = time.perf_counter()
        if done == 1:
            self._step_begun = now
        if now - self._step_begun > _INTERVAL:
            self._done, self._total = done, max(total, done)
        if now - self._looked > _INTERVAL:
            self._look()

    def _look(self) -> None:
        """Show the present state."""
        self._looked = now = time.perf_counter()
        if now - self._begin < DELAY or not self._drawing.acquire(blocking=False):
            return
        try:
            if self._bar is None:
                form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}{postfix}"
                self._bar = load_tqdm()(desc=self._what, total=100.0, bar_format=form, leave=False)
                if not self._bar.disable:  # by the variable TQDM_DISABLE
                    self._bar.start_t -= now - self._begin
            self._bar.n = 100.0 * self._done / self._total
            self._bar.set_postfix_str(compiling_text(self._kind, after=DELAY), refresh=False)
            self._bar.refresh()
        finally:
            self._drawing.release()


def waiting_here() -> Waiting | None:
    """The call of this thread that shows how far it is, or would if it were to."""
    return getattr(_here, "waiting", None)
