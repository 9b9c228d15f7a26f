import os

import pytest

from plenoptic.core.parallel import MOST_THREADS, run_in_order, thread_count
from plenoptic.errors import InvalidValueError


def test_numba_num_threads_is_the_most_that_is_taken_unasked(monkeypatch):
    # It was ignored: on a shared machine every process took all processors.
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    assert thread_count(None) == 8
    for given, taken in (("3", 3), ("64", 8), ("1", 1), ("many", 8), ("", 8), ("0", 1)):
        monkeypatch.setenv("NUMBA_NUM_THREADS", given)
        assert thread_count(None) == taken
    assert thread_count(5) == 5
    with pytest.raises(InvalidValueError, match=f"threads is {MOST_THREADS + 1}; it must be at most {MOST_THREADS}"):
        thread_count(MOST_THREADS + 1)


def test_results_come_in_the_order_of_their_tasks():
    assert list(run_in_order(lambda task: -task, range(100), threads=3)) == [-task for task in range(100)]
