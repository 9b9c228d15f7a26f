"""Protocol between code that divides work into jobs and engines that run them; other engines are files beside this."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Generic, NamedTuple, Protocol, TypeVar

from plenoptic.core.parallel import run_in_order
from plenoptic.errors import PlenopticError


class EngineLostError(PlenopticError):
    """The workers of an engine are gone."""


class Job(Protocol):
    """A unit of work: a picklable value with its estimated cost."""

    @property
    def size(self) -> float:
        """Amount of work in any unit: a job of twice the size takes about twice as long."""

    @property
    def nbytes(self) -> int:
        """Approximate bytes of its input or output."""


JobT = TypeVar("JobT", bound=Job)
ResultT = TypeVar("ResultT")
IsCancelled = Callable[[], bool]


class JobResult(NamedTuple, Generic[JobT, ResultT]):
    """A finished job."""

    job: JobT
    result: ResultT
    seconds: float
    """Wall time."""
    remote_cpu_seconds: float
    """CPU time in other processes than this one."""


class Engine(Protocol[JobT, ResultT]):
    """Runs jobs, which are pure functions of their content, and returns results in any order."""

    @property
    def threads(self) -> int:
        """Number of jobs that run at a time."""

    def results(
        self, jobs: Iterable[JobT], *, n_jobs: int, is_cancelled: IsCancelled
    ) -> Iterator[JobResult[JobT, ResultT]]:
        """Run at most `n_jobs` jobs. Few are drawn from the iterable before their results are taken.

        Once the iterator is closed or `is_cancelled` returns True, no further job begins. EngineLostError without
        workers.
        """


class ThreadEngine(Generic[JobT, ResultT]):
    """Engine on the threads of this process; results are in the order of the jobs."""

    def __init__(self, function: Callable[[JobT, IsCancelled], ResultT], threads: int, *, ahead: int = 4) -> None:
        """`function` runs a job and may poll whether it is cancelled; `ahead`: see `run_in_order`."""
        self._function, self._ahead, self.threads = function, ahead, threads

    def results(
        self, jobs: Iterable[JobT], *, n_jobs: int, is_cancelled: IsCancelled
    ) -> Iterator[JobResult[JobT, ResultT]]:
        """See `Engine`."""

        def run(job: JobT) -> JobResult[JobT, ResultT]:
            begin = time.perf_counter()
            result = self._function(job, is_cancelled)
            return JobResult(job, result, time.perf_counter() - begin, 0.0)

        return run_in_order(run, jobs, threads=min(self.threads, n_jobs), ahead=self._ahead, is_cancelled=is_cancelled)
