"""Lens analysis: time of each answer beside its error."""

import math
from functools import partial

import numpy as np
import reference
from table import Table
from timing import median, taking_turns

import plenoptic as pl
from plenoptic.optics.lens.trace import trace_part

FIELD = (0.0, math.radians(10.0))


def tables(*, quick):
    rounds = 1 if quick else 5
    yield spots((1000, 10_000) if quick else (1000, 10_000, 100_000, 1_000_000), rounds=rounds)
    yield aiming((100, 1000) if quick else (1, 1000, 10_000, 100_000), rounds=rounds)
    yield answers(rounds=rounds)
    yield whole_camera((1 << 12,) if quick else (1 << 14, 1 << 17, 1 << 20), rounds=rounds)


def spots(sizes, *, rounds):
    diagram = partial(pl.aberrations.spot_diagram, pl.load_lens("double-gauss-100mm-f2"), field=FIELD)
    costs, found = taking_turns({n: partial(diagram, rays=n) for n in sizes}, rounds=rounds)
    truth = diagram(rays=4 * sizes[-1]).rms_radius
    rows = []
    for n in sizes:
        radius, error = found[n].rms_radius, found[n].rms_radius_error
        rows.append((f"{n:,}", *median(costs[n]), 1e3 * radius, 1e6 * error, 1e6 * abs(radius - truth)))
    columns = "rays | wall s | CPU s | RMS radius, um | its standard error, nm | its true error, nm"
    remark = "True errors against four times as many rays as in the last row. Aiming of the beam's outline included."
    return Table("Spot diagrams: double Gauss, field 10 degrees, all threads", columns, rows, [remark])


def aiming(sizes, *, rounds):
    rows = []
    for name, degrees in (("double-gauss-100mm-f2", 20.0), ("fisheye-100mm-f8", 80.0)):
        lens, random = pl.load_lens(name), np.random.default_rng(0)
        for n in sizes:
            radius, turn = np.sqrt(random.uniform(size=n)), random.uniform(0, 2 * math.pi, n)
            pupil = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
            aim = partial(pl.aiming.aimed_rays, lens, field=(0.0, math.radians(degrees)), pupil=pupil)
            costs, rays = taking_turns({"aim": aim}, rounds=rounds)
            met = trace_part(lens, rays["aim"], 0, lens.iris_index, clipping=False)
            miss = float(np.nanmax(np.abs(met.origin[:, :2] - pupil * lens.stop.semi_diameter)))
            rows.append((name, degrees, f"{n:,}", *(1e3 * time for time in median(costs["aim"])), 1e3 * miss))
    columns = "lens | field, degrees | rays | wall ms | CPU ms | largest miss on the iris, um"
    return Table("Ray aiming at given points of the real iris", columns, rows)


def answers(*, rounds):
    lens, ab = pl.load_lens("double-gauss-100mm-f2"), pl.aberrations
    fields, frequencies = np.linspace(0.0, math.radians(18), 10), np.linspace(0.0, 100.0, 50)
    tasks = {
        "cardinal points": lambda: pl.paraxial.cardinal_points(lens),
        "Seidel sums": lambda: ab.seidel_sums(lens, field=0.3),
        "check": lens.check,
        "chief ray": lambda: pl.aiming.chief_ray(lens, field=FIELD),
        "best focus by RMS spot": lambda: ab.best_focus(lens, criterion=pl.FocusCriterion.RMS_SPOT),
        "ray fan": lambda: ab.ray_fan(lens, field=FIELD),
        "MTF, 50 frequencies": lambda: ab.mtf(lens, frequencies, field=FIELD),
        "point-spread function": lambda: ab.point_spread(lens, field=FIELD),
        "field curvature, 10 fields": lambda: ab.field_curvature(lens, fields),
        "distortion, 10 fields": lambda: ab.distortion(lens, fields),
        "vignetting, 10 fields": lambda: ab.vignetting(lens, fields),
        "relative illumination, 10 fields": lambda: ab.relative_illumination(lens, fields),
    }
    costs, _ = taking_turns(tasks, rounds=rounds)
    rows = [(name, *(1e3 * time for time in median(cost))) for name, cost in costs.items()]
    return Table("Other answers, with their default numbers of rays", "answer | wall ms | CPU ms", rows)


def whole_camera(sizes, *, rounds):
    spread = partial(pl.point_spread, reference.camera(), (3.0, -2.0, -404.0))
    costs, found = taking_turns({n: partial(spread, rays=n) for n in sizes}, rounds=rounds)
    rows = []
    for n in sizes:
        cost, one = median(costs[n]), found[n].of(0)
        error = 100 * float(np.ravel(one.light_error)[0]) / float(np.ravel(one.light)[0])
        rows.append((f"{n:,}", *cost, 1e-6 * n / cost.cpu, error))
    columns = "rays | wall s | CPU s | million rays per CPU-second | standard error of the light %"
    return Table("Point source through the reference camera, mode 2.0, all threads", columns, rows)
