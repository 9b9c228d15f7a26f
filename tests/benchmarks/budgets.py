"""What it costs to stop by an error or by time: the same error and the same time with samples alone."""

from functools import partial

import reference
from table import Table
from timing import median, taking_turns

import plenoptic as pl

SAMPLES = {"white": 384, "check": 384, "objects": 256}


def tables(*, quick):
    side, rounds = (32, 1) if quick else (256, 5)
    less = 8 if quick else 1
    rows = [row for name, n in SAMPLES.items() for row in _rows(name, n // less, reference.middle(side), rounds)]
    columns = "scene | ends by | samples on average | error % | wall s | CPU s | CPU ns per path"
    remark = "Target error and time limit are what the call with samples alone has reached and taken."
    title = f"Ends of renderings, {side} x {side} pixels, two threads, medians of {rounds}"
    yield Table(title, columns, rows, [remark])


def _rows(name, samples, region, rounds):
    scene = {"white": lambda: None, "check": pl.check_scene, "objects": pl.objects_scene}[name]()
    how = {"region": region, "truth": pl.Truth.NONE, "threads": 2}
    render = partial(reference.exposed, scene, reference.camera(), **how)
    render(samples=samples)
    first = render(samples=samples)
    tasks = {
        "samples": partial(render, samples=samples),
        "target_error": partial(render, target_error=first.relative_error),
        "time_limit": partial(render, time_limit=first.stats.seconds),
        "both": partial(render, time_limit=first.stats.seconds, target_error=0.5 * first.relative_error),
    }
    costs, shots = taking_turns(tasks, rounds=rounds)
    for label, shot in shots.items():
        counts, cost = shot.samples if shot.sample_counts is None else shot.sample_counts.mean(), median(costs[label])
        yield name, label, float(counts), 100 * shot.relative_error, *cost, 1e9 * cost.cpu / shot.stats.paths
