"""Jobs on the workers of a dask cluster, grouped into tasks by the time of earlier jobs.

Nothing of dask is imported: the client brings all functions that are called. Tasks are pure, and their shared state is
a task too, so that dask repeats all tasks lost with a worker.
"""

from __future__ import annotations

import hashlib
import math
import pickle
import queue
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Generic
from urllib.parse import urlsplit

from plenoptic import __version__
from plenoptic.core.engines.dask_worker import (
    PROCESSOR,
    Make,
    SharedState,
    TaskResult,
    check_environment,
    environment,
    prepare_worker,
    run_jobs,
)
from plenoptic.core.engines.engine import EngineLostError, IsCancelled, JobResult, JobT, ResultT
from plenoptic.core.progress.bar import current_progress
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError

_SECONDS = 20.0
"""Target duration of a task, whose work is lost if its worker dies."""
_MAX_BYTES = 1 << 23
"""Limit of the input and output of a task: dask advises against more."""
_AHEAD, _AHEAD_TIMED = 4, 2
"""Tasks submitted for each thread of a worker before their results are taken; the second under a time limit."""
_FRACTION = 2
"""A task has at most 1 / _FRACTION of each thread's part of the remaining jobs, so that all threads end together."""
_HANDLING = 4e-3
"""Overhead of client and scheduler in s for each task; tasks shorter than this times the threads would queue."""
_RETRIES = 3
"""Retries of a task that raises an error, on any worker. Deaths of workers are counted by dask's
`distributed.scheduler.allowed-failures`, which is 3 as well."""
_PATIENCE = 0.1
"""Seconds between two checks whether the work is cancelled."""
_CLIENT_METHODS = ("submit", "run", "nthreads")


class DaskCluster:
    """The workers of a client; all have the environment of this process."""

    def __init__(self, client: Any) -> None:
        """InvalidValueError if it is no client, has no workers, or workers would render other bits."""
        if not all(callable(getattr(client, name, None)) for name in _CLIENT_METHODS) or getattr(
            client, "asynchronous", False
        ):
            raise InvalidValueError(
                f"client is a {type(client).__name__}; it must be a distributed.Client that is not asynchronous"
            )
        self.client, self.environment = client, environment()
        workers = _environments(client)
        if not workers:
            raise InvalidValueError("client has no workers; start some, or wait with client.wait_for_workers(1)")
        for address, theirs in workers.items():
            check_environment(theirs, self.environment, f"the worker {address}")
        self.processors: tuple[str, ...] = tuple(dict.fromkeys(theirs[PROCESSOR] for theirs in workers.values()))
        """Kinds of processors that workers have."""
        self._warn_of_processors()

    @property
    def threads(self) -> int:
        """Threads of all workers at present."""
        return max(sum(map(int, self.client.nthreads().values())), 1)

    @contextmanager
    def engine(
        self, make: Make, content: Any, *, out_of_time: IsCancelled | None = None
    ) -> Iterator[DaskEngine[Any, Any]]:
        """Engine that runs jobs with a shared state; `out_of_time`: True once a time limit has passed, None without.

        One worker of each host prepares first: it compiles, and the others load its compiled code from the disk.
        """
        with lost_client(self.client):
            state = self._prepared_state(make, content, out_of_time)
        yield DaskEngine(self, state, out_of_time)

    def _prepared_state(self, make: Make, content: Any, out_of_time: IsCancelled | None) -> Any:
        """The shared state on the cluster, for which one worker of each host has compiled."""
        pickled = pickle.dumps((make, content), protocol=pickle.HIGHEST_PROTOCOL)
        key = hashlib.sha256(pickled).hexdigest()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # dask's, of a large scene
            state = self.client.submit(SharedState, pickled, key, self.environment, pure=False)
        hosts: dict[str, tuple[str, int]] = {}
        for address, threads in self.client.nthreads().items():
            name = urlsplit(address).hostname or address
            first, before = hosts.get(name, (address, 0))
            hosts[name] = first, before + threads
        completions = _Completions(out_of_time or (lambda: False))
        for address, threads in hosts.values():
            options = {"workers": [address], "allow_other_workers": True, "pure": False, "retries": _RETRIES}
            completions.add(self.client.submit(prepare_worker, state, threads, **options))
        while completions.pending and (future := completions.next()) is not None:
            self.add_processor(future.result())
        return state

    def add_processor(self, kind: str) -> None:
        """Add the processor of a worker, which may have joined later."""
        if kind not in self.processors:
            self.processors = (*self.processors, kind)
            self._warn_of_processors()

    def _warn_of_processors(self) -> None:
        if len(self.processors) > 1:
            warn(
                f"the workers of client have processors of different kinds, {' and '.join(self.processors)}: the image "
                "is as good, but its bits are those of none; stats.processors names them"
            )


