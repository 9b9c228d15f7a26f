"""What a target error costs beside the best fixed number of samples that has the same true error."""

import dataclasses
import math

import numpy as np
import reference
from honesty import Converged, Subject, expose
from table import Table
from timing import timed

import plenoptic as pl

FIXED = (32, 64, 128, 256, 512)
"""Powers of 2 use the points best."""
AIMED = (90, 180, 360)
"""Targets are what about so many samples leave: between those."""


def tables(*, quick):
    side, seeds, converged = (16, 2, 256) if quick else (128, 5, 1 << 12)
    rows = [row for subject in subjects(side) for row in _rows(subject, range(seeds), converged)]
    columns = "scene | target % | reported % | true % | samples on average | paths of a pixel | CPU s | "
    columns += "over fixed | from | to"
    remark = (
        f"{side} x {side} pixels, one thread, {seeds} seeds, calls in turns, each with a camera of its own. True "
        f"errors are RMS over seeds and lit pixels against {converged} samples of another seed. Over fixed: CPU time "
        f"over that of a fixed number with this error, between {FIXED} samples in logarithms; median and quartiles."
    )
    yield Table("A target error beside a fixed number of samples", columns, rows, [remark])


def subjects(side):
    """A matt board under a lamp; and beside a small one, half in the shadow of a plate: there it has the sky alone."""
    wall = pl.quad((-30, -30, -404), (60, 0, 0), (0, 60, 0), material=pl.Lambertian(0.7))
    lamp = pl.QuadLight.facing((20, 30, -360), (0, 0, -404), (12, 12), radiance=20.0)
    small = pl.QuadLight.facing((-4, 0, -402), (0, 0, -404), (1, 1), radiance=40.0)
    plate = pl.quad((0.5, -0.5, -404), (0, 0, 0.5), (0, 9, 0), material=pl.Lambertian(0.3))
    scenes = {"white": None, "matt board": pl.Scene([wall], [lamp])}
    scenes |= {"dim and bright": pl.Scene([wall, plate], [small], background=0.05), "`objects`": pl.objects_scene()}
    camera = reference.camera()
    return [Subject(name, scene, camera, reference.middle(side)) for name, scene in scenes.items()]


def _rows(subject, seeds, converged):
    truth = Converged(subject, converged)
    said = [float(expose(subject, samples=n).relative_error or 0.0) for n in FIXED]
    targets = np.exp(np.interp(np.log(AIMED), np.log(FIXED), np.log(said))).tolist()
    budgets = {f"{n}": {"samples": n} for n in FIXED} | {f"{e}": {"target_error": e} for e in targets}
    found = {name: [] for name in budgets}
    for seed in (seeds[0], *seeds):
        for name, budget in budgets.items():
            # A camera of its own: nothing is known from the call before.
            new = subject._replace(camera=dataclasses.replace(subject.camera))
            found[name].append(timed(expose, new, threads=1, seed=seed, **budget))
    shots = {name: [shot for _, shot in each] for name, each in found.items()}
    true = {name: true_error(truth, shots[name][1:]) for name in budgets}
    cpu = {name: np.array([cost.cpu for cost, _ in each[1:]]) for name, each in found.items()}
    for target in targets:
        name = f"{target}"
        fixed = np.array([_fixed_cost([(true[f"{n}"], cpu[f"{n}"][k]) for n in FIXED], true[name]) for k in seeds])
        low, ratio, high = np.percentile(cpu[name] / fixed, (25, 50, 75)).tolist()
        counts = [shot.samples if shot.sample_counts is None else shot.sample_counts.mean() for shot in shots[name]]
        paths = [shot.stats.paths / shot.image[..., 0].size for shot in shots[name]]
        reported = math.sqrt(np.mean([shot.relative_error**2 for shot in shots[name]]))
        errors = 100 * target, 100 * reported, 100 * true[name]
        samples = round(float(np.mean(counts))), round(float(np.mean(paths)))
        yield subject.name, *errors, *samples, float(np.median(cpu[name])), ratio, low, high


def true_error(truth, shots):
    """RMS over lit pixels and images of the error over the brightness, less what the reference is off."""
    off = np.mean([np.square(shot.image - truth.image) for shot in shots], axis=0) - truth.variance
    relative = off.mean(axis=2) / np.square(truth.image.mean(axis=2))
    return math.sqrt(max(float(relative[truth.lit].mean()), 0.0))


def _fixed_cost(known, error):
    """What a fixed number costs that leaves an error, from errors and costs of some."""
    errors, costs = np.log(known).T
    return float(np.exp(np.interp(-math.log(error), -errors, costs)))
