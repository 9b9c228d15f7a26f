"""Paths per second of whole renderings with the reference camera."""

import reference
from reference import Mode
from table import Table
from timing import Task, median, taking_turns

import plenoptic as pl
from plenoptic.truth.channels import Truth

WANTED = {"white": "5, aim 8", "check": "3.5, aim 5"}


def tables(*, quick):
    samples, rounds = (1, 1) if quick else (64, 3)
    yield reference_scenes(samples, rounds=rounds)
    yield scenes_with_shading(samples, rounds=rounds)


def reference_scenes(samples, *, rounds):
    """`white` and `check`, both modes, one and two threads."""
    cases = {
        (name, mode, threads): (scene, mode, threads)
        for name, scene in (("white", None), ("check", pl.check_scene()))
        for mode in Mode
        for threads in (1, 2)
    }
    through = {}

    def task(key, scene, mode, threads):
        def run(camera):
            stats = reference.exposed(scene, camera, samples=samples, threads=threads).stats
            through[key] = (1e-6 * stats.paths_through_lens, stats.fraction_through_lens)

        return Task(run, lambda: reference.camera(mode))

    costs = taking_turns({key: task(key, *case) for key, case in cases.items()}, rounds=rounds)
    rows = []
    for key in cases:
        name, mode, threads = key
        (million, fraction), cost = through[key], median(costs[key])
        found = (100 * fraction, million / cost.wall, million / cost.cpu)
        rows.append((name, mode.title, threads, *cost, *found, WANTED[name]))
    columns = (
        "scene | mode | threads | wall s | CPU s | % of paths leave the lens | million of these per wall second | "
        "per CPU-second | wanted"
    )
    remark = "At least 60 % of the paths are to leave the lens. Setting up, depth and standard error are included."
    return Table(f"Rendering the reference camera, 512 x 512 pixels, {samples} samples", columns, rows, [remark])


def scenes_with_shading(samples, *, rounds):
    """Scattering and shadow rays: with and without depth, 8 replicates and 1."""
    scenes = {"check": pl.check_scene(), "objects": pl.objects_scene(), "still life": pl.still_life()}
    camera = reference.camera()
    through = {}

    def task(key):
        name, depth, replicates = key

        def run(_):
            how = {"samples": samples, "threads": 1, "truth": Truth(depth), "replicates": replicates}
            shot = reference.exposed(scenes[name], camera, **how)
            through[key] = 1e-6 * shot.stats.paths_through_lens

        return Task(run)

    keys = [(name, depth, replicates) for name in scenes for depth, replicates in ((True, 8), (False, 8), (False, 1))]
    costs = taking_turns({key: task(key) for key in keys}, rounds=rounds)
    rows = []
    for key in keys:
        name, depth, replicates = key
        cost = median(costs[key])
        rows.append((name, "yes" if depth else "no", replicates, cost.wall, cost.cpu, through[key] / cost.cpu))
    columns = ("scene", "depth", "replicates", "wall s", "CPU s", "million paths through the lens per CPU-second")
    return Table(f"Rendering scenes, mode 2.0, 512 x 512 pixels, {samples} samples, one thread", columns, rows)
