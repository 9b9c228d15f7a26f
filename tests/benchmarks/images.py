"""Paths per second of whole renderings with the reference camera: both modes, one and two threads."""

from functools import partial

import reference
from table import Table
from timing import median, taking_turns

import plenoptic as pl

WANTED = {"white": "5, aim 8", "check": "3.5, aim 5"}


def tables(*, quick):
    samples, rounds = (1, 1) if quick else (64, 3)
    tasks, cameras = {}, {}
    for name, scene in (("white", None), ("check", pl.check_scene())):
        for key in ((name, mode, threads) for mode in reference.Mode for threads in (1, 2)):
            tasks[key] = partial(reference.exposed, scene, samples=samples, threads=key[2])
            cameras[key] = partial(reference.camera, key[1])  # a camera of its own: its setting up counts
    costs, shots = taking_turns(tasks, rounds=rounds, prepare=cameras)
    rows = []
    for (name, mode, threads), each in costs.items():
        cost, stats = median(each), shots[name, mode, threads].stats
        million = 1e-6 * stats.paths_through_lens
        found = 100 * stats.fraction_through_lens, million / cost.wall, million / cost.cpu
        rows.append((name, mode.title, threads, *cost, *found, WANTED[name]))
    columns = "scene | mode | threads | wall s | CPU s | % of paths leave the lens | "
    columns += "million of these per wall second | per CPU-second | wanted"
    remark = "At least 60 % of the paths are to leave the lens. Setting up, depth and standard error are included."
    yield Table(f"Rendering the reference camera, 512 x 512 pixels, {samples} samples", columns, rows, [remark])
