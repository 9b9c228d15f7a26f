"""Lens tracing in float64, arrays in and arrays out, beside batoid."""

import dataclasses
import importlib.util
import os
import sys
from functools import partial
from pathlib import Path

import numpy as np
from table import Table
from timing import median, taking_turns

import plenoptic as pl

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before batoid is imported: one thread for both programs
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "validation"))

LENSES = ("double-gauss-100mm-f2", "double-gauss-105mm-f1.4", "achromat-100mm-f4.4")
WANTED, FEW = 16, 8
SPHERES = "spheres"
OURS, BARE, CLIPPING = "plenoptic", "batoid", "batoid, with semi-diameters and stop"


def tables(*, quick):
    n = 10_000 if quick else 1_000_000
    yield beside_batoid(n, rounds=2 if quick else 7)
    yield shapes(n, rounds=2 if quick else 9)


def rays_towards(lens, n, *, z=-404.0, field=5.0):
    """Random rays from a square in front of the lens that fill its first surface's middle half."""
    random = np.random.default_rng(0)
    origin = np.column_stack([random.uniform(-field, field, (n, 2)), np.full(n, z)])
    reach = 0.5 * lens.elements[0].semi_diameter
    target = np.column_stack([random.uniform(-reach, reach, (n, 2)), np.full(n, lens.vertices[0])])
    return pl.RayBundle(origin, target - origin)


def refracting(lens):
    return sum(isinstance(element, pl.Surface) for element in lens.elements)


def beside_batoid(n, *, rounds):
    installed = importlib.util.find_spec("batoid") is not None
    rows = []
    for name in LENSES:
        lens = pl.load_lens(name)
        rays = rays_towards(lens, n)
        tasks, prepare = {OURS: partial(lens.trace, rays, threads=1)}, {}
        if installed:
            import in_batoid

            in_batoid.assert_same(lens, rays, at_least=0.5)
            tasks |= {BARE: in_batoid.optic_of(lens, clips=False).trace, CLIPPING: in_batoid.optic_of(lens).trace}
            # batoid overwrites its rays; the copy is not timed.
            prepare = dict.fromkeys((BARE, CLIPPING), partial(in_batoid.rays_of, rays))
        turns, _ = taking_turns(tasks, rounds=rounds, prepare=prepare)
        costs = {program: median(each) for program, each in turns.items()}
        work = 1e-6 * n * refracting(lens)
        for program, cost in costs.items():
            rows.append((name, refracting(lens), program, *cost, work / cost.cpu, cost.cpu / costs[OURS].cpu))
    columns = "lens | refracting surfaces | program | wall s | CPU s | million ray-surfaces per CPU-second | times "
    columns += "plenoptic's CPU time"
    wanted = (
        f"Wanted: {WANTED} times batoid, {FEW} with few surfaces. Only refracting surfaces count; the stop comes "
        f"on top in `{OURS}` and in `{CLIPPING}`, while `{BARE}` clips nothing and is timed without the copy of "
        "its rays, which it overwrites. Medians of alternating runs."
    )
    agreement = "Both programs' rays end within 1e-9 mm of each other, and the same ones are clipped."
    absent = "batoid is not installed: pip install '.[validation]' adds it to this table."
    title = f"Lens tracing, {n:,} rays, float64, one thread"
    return Table(title, columns, rows, [wanted, agreement if installed else absent])


def shapes(n, *, rounds):
    """What conics, aspheres and places out of the axis cost a lens of which one surface has them."""
    lens = pl.load_lens(LENSES[0])
    rays, reach = rays_towards(lens, n), lens.elements[0].semi_diameter

    def shaped(**fields):
        """Another shape for its first surface."""
        changed = dataclasses.replace(lens.elements[0], conic=-0.5, **fields)
        return dataclasses.replace(lens, elements=[changed, *lens.elements[1:]])

    variants = {
        SPHERES: lens,
        "one conic": shaped(),
        "one asphere, r^4 to r^8": shaped(aspheric=(0.0, 1e-8, 1e-12, 1e-16)),
        "one asphere, r^4 to r^16": shaped(aspheric=(0.0, 1e-8, 1e-12, 1e-16, 0, 0, 0, 1e-30)),
        "one surface with 15 Zernike terms": shaped(freeform=pl.optics.ZernikeSag([1e-3] * 15, reach)),
        "one surface tilted": lens.moved(0, tilt=(0.001, 0.0, 0.0)),
        "all tilted": lens.moved(slice(None), tilt=(0.001, 0.0, 0.0)),
        "LensModel.PARAXIAL": lens.with_model(pl.LensModel.PARAXIAL),
    }
    tasks = {name: partial(changed.trace, rays, threads=1) for name, changed in variants.items()}
    costs, traced = taking_turns(tasks, rounds=rounds)
    once = median(costs[SPHERES]).cpu
    rows = [
        (name, float(np.mean(traced[name].status == 0)), *median(cost), median(cost).cpu / once)
        for name, cost in costs.items()
    ]
    remark = "Wanted: one asphere at most 1.5 times the time of spheres alone, Zernike terms 1.6. Medians in turns."
    columns = "lens | share of rays that pass | wall s | CPU s | times the CPU time of spheres alone"
    return Table(f"Lens tracing: shapes and places, {n:,} rays, one thread", columns, rows, [remark])