class DaskEngine(Generic[JobT, ResultT]):
    """Engine on the workers of a cluster; see `DaskCluster.engine`."""

    def __init__(self, cluster: DaskCluster, state: Any, out_of_time: IsCancelled | None) -> None:
        self._cluster, self._state, self._out_of_time = cluster, state, out_of_time
        self._total_seconds = self._total_size = 0.0

    @property
    def threads(self) -> int:
        """See `Engine`."""
        return self._cluster.threads

    def results(
        self, jobs: Iterable[JobT], *, n_jobs: int, is_cancelled: IsCancelled
    ) -> Iterator[JobResult[JobT, ResultT]]:
        """See `Engine`."""
        client, out_of_time = self._cluster.client, self._out_of_time or (lambda: False)
        source, completions = iter(jobs), _Completions(lambda: is_cancelled() or out_of_time())
        running = dict[str, list[JobT]]()
        remaining, threads, bar, total, count = n_jobs, self.threads, current_progress(), n_jobs, 0
        ahead = _AHEAD if self._out_of_time is None else _AHEAD_TIMED
        with lost_client(client):
            try:
                while True:
                    max_running = threads * (ahead if self._total_size else 1)
                    while len(running) < max_running and (group := self._group(source, remaining, threads)):
                        remaining -= len(group)
                        pickled = pickle.dumps(group, protocol=pickle.HIGHEST_PROTOCOL)
                        future = client.submit(run_jobs, self._state, pickled, pure=False, retries=_RETRIES)
                        running[future.key] = group
                        completions.add(future)
                    if not running or (future := completions.next()) is None:
                        return
                    group = running.pop(future.key)
                    yield from self._job_results(group, future.result())
                    count += len(group)
                    if bar is not None:
                        bar.step(count, total)
            finally:
                client.cancel(completions.pending)

    def _group(self, source: Iterator[JobT], remaining: int, threads: int) -> list[JobT]:
        """The next jobs, as many as make a task; one if their duration is unknown, or time is limited."""
        pace = (
            math.inf
            if self._out_of_time is not None or not self._total_size
            else self._total_seconds / self._total_size
        )
        group: list[JobT] = []
        max_jobs, min_seconds, size, nbytes = -(-remaining // (_FRACTION * threads)), threads * _HANDLING, 0.0, 0
        for job in source:
            group.append(job)
            size, nbytes = size + job.size, nbytes + job.nbytes
            with_next = 1 + 1 / len(group)
            is_complete = len(group) >= max_jobs and pace * size >= min_seconds
            if is_complete or with_next * pace * size > _SECONDS or with_next * nbytes > _MAX_BYTES:
                break
        return group

    def _job_results(self, group: list[JobT], reply: TaskResult) -> Iterator[JobResult[JobT, ResultT]]:
        self._cluster.add_processor(reply.processor)
        self._total_seconds += sum(reply.seconds)
        self._total_size += sum(job.size for job in group)
        for job, result, seconds in zip(group, reply.results, reply.seconds, strict=True):
            yield JobResult(job, result, seconds, reply.cpu_seconds / len(group))


class _Completions:
    """Futures in the order of their completion."""

    def __init__(self, is_cancelled: IsCancelled) -> None:
        self._is_cancelled, self._pending = is_cancelled, dict[str, Any]()
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()

    @property
    def pending(self) -> list[Any]:
        """Futures that `next` has not returned yet."""
        return list(self._pending.values())

    def add(self, future: Any) -> None:
        """Wait for another future."""
        self._pending[future.key] = future
        future.add_done_callback(self._queue.put)

    def next(self) -> Any | None:
        """The next completed future; None if the work is cancelled. Signals are handled while it waits."""
        while not self._is_cancelled():
            with suppress(queue.Empty):
                future = self._queue.get(timeout=_PATIENCE)
                del self._pending[future.key]
                return future
        return None


@contextmanager
def lost_client(client: Any) -> Iterator[None]:
    """Context manager that turns the errors of a client that has been closed, or has lost its cluster."""
    try:
        yield
    except Exception as error:
        if getattr(client, "status", "running") == "running" and "Cancelled" not in type(error).__name__:
            raise
        raise EngineLostError(
            "the cluster of client was closed while it worked; call again with another one"
        ) from error


def _environments(client: Any) -> dict[str, dict[str, str]]:
    """Environment of each worker by its address; workers that die meanwhile are left out."""
    try:
        replies: dict[str, Any] = client.run(environment, on_error="return")
    except ImportError as error:  # the worker cannot even import the function
        replies = {"": error}
    alive = {address: theirs for address, theirs in replies.items() if not isinstance(theirs, OSError)}
    for address, theirs in alive.items():
        if isinstance(theirs, BaseException):
            raise InvalidValueError(
                f"client has a worker {address} that cannot render ({type(theirs).__name__}: {theirs}); install the "
                f"same packages as on this machine, plenoptic {__version__}, or leave it out"
            ) from theirs
    return alive
