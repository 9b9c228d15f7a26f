"""Distribution of work over threads, for tracing and rendering."""

from __future__ import annotations

import operator
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from plenoptic.core.progress.bar import current_progress
from plenoptic.core.values import whole
from plenoptic.errors import InvalidValueError

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


MAX_THREADS = 4096
"""Threads that an operating system starts without special settings; processors have fewer."""


def thread_count(threads: int | None) -> int:
    """Number of threads; None: the processors available to this process, at most NUMBA_NUM_THREADS."""
    if threads is not None:
        return whole(threads, "threads", at_least=1, at_most=MAX_THREADS)
    affinity = getattr(os, "sched_getaffinity", None)
    available = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    limit = os.environ.get("NUMBA_NUM_THREADS", "")
    if limit.lstrip("-").isdecimal() and int(limit) < 1:
        raise InvalidValueError(f"NUMBA_NUM_THREADS is {limit} in the environment; set it to 1 or more, or remove it")
    return min(available, int(limit)) if limit.isdecimal() else available


class Cancelled(Exception):  # noqa: N818
    """Raised before a kernel is compiled for work that is cancelled."""


_thread_state = threading.local()


def check_cancellation() -> None:
    """Raise Cancelled if the work that this thread does for `run_in_order` is cancelled."""
    is_cancelled: Callable[[], bool] | None = getattr(_thread_state, "is_cancelled", None)
    if is_cancelled is not None and is_cancelled():
        raise Cancelled


def run_in_order(
    function: Callable[[_Task], _Result],
    tasks: Iterable[_Task],
    *,
    threads: int,
    ahead: int = 4,
    is_cancelled: Callable[[], bool] = lambda: False,
) -> Iterator[_Result]:
    """Results of `function` for all tasks, in their order, computed by a number of threads.

    At most `ahead` tasks for each thread are submitted before their results are taken. The first exception ends the
    iteration: tasks that have not begun are dropped, and running ones may raise Cancelled, as they may once
    `is_cancelled` returns True.
    """
    has_ended, progress, total = threading.Event(), current_progress(), operator.length_hint(tasks)

    def work(task: _Task) -> _Result:
        outer = getattr(_thread_state, "is_cancelled", None)
        _thread_state.is_cancelled = lambda: has_ended.is_set() or is_cancelled() or (outer is not None and outer())
        try:
            return function(task)
        finally:
            _thread_state.is_cancelled = outer

    results = map(work, tasks) if threads <= 1 else _results_of_threads(work, tasks, threads, ahead, has_ended)
    for n_done, result in enumerate(results, start=1):
        if progress is not None:
            progress.step(n_done, total)
        yield result


def _results_of_threads(
    work: Callable[[_Task], _Result], tasks: Iterable[_Task], threads: int, ahead: int, has_ended: threading.Event
) -> Iterator[_Result]:
    with ThreadPoolExecutor(max_workers=threads) as pool:
        futures: deque[Future[_Result]] = deque()
        try:
            for task in tasks:
                futures.append(pool.submit(work, task))
                if len(futures) >= ahead * threads:
                    yield futures.popleft().result()
            while futures:
                yield futures.popleft().result()
        finally:
            has_ended.set()
            for future in futures:
                future.cancel()
