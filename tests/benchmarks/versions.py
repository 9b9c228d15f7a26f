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
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import reference
from table import Table

import plenoptic as pl

MIDDLE, BALL = np.s_[224:288, 224:288], np.s_[256:384, 192:320]


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
    region: Any = MIDDLE
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
    "`objects`": Case(scene=pl.objects_scene, region=BALL, bounces=128, converged=1024),
}
AT_ERROR = (
    Wanted("white, round", 1.0, (128, 256, 512, 1024), (2, 4, 8, 16, 32)),
    Wanted("white, six blades", 1.0, (128, 256, 512, 1024), (2, 4, 8, 16, 32)),
    Wanted("`objects`", 18.0, (8, 16, 32), (2, 4, 8, 16)),
)


def tables(*, quick):
    here = Path(sys.executable)
    other = Path(os.environ.get("PLENOPTIC_BEFORE", here))
    before, now, rounds = _Version(other, own=other == here), _Version(here, own=True), 1 if quick else 7
    remark = f"One thread, whole warm calls in turns, each with its own camera; CPU ms a pixel, medians of {rounds}."
    at_error = AT_ERROR[:1] if quick else AT_ERROR
    named = {row.name for row in AT_ERROR}
    names = [name for name in CASES if name not in named][: 1 if quick else None]
    chosen = [row.name for row in at_error] + names
    truths = {name: _Truth(now, CASES[name], 64 if quick else CASES[name].converged) for name in chosen}
    rows = [_at_error(row, truths[row.name], (before, now), rounds) for row in at_error]
    columns = ("image", "error %", "before, 8 replicates", "samples", "now, 2", "samples", "less by")
    yield Table("CPU time at an error", columns, rows, [remark])
    rows = [_variance_times_cpu(name, truths[name], (before, now), rounds) for name in names]
    columns = ("image", "before, 8 replicates", "now, 2", "less by", "before, 1", "now, 1", "less by")
    yield Table("Relative variance (%^2) times CPU time, 64 samples", columns, rows, [remark])


class _Version:
    """A process that renders what it is told to."""

    def __init__(self, python, *, own):
        here = Path(__file__).resolve()
        paths = [str(here.parent), *([str(here.parents[2])] if own else [])]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONSAFEPATH": "1"}
        pipe = subprocess.PIPE
        self._process = subprocess.Popen([python, str(here)], env=environment, stdin=pipe, stdout=pipe)

    def __call__(self, case, **settings):
        """CPU seconds, the image and its standard error."""
        name = next(name for name, one in CASES.items() if one is case)
        pickle.dump((name, settings), self._process.stdin)
        self._process.stdin.flush()
        answer = pickle.load(self._process.stdout)
        return answer


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
        cpu = time.process_time()
        shot = reference.exposed(scene, new, region=case.region, threads=1, **settings)
        cpu = time.process_time() - cpu
        pickle.dump((cpu, shot.image, shot.standard_error), sys.stdout.buffer)
        sys.stdout.buffer.flush()


class _Truth:
    """A converged image, and the errors of others."""

    def __init__(self, now, case, samples):
        _, self.image, error = now(case, samples=samples, replicates=8, seed=1000)
        self.case, self.variance = case, np.square(error)
        grey = self.image.mean(axis=2)
        self.lit = grey > case.lit * np.percentile(grey, 99)

    def relative(self, image):
        """Squared errors of lit pixels, relative, with the reference's own variance taken off."""
        off = (np.square(image - self.image) - self.variance).mean(axis=2)
        return off[self.lit] / np.square(self.image.mean(axis=2)[self.lit])

    def pixels(self):
        return int(self.lit.size)


def _measured(truth, versions, tasks, rounds):
    """Median CPU ms a pixel and squared errors (rounds, pixels) of each task; the first round only warms up."""
    found = [[] for _ in tasks]
    for seed in range(rounds + 1):
        for of_task, version, task in zip(found, versions, tasks, strict=True):
            cpu, image, _ = version(truth.case, seed=seed, **task)
            of_task.append((cpu, truth.relative(image)))
    return [
        (1e3 * statistics.median(cpu for cpu, _ in one[1:]) / truth.pixels(), np.stack([e for _, e in one[1:]]))
        for one in found
    ]


def _at_error(wanted, truth, versions, rounds):
    name, error, before, now = wanted
    middle = np.median if truth.case.scene() is not None else np.mean
    row = []
    of = (versions[0],) * len(before) + (versions[1],) * len(now)
    tasks = [{"samples": n, "replicates": k} for numbers, k in ((before, 8), (now, 2)) for n in numbers]
    measured = _measured(truth, of, tasks, rounds)
    for numbers, found in ((before, measured[: len(before)]), (now, measured[len(before) :])):
        errors = [100 * math.sqrt(max(float(middle(squares)), 1e-12)) for _, squares in found]
        for values in ([cpu for cpu, _ in found], numbers):
            row.append(math.exp(np.interp(-math.log(error), -np.log(errors), np.log(values))))
    return name, error, *row, row[0] / row[2]


def _variance_times_cpu(name, truth, versions, rounds):
    before, now = versions
    tasks = [{"samples": 64, "replicates": n} for n in (8, 2, 1, 1)]
    products = [cpu * 1e4 * float(e.mean()) for cpu, e in _measured(truth, (before, now, before, now), tasks, rounds)]
    many, few, one, single = products
    return name, many, few, many / few, one, single, one / single


if __name__ == "__main__":
    serve()
