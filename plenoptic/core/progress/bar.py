"""Progress bar of calls that take longer than a second, which also shows whether something is compiled first.

A shorter call shows nothing and does not load tqdm. Only calls of the main thread show a bar, and of nested calls the
outermost one.
"""

from __future__ import annotations

import contextvars
import functools
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Any

from plenoptic.core.progress.compiling import compiling, compiling_text
from plenoptic.core.values import flag

DELAY = 1.0
"""Seconds before a bar appears."""
_INTERVAL = 0.5
"""Seconds between two updates."""

_thread_state = threading.local()


class _CellLine:
    """File that shows the last line written to it as one output of a notebook's cell, which a page keeps once.

    Notebooks and pages made from them keep all that the standard error stream gets, in red, one line an update.
    """

    encoding = "utf-8"

    def __init__(self) -> None:
        self._handle: Any = None

    def write(self, text: str) -> None:
        """Show a line that begins with a carriage return in place of the one before; an empty one clears it."""
        if "\r" not in text:
            return
        if self._handle is None:
            from IPython.display import DisplayHandle

            self._handle = DisplayHandle()
            self._handle.display({"text/plain": text.strip()}, raw=True)
        else:
            self._handle.update({"text/plain": text.strip()}, raw=True)


def terminal_size() -> os.terminal_size | None:
    """Columns and rows of the terminal that shows the standard error stream; None if a file or a pipe takes it."""
    is_terminal = sys.stderr is not None and sys.stderr.isatty()
    return os.get_terminal_size(sys.stderr.fileno()) if is_terminal else None


def load_tqdm(*, show: bool = True) -> Any:
    """`tqdm.auto.tqdm`; in notebooks without ipywidgets its text bar, as one output of the cell.

    It shows nothing outside of terminals and notebooks. In terminals that do not know their size, where it would print
    nothing either, it has 80 columns.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "IProgress not found")
        from tqdm.auto import tqdm
    in_notebook, size = "ipykernel.zmqshell" in sys.modules, terminal_size()
    if not show or (size is None and not in_notebook):
        return functools.partial(tqdm, disable=True)
    if in_notebook and all(base.__module__ != "tqdm.notebook" for base in tqdm.__mro__):
        return functools.partial(tqdm, file=_CellLine())
    return functools.partial(tqdm, ncols=80, nrows=24) if size is not None and 0 in size else tqdm


class Poller:
    """Context manager that polls twice a second, from a thread, once compilation has begun.

    The thread keeps the context of its creator, by which notebooks know the cell to print to.
    """

    def __init__(self, poll: Callable[[], None]) -> None:
        self._poll = poll
        self._has_ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._context = contextvars.copy_context()
        self._subscription = compiling.call_on_begin(self._begin)

    def __enter__(self) -> Poller:
        self._subscription.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._subscription.__exit__(None, None, None)
        self._has_ended.set()
        if self._thread is not None:
            self._thread.join()

    def _begin(self) -> None:
        # Loading changes the warning filters, which a thread of its own would restore at the wrong time.
        load_tqdm()
        if self._thread is None:
            self._thread = threading.Thread(target=self._context.run, args=(self._run,), daemon=True)
            self._thread.start()

    def _run(self) -> None:
        while not self._has_ended.wait(_INTERVAL):
            self._poll()


class CallProgress:
    """Progress bar of a call: ``with CallProgress("projecting", kind="camera", show=progress):``.

    `run_in_order` advances it. `what` is the action shown; `kind` is the object in "first time for this kind of ...".
    """

    def __init__(self, what: str, *, kind: str, show: bool) -> None:
        self._what, self._kind = what, kind
        self._show = flag(show, "progress") and threading.current_thread() is threading.main_thread()
        self._is_outermost = False
        self._bar: Any = None
        self._update_lock = threading.Lock()
        self._n_done, self._total = 0, 1
        self._stack = ExitStack()

    def __enter__(self) -> CallProgress:
        self._begin = self._last_update = self._step_begin = time.perf_counter()
        self._is_outermost = current_progress() is None
        if self._is_outermost:
            _thread_state.progress = self
            if self._show:
                self._stack.enter_context(Poller(self._update))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._is_outermost:
            _thread_state.progress = None
            self._stack.close()
            if self._bar is not None:
                self._bar.close()

    def step(self, n_done: int, total: int) -> None:
        """Set the number of finished parts of the present step of the work; short steps are not shown."""
        if not self._show:
            return
        now = time.perf_counter()
        if n_done == 1:
            self._step_begin = now
        if now - self._step_begin > _INTERVAL:
            self._n_done, self._total = n_done, max(total, n_done)
        if now - self._last_update > _INTERVAL:
            self._update()

    def _update(self) -> None:
        """Draw the bar."""
        self._last_update = now = time.perf_counter()
        if now - self._begin < DELAY or not self._update_lock.acquire(blocking=False):
            return
        try:
            if self._bar is None:
                form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}{postfix}"
                self._bar = load_tqdm()(desc=self._what, total=100.0, bar_format=form, leave=False)
                if not self._bar.disable:  # by the variable TQDM_DISABLE
                    self._bar.start_t -= now - self._begin
            self._bar.n = 100.0 * self._n_done / self._total
            self._bar.set_postfix_str(compiling_text(self._kind, after=DELAY), refresh=False)
            self._bar.refresh()
        finally:
            self._update_lock.release()


def current_progress() -> CallProgress | None:
    """The bar of this thread's outermost call, which may be hidden; None outside of such calls."""
    return getattr(_thread_state, "progress", None)
