"""Wall and processor time of functions that take turns."""

import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple


class Cost(NamedTuple):
    """Seconds on the clock and of the processors, all threads together."""

    wall: float
    cpu: float


class Task(NamedTuple):
    """What is timed, and what prepares its argument outside the measurement."""

    run: Callable[[Any], object]
    prepare: Callable[[], Any] = lambda: None


def cost_of(task, *, calls=1):
    """Cost of one call, averaged over a number of calls with the same argument."""
    prepared = task.prepare()
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(calls):
        task.run(prepared)
    return Cost((time.perf_counter() - wall) / calls, (time.process_time() - cpu) / calls)


def taking_turns(tasks, *, rounds):
    """Costs of tasks that run one after the other, round after round: what disturbs one disturbs all.

    A round that is not counted comes first; it compiles and warms up.
    """
    costs = {name: [] for name in tasks}
    for task in tasks.values():
        cost_of(task)
    for _ in range(rounds):
        for name, task in tasks.items():
            costs[name].append(cost_of(task))
    return costs


def median(costs):
    """Median of wall and of processor time, each by itself."""
    return Cost(statistics.median(c.wall for c in costs), statistics.median(c.cpu for c in costs))


def best(costs):
    """Least wall and least processor time, each by itself."""
    return Cost(min(c.wall for c in costs), min(c.cpu for c in costs))
