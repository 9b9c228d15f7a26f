"""Orders on the workers of a dask cluster, grouped into tasks by the time that those before took.

Nothing of dask is imported: a client brings all that is called. Tasks are pure, and their inputs are tasks too,
so that dask repeats those that were lost with a worker, whichever it was.
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
    Job,
    Make,
    Reply,
    carry_out,
    check_same,
    prepared,
    surroundings,
)
from plenoptic.core.engines.engine import Done, GivenUp, OrderT, ResultT
from plenoptic.core.waiting.bar import waiting_here
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError

_SECONDS = 20.0
"""That a task takes: what is lost with a worker."""
_MOST_BYTES = 1 << 23
"""Of what a task needs or brings: dask advises against more in a task, and some wait for being taken."""
_AHEAD, _AHEAD_LATE = 4, 2
"""Tasks for each thread of a worker that are submitted before their results are taken; where time is limited, too."""
_SHARE = 2
"""A task has at most this part of what each thread would get of the orders that are left, so that none ends late."""
_HANDLING = 4e-3
"""Seconds that client and scheduler need for a task: shorter ones, times the threads, would wait for each other."""
_RETRIES = 3
"""Of a task that fails, on whichever worker. What dies with its worker is not counted here, but by dask's
`distributed.scheduler.allowed-failures`, which is 3 as well."""
_PATIENCE = 0.1
"""Seconds after which it is asked whether results are still wanted."""
_NEEDED = ("submit", "run", "nthreads")


class DaskCluster:
    """Workers of a client that all have the versions of this process."""

    def __init__(self, client: Any) -> None:
        """An InvalidValueError where it is no client, has no workers, or workers would render other bits."""
        if not all(callable(getattr(client, name, None)) for name in _NEEDED) or getattr(client, "asynchronous", False):
            raise InvalidValueError(
                f"client is a {type(client).__name__}; it must be a distributed.Client that is not asynchronous"
            )
        self.client, self.surroundings = client, surroundings()
        found = _surroundings_of(client)
        if not found:
            raise InvalidValueError("client has no workers; start some, or wait with client.wait_for_workers(1)")
        for address, theirs in found.items():
            check_same(theirs, self.surroundings, f"the worker {address}")
        self.processors: tuple[str, ...] = tuple(dict.fromkeys(theirs[PROCESSOR] for theirs in found.values()))
        """Kinds of processors that workers have."""
        self._warn_of_processors()

    @property
    def threads(self) -> int:
        """Number of threads of all present workers."""
        return max(sum(map(int, self.client.nthreads().values())), 1)

    @contextmanager
    def engine(self, make: Make, given: Any, *, late: GivenUp | None = None) -> Iterator[DaskEngine[Any, Any]]:
        """Engine for the orders of a job; `late`: True once time is over, None where there is no limit.

        One worker of each host gets ready first: it compiles, and the others find its compiled code on the disk.
        """
        content = pickle.dumps((make, given), protocol=pickle.HIGHEST_PROTOCOL)
        key = hashlib.sha256(content).hexdigest()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # dask's, of a large scene
            job = self.client.submit(Job, content, key, self.surroundings, pure=False)
        hosts: dict[str, tuple[str, int]] = {}
        for address, threads in self.client.nthreads().items():
            name = urlsplit(address).hostname or address
            first, before = hosts.get(name, (address, 0))
            hosts[name] = first, before + threads
        arrived = _Arrived(late or (lambda: False))
        for address, threads in hosts.values():
            options = {"workers": [address], "allow_other_workers": True, "pure": False, "retries": _RETRIES}
            arrived.note(self.client.submit(prepared, job, threads, **options))
        while arrived.missing and (future := arrived.next()) is not None:
            self.note_processor(future.result())
        yield DaskEngine(self, job, late)

    def note_processor(self, kind: str) -> None:
        """A worker that came later may have another one."""
        if kind not in self.processors:
            self.processors = (*self.processors, kind)
            self._warn_of_processors()

    def _warn_of_processors(self) -> None:
        if len(self.processors) > 1:
            warn(
                f"the workers of client have processors of different kinds, {' and '.join(self.processors)}: the image "
                "is as good, but its bits are those of none; stats.processors names them"
            )


class DaskEngine(Generic[OrderT, ResultT]):
    """See `DaskCluster.engine`."""

    def __init__(self, cluster: DaskCluster, job: Any, late: GivenUp | None) -> None:
        self._cluster, self._job, self._late = cluster, job, late
        self._took = self._sizes = 0.0

    @property
    def threads(self) -> int:
        """See `Engine`."""
        return self._cluster.threads

    def results(self, orders: Iterable[OrderT], *, left: int, given_up: GivenUp) -> Iterator[Done[OrderT, ResultT]]:
        """See `Engine`."""
        client, late = self._cluster.client, self._late or (lambda: False)
        source, arrived, waiting = iter(orders), _Arrived(lambda: given_up() or late()), dict[str, list[OrderT]]()
        threads, bar, total, count = self.threads, waiting_here(), left, 0
        ahead = _AHEAD if self._late is None else _AHEAD_LATE
        try:
            while True:
                most = threads * (ahead if self._sizes else 1)
                while len(waiting) < most and (group := self._group(source, left, threads)):
                    left -= len(group)
                    content = pickle.dumps(group, protocol=pickle.HIGHEST_PROTOCOL)
                    future = client.submit(carry_out, self._job, content, pure=False, retries=_RETRIES)
                    waiting[future.key] = group
                    arrived.note(future)
                if not waiting or (future := arrived.next()) is None:
                    return
                group = waiting.pop(future.key)
                yield from self._taken(group, future.result())
                count += len(group)
                if bar is not None:
                    bar.step(count, total)
        finally:
            client.cancel(arrived.missing)

    def _group(self, source: Iterator[OrderT], left: int, threads: int) -> list[OrderT]:
        """The next orders, as many as make a task; one where it is not known how long they take, or time is limited."""
        pace = math.inf if self._late is not None or not self._sizes else self._took / self._sizes
        group: list[OrderT] = []
        most, least, size, nbytes = -(-left // (_SHARE * threads)), threads * _HANDLING, 0.0, 0
        for order in source:
            group.append(order)
            size, nbytes = size + order.size, nbytes + order.nbytes
            another = 1 + 1 / len(group)
            shared = len(group) >= most and pace * size >= least
            if shared or another * pace * size > _SECONDS or another * nbytes > _MOST_BYTES:
                break
        return group

    def _taken(self, group: list[OrderT], reply: Reply) -> Iterator[Done[OrderT, ResultT]]:
        self._cluster.note_processor(reply.processor)
        self._took, self._sizes = self._took + sum(reply.seconds), self._sizes + sum(order.size for order in group)
        for order, result, seconds in zip(group, reply.results, reply.seconds, strict=True):
            yield Done(order, result, seconds, reply.cpu_seconds / len(group))


class _Arrived:
    """Futures as they are finished."""

    def __init__(self, given_up: GivenUp) -> None:
        self._given_up, self._missing = given_up, dict[str, Any]()
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()

    @property
    def missing(self) -> list[Any]:
        """Tasks that have not been taken."""
        return list(self._missing.values())

    def note(self, future: Any) -> None:
        """Wait for it too."""
        self._missing[future.key] = future
        future.add_done_callback(self._queue.put)

    def next(self) -> Any | None:
        """The next one; None where no more are wanted. A signal is heard meanwhile."""
        while not self._given_up():
            with suppress(queue.Empty):
                future = self._queue.get(timeout=_PATIENCE)
                del self._missing[future.key]
                return future
        return None


def _surroundings_of(client: Any) -> dict[str, dict[str, str]]:
    """Environment of each worker, by its address; workers that are lost meanwhile do not count."""
    try:
        found: dict[str, Any] = client.run(surroundings, on_error="return")
    except ImportError as error:  # where what is to run cannot even be found
        found = {"": error}
    there = {address: theirs for address, theirs in found.items() if not isinstance(theirs, OSError)}
    for address, theirs in there.items():
        if isinstance(theirs, BaseException):
            raise InvalidValueError(
                f"client has a worker {address} that cannot render ({type(theirs).__name__}: {theirs}); install there "
                f"what is installed here, plenoptic {__version__}, or leave it out"
            ) from theirs
    return there
