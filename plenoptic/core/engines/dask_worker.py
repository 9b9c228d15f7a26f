"""Functions that run in the workers of dask, which pickle by their names, and their values for the next task."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import pickle
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from plenoptic import __version__
from plenoptic.core.numba.jit import processor
from plenoptic.errors import InvalidValueError

Make = Callable[[Any, int], Callable[[Any], Any]]
"""Makes of a job what carries out its orders; it may compile with so many processes meanwhile."""
PROCESSOR = "processor"
_PACKAGES = ("numpy", "numba", "llvmlite", "embreex")
"""On whose versions bits depend."""
_MOST_MADE = 2
"""Jobs of which what was made is kept: scenes and trees."""


class Job(NamedTuple):
    """Values that all orders of a job share, as a worker gets them."""

    content: bytes
    """How to make what carries out orders, and of what, pickled: whatever a worker makes of it is then of its own."""
    key: str
    """The same for the same content."""
    surroundings: dict[str, str]
    """Where the client runs."""


class Reply(NamedTuple):
    """Results of a task."""

    results: list[Any]
    seconds: list[float]
    """For each result."""
    cpu_seconds: float
    processor: str


@functools.cache
def sources_hash() -> str:
    """Digest of the package's Python files."""
    digest, root = hashlib.sha256(), Path(__file__).parents[2]
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()[:20]


def surroundings() -> dict[str, str]:
    """Versions that must be the same here as at the client, and the kind of processor."""
    found = {"plenoptic": __version__, "kernels": sources_hash()}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "none"
    return {**found, PROCESSOR: processor()}


def check_same(theirs: Mapping[str, str], ours: Mapping[str, str], whose: str) -> None:
    """An InvalidValueError where a worker would render other bits than the client."""
    found = [
        f"other {name}" if name == "kernels" else f"{name} {theirs.get(name, 'none')}, not {one}"
        for name, one in ours.items()
        if name != PROCESSOR and theirs.get(name) != one
    ]
    if found:
        raise InvalidValueError(
            f"client has {whose} with {', '.join(found)}; install there what is installed here, or leave it out"
        )


_made: OrderedDict[str, Callable[[Any], Any]] = OrderedDict()
_making = threading.Lock()


def prepare(job: Job, threads: int = 1) -> Callable[[Any], Any]:
    """Function for the orders of a job, made once in each worker; other threads of it wait meanwhile."""
    with _making:
        if job.key not in _made:
            check_same(surroundings(), job.surroundings, "a worker")
            while len(_made) >= _MOST_MADE:
                _made.popitem(last=False)
            make, given = pickle.loads(job.content)
            _made[job.key] = make(given, threads)
        _made.move_to_end(job.key)
        return _made[job.key]


def prepared(job: Job, threads: int) -> str:
    """Prepare a job; the kind of processor that it is for."""
    prepare(job, threads)
    return processor()


def carry_out(job: Job, orders: bytes) -> Reply:
    """Some orders of a job, pickled, one after the other."""
    begin = time.thread_time()
    work, results, seconds = prepare(job), [], []
    for order in pickle.loads(orders):
        before = time.perf_counter()
        results.append(work(order))
        seconds.append(time.perf_counter() - before)
    return Reply(results, seconds, time.thread_time() - begin, processor())
