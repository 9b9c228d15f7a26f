"""Compilation of kernels by several processes at once.

Numba compiles one function at a time in a process. A run without data lists the kernels that will be called: those that
are not compiled yet note the types of their arguments. Helper processes compile from the end of that list and write
into the cache on disk; this process compiles each kernel that it calls, and waits for one that a helper has begun.
Where no helper can be started, or one dies, this process compiles.
"""

from __future__ import annotations

import importlib
import os
import pickle
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from plenoptic.core.numba.deviations import deviations
from plenoptic.core.parallel import check_cancellation
from plenoptic.core.progress.compiling import compiling

if TYPE_CHECKING:
    from plenoptic.core.numba.dispatchers import KernelDispatcher

_MOST_HELPERS = 3
"""Most processes: each recompiles the functions that kernels share, and takes 200 MB."""

_FEWEST_KERNELS = 4
"""As many as a helper compiles in the time that it needs to start, and then some."""

_PATIENCE = 0.1
"""Seconds between two checks whether the kernel that a helper compiles is still needed."""

Task: TypeAlias = "tuple[KernelDispatcher, tuple[Any, ...]]"
"""A kernel and the types of its arguments."""


class _Tasks:
    """Kernels to be compiled: not begun by any process, in the order of their use, and begun by helpers."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.waiting: dict[Task, None] = {}
        self.begun: dict[Task, threading.Event] = {}

    def claim(self, task: Task) -> None:
        """Wait for a kernel if a helper has begun it; otherwise none will."""
        with self.lock:
            self.waiting.pop(task, None)
            begun = self.begun.get(task)
        if begun is not None:
            with compiling.track(None):
                while not begun.wait(_PATIENCE):
                    check_cancellation()

    def begin(self) -> Task | None:
        """Take the last kernel that no process has begun, for a helper."""
        with self.lock:
            task = self.waiting.popitem()[0] if self.waiting else None
            if task is not None:
                self.begun[task] = threading.Event()
            return task

    def end(self, task: Task) -> None:
        """Mark a helper's kernel as compiled, or as given up."""
        with self.lock:
            self.begun.pop(task).set()
        compiling.left.pop(task[0].py_func.__name__, None)


_tasks, _listing = _Tasks(), threading.local()


def _forget() -> None:
    """A forked process has no helpers."""
    global _tasks  # noqa: PLW0603
    _tasks = _Tasks()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def listed_tasks() -> list[Task] | None:
    """The list of a run without data, in this thread; None outside of such a run."""
    return getattr(_listing, "tasks", None)


def claim(task: Task) -> None:
    """Wait for a kernel if a helper compiles it; otherwise no helper will begin it."""
    _tasks.claim(task)


@contextmanager
def compile_in_parallel(run: Callable[[], object], *, threads: int, shown: bool = False) -> Iterator[None]:
    """Context manager in which up to threads - 1 helpers compile the kernels that `run` calls.

    `run` renders no pixel. `shown`: a bar shows the time left.
    """
    in_parallel = (shown or threads > 1) and "helper_processes" in deviations()
    tasks = _list_tasks(run) if in_parallel else []
    if not tasks:
        yield
        return
    from plenoptic.core.numba.code_digest import bytecode_size  # they import Numba
    from plenoptic.core.numba.kernel_cache import writable_folder

    helpers: list[subprocess.Popen[bytes]] = []
    compiling.left = {kernel.py_func.__name__: bytecode_size(kernel.py_func) for kernel, _ in tasks}
    if threads > 1 and len(tasks) >= _FEWEST_KERNELS and writable_folder() is not None:
        with _tasks.lock:
            _tasks.waiting |= dict.fromkeys(tasks)
        with suppress(OSError, ValueError):
            for _ in range(min(threads - 1, _MOST_HELPERS, len(tasks) // _FEWEST_KERNELS)):
                helpers.append(_start_helper())
                threading.Thread(target=_keep_busy, args=(helpers[-1],), daemon=True).start()
    compiling.workers = 1 + len(helpers)
    try:
        yield
    finally:
        compiling.left, compiling.workers = {}, 1
        with _tasks.lock:
            for task in tasks:
                _tasks.waiting.pop(task, None)
        for helper in helpers:
            helper.kill()


def _list_tasks(run: Callable[[], object]) -> list[Task]:
    """Kernels that are neither loaded nor in the cache; the list ends where the run fails for lack of data."""
    tasks: list[Task] = []
    _listing.tasks = tasks
    try:
        with warnings.catch_warnings(), suppress(Exception):
            warnings.simplefilter("ignore")
            run()
    finally:
        del _listing.tasks
    return list(dict.fromkeys(tasks))


def _start_helper() -> subprocess.Popen[bytes]:
    """Start a helper; OSError where the running program is no Python interpreter."""
    if getattr(sys, "frozen", False) or not Path(sys.executable or "").name.lower().startswith("python"):
        raise OSError("this program is not started by a Python interpreter")
    code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve()"
    pipe, nothing, hidden = subprocess.PIPE, subprocess.DEVNULL, getattr(subprocess, "CREATE_NO_WINDOW", 0)
    return subprocess.Popen([sys.executable, "-c", code], stdin=pipe, stdout=pipe, stderr=nothing, creationflags=hidden)


def _keep_busy(helper: subprocess.Popen[bytes]) -> None:
    """Send a helper one kernel after the other, until none is left or it dies."""
    assert helper.stdin is not None and helper.stdout is not None
    tasks, alive = _tasks, True
    while alive and (task := tasks.begin()) is not None:
        kernel, types = task
        try:
            function = kernel.py_func
            pickle.dump((function.__module__, function.__name__, types), helper.stdin)
            helper.stdin.flush()
            alive = bool(helper.stdout.readline())
        except (OSError, ValueError, pickle.PicklingError):
            alive = False
        finally:
            tasks.end(task)
    with suppress(OSError):
        helper.stdin.close()
    helper.wait()
    helper.stdout.close()


def serve() -> None:
    """Compile the kernels that the parent process names, until its pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's Ctrl-C goes to all processes; the parent decides
    while True:
        try:
            module, name, types = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        with suppress(Exception):
            getattr(importlib.import_module(module), name).compile(types)
        sys.stdout.buffer.write(b"\n")
        sys.stdout.buffer.flush()
