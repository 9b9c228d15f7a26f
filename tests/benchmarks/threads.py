"""Two threads against one, beside a loop that shows what the machine gives."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numba
import reference
from table import Table
from timing import Task, best, cost_of

import plenoptic as pl

WANTED = 1.8
LEAST_SECONDS = 10.0


def tables(*, quick):
    yield two_against_one(LEAST_SECONDS * (0.02 if quick else 1.0), rounds=1 if quick else 5)


@numba.njit(nogil=True)
def _logistic(steps):
    """Pure computation: one chain of multiplications, no memory."""
    x = 0.4
    for _ in range(steps):
        x = 3.9 * x * (1.0 - x)
    return x


def control(amount, threads):
    """The same amount of computing, divided among threads."""
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(_logistic, [amount // threads] * threads))


def rendering(scene, camera, samples, threads):
    reference.exposed(scene, camera, samples=samples, threads=threads)


def two_against_one(seconds, *, rounds):
    camera, check = reference.camera(), pl.check_scene()
    works = {
        "white": (lambda samples, threads: rendering(None, camera, samples, threads), 1),
        "check": (lambda samples, threads: rendering(check, camera, samples, threads), 1),
        "control loop": (control, 10_000_000),
    }
    tasks = {}
    for name, (work, least) in works.items():
        amount = _enough(work, least, seconds)
        for threads in (1, 2):
            tasks[name, threads] = Task(lambda _, w=work, a=amount, t=threads: w(a, t))
    # Sizing has warmed everything up, and runs are long: no round is thrown away.
    turns = [{key: cost_of(task) for key, task in tasks.items()} for _ in range(rounds)]
    rows = [_row(name, *(best([turn[name, threads] for turn in turns]) for threads in (1, 2))) for name in works]
    columns = (
        "work | wall s, 1 thread | wall s, 2 threads | CPU s, 1 thread | CPU s, 2 threads | times as fast | wanted"
    )
    remark = (
        f"Runs were sized to take at least {seconds:g} s with two threads. The control loop is pure computation "
        "without the GIL: no program gains more than it does here."
    )
    return Table(f"Two threads against one, best of {rounds}", columns, rows, [remark])


def _enough(work, least, seconds):
    """How much work takes one thread at least twice that time: two threads then need at least that time."""
    work(least, 1)
    amount = least
    while (spent := cost_of(Task(lambda given: work(given, 1), partial(int, amount))).cpu) < 2.2 * seconds:
        amount = max(amount + 1, int(2.3 * seconds / spent * amount))
    return amount


def _row(name, one, two):
    wanted = WANTED if name != "control loop" else None
    return name, one.wall, two.wall, one.cpu, two.cpu, one.wall / two.wall, wanted
