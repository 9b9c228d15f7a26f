"""Error and time of this version beside another that is installed: PLENOPTIC_BEFORE names its Python interpreter.

Both run in processes of their own that take turns, call after call. Where it is not set, this version is compared with
itself, which shows what the machine's other work does to the ratios.
"""

import dataclasses
import math
import os
import pickle
import statistics
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import reference
from table import Table
from timing import timed

import plenoptic as pl


class Wanted(NamedTuple):
    """An error in per cent (RMS of white images, the median of `objects`), and numbers of samples before and now.

    Between these the time at that error is interpolated; where it is beyond them, the last one is printed.
    """

    name: str
    error: float
    before: tuple[int, ...]
    now: tuple[int, ...]


class Case(NamedTuple):
    """What is rendered, where, and which pixels count: those above a share of the 99th percentile."""

    stop: Any = pl.CircularStop(5.0)
    scene: Callable[[], Any] = lambda: None
    region: Any = reference.middle(64)
    bounces: int = 8
    lit: float = 0.1
    converged: int = 4096


CASES = {
    "white, round": Case(lit=0.5, converged=1024),
    "white, six blades": Case(stop=pl.PolygonStop(blades=6, semi_diameter=5.0), lit=0.5, converged=1024),
    "white, 1 mm": Case(stop=pl.CircularStop(1.0)),
    "white, 0.1 mm": Case(stop=pl.CircularStop(0.1)),
    "white, 20 mm": Case(stop=pl.CircularStop(20.0)),
    "`check`": Case(scene=pl.check_scene),
    "still life, 1 bounce": Case(scene=pl.still_life, bounces=1),
    "`objects`": Case(scene=pl.objects_scene, region=np.s_[256:384, 192:320], bounces=128, converged=1024),
}
AT_ERROR = (
    Wanted("white, round", 1.0, (128, 256, 512, 1024), (2, 4, 8, 16, 32)),
    Wanted("white, six blades", 1.0, (128, 256, 512, 1024), (2, 4, 8, 16, 32)),
    Wanted("`objects`", 18.0, (8, 16, 32), (2, 4, 8, 16)),
)


def tables(*, quick):
    here = Path(sys.executable)
    other = Path(os.environ.get("PLENOPTIC_BEFORE", here))
    versions, rounds = (_Version(other, own=other == here), _Version(here, own=True)), 1 if quick else 7
    remark = f"One thread, whole warm calls in turns, each with its own camera; CPU ms a pixel, medians of {rounds}."
    rows = [_at_error(wanted, versions, rounds, quick) for wanted in (AT_ERROR[:1] if quick else AT_ERROR)]
    columns = "image | error % | before, 8 replicates | samples | now, 2 | samples | less by"
    yield Table("CPU time at an error", columns, rows, [remark])
    names = [name for name in CASES if name not in {row.name for row in AT_ERROR}]
    rows = [_variance_times_cpu(name, versions, rounds, quick) for name in (names[:1] if quick else names)]
    columns = "image | before, 8 replicates | now, 2 | less by | before, 1 | now, 1 | less by"
    yield Table("Relative variance (%^2) times CPU time, 64 samples", columns, rows, [remark])


class _Version:
    """A process that renders what it is told to: CPU seconds, the image and its standard error."""

    def __init__(self, python, *, own):
        here = Path(__file__).resolve()
        paths = [str(here.parent), *([str(here.parents[2])] if own else [])]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONSAFEPATH": "1"}
        pipe = subprocess.PIPE
        self._process = subprocess.Popen([python, str(here)], env=environment, stdin=pipe, stdout=pipe)

    def __call__(self, name, **settings):
        pickle.dump((name, settings), self._process.stdin)
        self._process.stdin.flush()
        return pickle.load(self._process.stdout)


def serve():
    """Render one case after the other; scenes are held, cameras are not."""
    known = {}
    while True:
        try:
            name, settings = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        case = CASES[name]
        if name not in known:
            plain = reference.camera()
            known[name] = case.scene(), dataclasses.replace(plain, lens=plain.lens.with_stop(case.stop))
        scene, camera = known[name]
        if scene is not None:
            settings |= {"max_bounces": case.bounces, "truth": pl.Truth.NONE}
        new = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor))
        cost, shot = timed(reference.exposed, scene, new, region=case.region, threads=1, **settings)
        pickle.dump((cost.cpu, shot.image, shot.standard_error), sys.stdout.buffer)
        sys.stdout.buffer.flush()


def _measured(name, of_versions, tasks, rounds, quick):
    """Median CPU ms a pixel and relative squared errors (rounds, lit pixels) of each task; one round only warms up.

    The variance of the converged image, which the last version renders, is taken off.
    """
    case = CASES[name]
    _, truth, error = of_versions[-1](name, samples=64 if quick else case.converged, replicates=8, seed=1000)
    grey = truth.mean(axis=2)
    lit = grey > case.lit * np.percentile(grey, 99)
    found = [[] for _ in tasks]
    for seed in range(rounds + 1):
        for of_task, version, task in zip(found, of_versions, tasks, strict=True):
            cpu, image, _ = version(name, seed=seed, **task)
            off = (np.square(image - truth) - np.square(error)).mean(axis=2)
            of_task.append((1e3 * cpu / lit.size, off[lit] / np.square(grey[lit])))
    times, errors = zip(*(zip(*one[1:], strict=True) for one in found), strict=True)
    return [statistics.median(each) for each in times], [np.stack(each) for each in errors]


def _at_error(wanted, versions, rounds, quick):
    name, error, *numbers = wanted
    middle = np.mean if name.startswith("white") else np.median
    asked = [(version, n, k) for version, of, k in zip(versions, numbers, (8, 2), strict=True) for n in of]
    tasks = [{"samples": n, "replicates": k} for _, n, k in asked]
    cpu, squares = _measured(name, [version for version, _, _ in asked], tasks, rounds, quick)
    errors = [100 * math.sqrt(max(float(middle(each)), 1e-12)) for each in squares]
    row, first = [], len(numbers[0])
    for part in (slice(first), slice(first, None)):
        for values in (cpu[part], [n for _, n, _ in asked[part]]):
            row.append(math.exp(np.interp(-math.log(error), -np.log(errors[part]), np.log(values))))
    return name, error, *row, row[0] / row[2]


def _variance_times_cpu(name, versions, rounds, quick):
    tasks = [{"samples": 64, "replicates": n} for n in (8, 2, 1, 1)]
    cpu, squares = _measured(name, versions * 2, tasks, rounds, quick)
    many, few, one, single = (ms * 1e4 * float(each.mean()) for ms, each in zip(cpu, squares, strict=True))
    return name, many, few, many / few, one, single, one / single


if __name__ == "__main__":
    serve()
