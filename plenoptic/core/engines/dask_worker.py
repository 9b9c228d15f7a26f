"""Code that dask's workers run: functions that pickle by name, and their caches of shared state."""

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
"""Makes of the content of a shared state, with that many processes for compilation, the function that runs a job."""
PROCESSOR = "processor"
_PACKAGES = ("numpy", "numba", "llvmlite", "embreex")
"""Packages whose versions determine the bits of images."""
_MAX_CACHED = 2
"""Shared states, with their scenes and trees, that a worker keeps."""


class SharedState(NamedTuple):
    """Content that all jobs have in common, as a worker receives it."""

    content: bytes
    """Pickled pair of a `Make` and its argument; each worker makes its own function of it."""
    key: str
    """Digest of the content."""
    environment: dict[str, str]
    """Environment of the client."""


class TaskResult(NamedTuple):
    """Results of the jobs of a task."""

    results: list[Any]
    seconds: list[float]
    """Wall time of each job."""
    cpu_seconds: float
    processor: str


@functools.cache
def sources_hash() -> str:
    """Digest of the package's Python files."""
    digest, root = hashlib.sha256(), Path(__file__).parents[2]
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()[:20]


def environment() -> dict[str, str]:
    """Versions that must agree between client and workers, and the kind of processor."""
    versions = {"plenoptic": __version__, "kernels": sources_hash()}
    for name in _PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "none"
    return {**versions, PROCESSOR: processor()}


def check_environment(theirs: Mapping[str, str], ours: Mapping[str, str], whose: str) -> None:
    """Raise InvalidValueError if a worker would render other bits than the client."""
    differences = [
        f"other {name}" if name == "kernels" else f"{name} {theirs.get(name, 'none')}, not {version}"
        for name, version in ours.items()
        if name != PROCESSOR and theirs.get(name) != version
    ]
    if differences:
        raise InvalidValueError(
            f"client has {whose} with {', '.join(differences)}; install the same versions there, or leave it out"
        )


_run_functions: OrderedDict[str, Callable[[Any], Any]] = OrderedDict()
_lock = threading.Lock()


def prepare(state: SharedState, threads: int = 1) -> Callable[[Any], Any]:
    """The function that runs jobs with a shared state, made once in each worker; other threads of it wait."""
    with _lock:
        if state.key not in _run_functions:
            check_environment(environment(), state.environment, "a worker")
            while len(_run_functions) >= _MAX_CACHED:
                _run_functions.popitem(last=False)
            make, content = pickle.loads(state.content)
            _run_functions[state.key] = make(content, threads)
        _run_functions.move_to_end(state.key)
        return _run_functions[state.key]


def prepare_worker(state: SharedState, threads: int) -> str:
    """Prepare a shared state, and return the kind of processor of this worker."""
    prepare(state, threads)
    return processor()


def run_jobs(state: SharedState, jobs: bytes) -> TaskResult:
    """Run pickled jobs one after the other."""
    begin = time.thread_time()
    run, results, seconds = prepare(state), [], []
    for job in pickle.loads(jobs):
        job_begin = time.perf_counter()
        results.append(run(job))
        seconds.append(time.perf_counter() - job_begin)
    return TaskResult(results, seconds, time.thread_time() - begin, processor())
