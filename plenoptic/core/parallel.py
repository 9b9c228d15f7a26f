"""One way to spread work over threads: tracing and rendering both use it."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from plenoptic.core.values import whole

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


def run_in_order(
    function: Callable[[_Task], _Result], tasks: Iterable[_Task], *, threads: int, ahead: int = 4
) -> Iterator[_Result]:
    """Results of `function` for all tasks, in their order, computed by a number of threads.

    Only `ahead` tasks for each thread are taken before their results are, however many tasks there are. The first
    exception ends the iteration; tasks that have not begun then never begin.
    """
    if threads <= 1:
        yield from map(function, tasks)
        return
    with ThreadPoolExecutor(max_workers=threads) as pool:
        waiting: deque[Future[_Result]] = deque()
        try:
            for task in tasks:
                waiting.append(pool.submit(function, task))
                if len(waiting) >= ahead * threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()
