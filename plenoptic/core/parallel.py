"""One way to spread work over threads: tracing and rendering both use it."""

from __future__ import annotations

import operator
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from plenoptic.core.values import whole
from plenoptic.core.waiting.bar import waiting_here

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


MOST_THREADS = 4096
"""Threads that a system starts without further ado; processors have fewer."""


def thread_count(threads: int | None) -> int:
    """The number of threads asked for; None: one a processor that this process may use, at most NUMBA_NUM_THREADS."""
    if threads is not None:
        return whole(threads, "threads", at_least=1, at_most=MOST_THREADS)
    affinity = getattr(os, "sched_getaffinity", None)
    there = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    chosen = os.environ.get("NUMBA_NUM_THREADS", "")
    return min(there, max(int(chosen), 1)) if chosen.isdecimal() else there


class GivenUp(Exception):  # noqa: N818
    """Raised where work can be ended whose result is no longer wanted: before a kernel is compiled."""


_here = threading.local()


def check_wanted() -> None:
    """Raise GivenUp where the result of this thread's work for `run_in_order` is no longer wanted."""
    given_up: Callable[[], bool] | None = getattr(_here, "given_up", None)
    if given_up is not None and given_up():
        raise GivenUp


def run_in_order(
    function: Callable[[_Task], _Result],
    tasks: Iterable[_Task],
    *,
    threads: int,
    ahead: int = 4,
    given_up: Callable[[], bool] = lambda: False,
) -> Iterator[_Result]:
    """Results of `function` for all tasks, in their order, computed by a number of threads.

    Only `ahead` tasks for each thread are taken before their results are, however many tasks there are. The first
    exception ends the iteration; tasks that have not begun then never begin, and those that have may raise GivenUp, as
    they may where `given_up` says so.
    """
    ended, waiting, total = threading.Event(), waiting_here(), operator.length_hint(tasks)

    def work(task: _Task) -> _Result:
        before = getattr(_here, "given_up", None)
        _here.given_up = lambda: ended.is_set() or given_up() or (before is not None and before())
        try:
            return function(task)
        finally:
            _here.given_up = before

    results = map(work, tasks) if threads <= 1 else _results_of_threads(work, tasks, threads, ahead, ended)
    for done, result in enumerate(results, start=1):
        if waiting is not None:
            waiting.step(done, total)
        yield result


def _results_of_threads(
    work: Callable[[_Task], _Result], tasks: Iterable[_Task], threads: int, ahead: int, ended: threading.Event
) -> Iterator[_Result]:
    with ThreadPoolExecutor(max_workers=threads) as pool:
        waiting: deque[Future[_Result]] = deque()
        try:
            for task in tasks:
                waiting.append(pool.submit(work, task))
                if len(waiting) >= ahead * threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            ended.set()
            for future in waiting:
                future.cancel()
