"""What it costs to stop by an error or by time: the same error and the same time with samples alone."""

import numpy as np
import reference
from table import Table
from timing import Task, median, taking_turns

import plenoptic as pl

SAMPLES = {"white": 384, "check": 384, "objects": 256}


def tables(*, quick):
    side, rounds = (32, 1) if quick else (256, 5)
    start = 256 - side // 2
    region = np.s_[start : start + side, start : start + side]
    less = 8 if quick else 1
    rows = [row for name, samples in SAMPLES.items() for row in _rows(name, samples // less, region, rounds)]
    columns = "scene | ends by | samples on average | error % | wall s | CPU s | CPU ns per path"
    remark = "Target error and time limit are what the call with samples alone has reached and taken."
    title = f"Ends of renderings, {side} x {side} pixels, two threads, medians of {rounds}"
    yield Table(title, columns, rows, [remark])


def _rows(name, samples, region, rounds):
    scene = {"white": lambda: None, "check": pl.check_scene, "objects": pl.objects_scene}[name]()
    camera, shots = reference.camera(), {}

    def rendered(label, **budget):
        shots[label] = reference.exposed(scene, camera, region=region, truth=pl.Truth.NONE, threads=2, **budget)
        return shots[label]

    rendered("samples", samples=samples)
    first = rendered("samples", samples=samples)
    budgets = {
        "samples": {"samples": samples},
        "target_error": {"target_error": first.relative_error},
        "time_limit": {"time_limit": first.stats.seconds},
        "both": {"time_limit": first.stats.seconds, "target_error": 0.5 * first.relative_error},
    }
    tasks = {label: Task(lambda _, label=label, how=how: rendered(label, **how)) for label, how in budgets.items()}
    return [_row(name, label, shots[label], median(cost)) for label, cost in taking_turns(tasks, rounds=rounds).items()]


def _row(name, label, shot, cost):
    counts = shot.samples if shot.sample_counts is None else float(shot.sample_counts.mean())
    each = 1e9 * cost.cpu / shot.stats.paths
    return name, label, float(counts), 100 * shot.relative_error, cost.wall, cost.cpu, each
