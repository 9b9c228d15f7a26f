"""Wall and processor time of functions that take turns, programs in processes of their own, memory of a process."""

import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple


class Cost(NamedTuple):
    """Seconds on the clock and of the processors, all threads together."""

    wall: float
    cpu: float


def timed(work, *given, calls=1, **settings):
    """Cost of one call, averaged over a number of calls, and what the last one gives."""
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(calls):
        result = work(*given, **settings)
    return Cost((time.perf_counter() - wall) / calls, (time.process_time() - cpu) / calls), result


def taking_turns(tasks, *, rounds, prepare=None):
    """Costs of functions that run one after the other, so that what disturbs one disturbs all; and their last results.

    A round that is not counted comes first; it compiles and warms up. `prepare` makes what some are given, outside the
    measurement.
    """
    costs, results = {name: [] for name in tasks}, {}
    for _ in range(rounds + 1):
        for name, work in tasks.items():
            given = [prepare[name]()] if prepare and name in prepare else []
            cost, results[name] = timed(work, *given)
            costs[name].append(cost)
    return {name: each[1:] for name, each in costs.items()}, results


def median(costs):
    """Median of wall and of processor time, each by itself."""
    return Cost(*(statistics.median(column) for column in zip(*costs, strict=True)))


def in_new_process(code, *arguments, cache=None, **environment):
    """What a program prints as JSON; its kernels are cached in a folder of its own where one is given."""
    here = Path(__file__).resolve().parent
    paths = [str(here), str(here.parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, **environment, "PYTHONPATH": os.pathsep.join(paths)}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"a timed process failed with exit code {done.returncode}:\n{done.stderr}")
    return list(json.loads(done.stdout.splitlines()[-1]))


def apart(function, *arguments):
    """What a benchmark's function gives in a process of its own."""
    module, name = function.__module__, function.__name__
    return in_new_process(f"import json, {module}; print(json.dumps({module}.{name}(*{arguments!r})))")


def memory(which="VmRSS"):
    """Bytes that this process holds, or with VmHWM has held at most; 0 where the system does not tell."""
    try:
        with open("/proc/self/status") as status:
            return next(1024 * int(line.split()[1]) for line in status if line.startswith(which))
    except OSError:
        return 0


def count_peak_anew():
    """Linux begins to count the peak anew where it is told so."""
    if sys.platform == "linux":
        Path("/proc/self/clear_refs").write_text("5")
