"""Lens analysis: time of each answer beside its error."""

import math

import numpy as np
import reference
from table import Table
from timing import Task, median, taking_turns

import plenoptic as pl

FIELD = (0.0, math.radians(10.0))


def tables(*, quick):
    rounds = 1 if quick else 5
    yield spots((1000, 10_000) if quick else (1000, 10_000, 100_000, 1_000_000), rounds=rounds)
    yield aiming((100, 1000) if quick else (1, 1000, 10_000, 100_000), rounds=rounds)
    yield answers(rounds=rounds)
    yield whole_camera((1 << 12,) if quick else (1 << 14, 1 << 17, 1 << 20), rounds=rounds)


def spots(sizes, *, rounds):
    lens = pl.load_lens("double-gauss-100mm-f2")
    found = {}

    def run(n):
        return Task(lambda _: found.__setitem__(n, pl.aberrations.spot_diagram(lens, field=FIELD, rays=n)))

    costs = taking_turns({str(n): run(n) for n in sizes}, rounds=rounds)
    truth = pl.aberrations.spot_diagram(lens, field=FIELD, rays=4 * sizes[-1]).rms_radius
    rows = []
    for n in sizes:
        radius, error = found[n].rms_radius, found[n].rms_radius_error
        rows.append((f"{n:,}", *median(costs[str(n)]), 1e3 * radius, 1e6 * error, 1e6 * abs(radius - truth)))
    columns = ("rays", "wall s", "CPU s", "RMS radius, um", "its standard error, nm", "its true error, nm")
    remark = "True errors against four times as many rays as in the last row. Aiming of the beam's outline included."
    return Table("Spot diagrams: double Gauss, field 10 degrees, all threads", columns, rows, [remark])


def aiming(sizes, *, rounds):
    rows = []
    for name, degrees in (("double-gauss-100mm-f2", 20.0), ("fisheye-100mm-f8", 80.0)):
        lens, random = pl.load_lens(name), np.random.default_rng(0)
        for n in sizes:
            radius, turn = np.sqrt(random.uniform(size=n)), random.uniform(0, 2 * math.pi, n)
            pupil = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
            field = (0.0, math.radians(degrees))
            task = Task(lambda _, l=lens, f=field, p=pupil: pl.aiming.aimed_rays(l, field=f, pupil=p))
            cost = median(taking_turns({"aim": task}, rounds=rounds)["aim"])
            rows.append((name, degrees, f"{n:,}", 1e3 * cost.wall, 1e3 * cost.cpu, 1e3 * _miss(lens, field, pupil)))
    columns = ("lens", "field, degrees", "rays", "wall ms", "CPU ms", "largest miss on the iris, um")
    return Table("Ray aiming at given points of the real iris", columns, rows)


def _miss(lens, field, pupil):
    from plenoptic.optics.lens.trace import traced_part

    rays = pl.aiming.aimed_rays(lens, field=field, pupil=pupil)
    met = traced_part(lens, rays, 0, lens.iris_index, clipping=False)
    return float(np.nanmax(np.abs(met.origin[:, :2] - pupil * lens.stop.semi_diameter)))


def answers(*, rounds):
    lens = pl.load_lens("double-gauss-100mm-f2")
    fields = np.linspace(0.0, math.radians(18), 10)
    frequencies = np.linspace(0.0, 100.0, 50)
    ab = pl.aberrations
    tasks = {
        "cardinal points": lambda _: pl.paraxial.cardinal_points(lens),
        "Seidel sums": lambda _: ab.seidel_sums(lens, field=0.3),
        "check": lambda _: lens.check(),
        "chief ray": lambda _: pl.aiming.chief_ray(lens, field=FIELD),
        "best focus by RMS spot": lambda _: ab.best_focus(lens, criterion=pl.FocusCriterion.RMS_SPOT),
        "ray fan": lambda _: ab.ray_fan(lens, field=FIELD),
        "MTF, 50 frequencies": lambda _: ab.mtf(lens, frequencies, field=FIELD),
        "point-spread function": lambda _: ab.point_spread(lens, field=FIELD),
        "field curvature, 10 fields": lambda _: ab.field_curvature(lens, fields),
        "distortion, 10 fields": lambda _: ab.distortion(lens, fields),
        "vignetting, 10 fields": lambda _: ab.vignetting(lens, fields),
        "relative illumination, 10 fields": lambda _: ab.relative_illumination(lens, fields),
    }
    costs = taking_turns({name: Task(run) for name, run in tasks.items()}, rounds=rounds)
    rows = [(name, 1e3 * median(cost).wall, 1e3 * median(cost).cpu) for name, cost in costs.items()]
    return Table("Other answers, with their default numbers of rays", ("answer", "wall ms", "CPU ms"), rows)


def whole_camera(sizes, *, rounds):
    camera = reference.camera()
    found = {}

    def run(n):
        return Task(lambda _: found.__setitem__(n, pl.point_spread(camera, (3.0, -2.0, -404.0), rays=n)))

    costs = taking_turns({str(n): run(n) for n in sizes}, rounds=rounds)
    rows = []
    for n in sizes:
        cost, spread = median(costs[str(n)]), found[n].of(0)
        error = 100 * float(np.ravel(spread.light_error)[0]) / float(np.ravel(spread.light)[0])
        rows.append((f"{n:,}", cost.wall, cost.cpu, 1e-6 * n / cost.cpu, error))
    columns = ("rays", "wall s", "CPU s", "million rays per CPU-second", "standard error of the light %")
    return Table("Point source through the reference camera, mode 2.0, all threads", columns, rows)
