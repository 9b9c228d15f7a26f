"""Kernels compiled side by side: the first ones here, the last ones by helpers, which are processes of their own.

Numba compiles one function at a time in a process. What will be called is found by a run without any data, in which
kernels that are not compiled yet note the types they are called with. Helpers compile from the end of that list and
write into the cache on disk; this process compiles what it comes to, and waits for what a helper has begun. Where
none can be started, or it dies, all is compiled here.
"""

from __future__ import annotations

import importlib
import inspect
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
from typing import Any

from numba.core.registry import CPUDispatcher

from plenoptic.core.parallel import check_wanted
from plenoptic.core.waiting.compiling import compiling
from plenoptic.core.waiting.deferring import interrupts_deferred

_MOST_HELPERS = 3
"""Each compiles again what several kernels have in common, and takes 200 MB."""

_FEWEST_KERNELS = 4
"""As many as a helper compiles in the time that it needs to start, and then some."""

_PATIENCE = 0.1
"""Seconds after which it is asked whether what a helper compiles is still wanted."""

_Task = tuple["Kernel", tuple[Any, ...]]


class _Tasks:
    """Kernels that nobody has begun, in the order of their use, and those that helpers have begun."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.waiting: dict[_Task, None] = {}
        self.begun: dict[_Task, threading.Event] = {}

    def claim(self, task: _Task) -> None:
        """Wait for a kernel if a helper has begun it; otherwise none will."""
        with self.lock:
            self.waiting.pop(task, None)
            begun = self.begun.get(task)
        if begun is not None:
            with compiling.noted(None):
                while not begun.wait(_PATIENCE):
                    check_wanted()

    def begin(self) -> _Task | None:
        """The last one that nobody has begun, for a helper."""
        with self.lock:
            task = self.waiting.popitem()[0] if self.waiting else None
            if task is not None:
                self.begun[task] = threading.Event()
            return task

    def end(self, task: _Task) -> None:
        """A helper has compiled it, or never will."""
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


class Kernel(CPUDispatcher):
    """A kernel that others may compile."""

    _cache: Any

    def _compile_for_args(self, *arguments: Any, **keywords: Any) -> Any:
        found: list[_Task] | None = getattr(_listing, "found", None)
        if found is None:
            return super()._compile_for_args(*arguments, **keywords)  # type: ignore[misc]
        task = self, tuple(self.typeof_pyval(argument) for argument in arguments)
        kept = getattr(self._cache, "has", None)  # absent where there is nowhere to write
        if kept is None or kept(task[1], self.targetctx):
            return super()._compile_for_args(*arguments, **keywords)  # type: ignore[misc]
        found.append(task)
        return lambda *_: 0

    def compile(self, signature: Any) -> Any:
        """Compile for types of arguments, or load what is compiled; GivenUp where nobody waits for it any longer."""
        check_wanted()
        _tasks.claim((self, signature))
        with interrupts_deferred():
            return super().compile(signature)


@contextmanager
def compiled_ahead(run: Callable[[], object], *, threads: int, shown: bool = False) -> Iterator[None]:
    """While it is entered, up to threads - 1 helpers compile kernels that `run`, a run without data, calls.

    `shown`: somebody is told how long that takes.
    """
    tasks = _listed(run) if shown or threads > 1 else []
    helpers: list[subprocess.Popen[bytes]] = []
    compiling.left = {kernel.py_func.__name__: _bytes_of(kernel, set()) for kernel, _ in tasks}
    if threads > 1 and len(tasks) >= _FEWEST_KERNELS:
        with _tasks.lock:
            _tasks.waiting |= dict.fromkeys(tasks)
        with suppress(OSError, ValueError):
            for _ in range(min(threads - 1, _MOST_HELPERS, len(tasks) // _FEWEST_KERNELS)):
                helpers.append(_started())
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


def _bytes_of(function: CPUDispatcher, known: set[CPUDispatcher]) -> int:
    """Length of the Python code of a function and of those that it calls, each once: compiling takes as long."""
    known.add(function)
    code, there = function.py_func.__code__, function.py_func.__globals__
    named = [there.get(name) for name in code.co_names]
    named += [getattr(module, name, None) for module in named if inspect.ismodule(module) for name in code.co_names]
    called = {one for one in named if isinstance(one, CPUDispatcher)} - known
    return len(code.co_code) + sum(_bytes_of(one, known) for one in called if one not in known)


def _listed(run: Callable[[], object]) -> list[_Task]:
    """Kernels that are neither loaded nor in the cache; where the run stumbles over its emptiness, the list ends."""
    found: list[_Task] = []
    _listing.found = found
    try:
        with warnings.catch_warnings(), suppress(Exception):
            warnings.simplefilter("ignore")
            run()
    finally:
        del _listing.found
    return list(dict.fromkeys(found))


def _started() -> subprocess.Popen[bytes]:
    """A helper; OSError where the program that runs is no Python interpreter that could be started again."""
    if getattr(sys, "frozen", False) or not Path(sys.executable or "").name.lower().startswith("python"):
        raise OSError("this program is not started by a Python interpreter")
    code = f"import sys; sys.path[:] = {sys.path!r}; from plenoptic.core.ahead import serve; serve()"
    pipe, nothing, hidden = subprocess.PIPE, subprocess.DEVNULL, getattr(subprocess, "CREATE_NO_WINDOW", 0)
    return subprocess.Popen([sys.executable, "-c", code], stdin=pipe, stdout=pipe, stderr=nothing, creationflags=hidden)


def _keep_busy(helper: subprocess.Popen[bytes]) -> None:
    """Give a helper one kernel after the other, until none is left or it dies."""
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
    """What a helper does: compile what it is told to, until nobody is left to tell."""
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
