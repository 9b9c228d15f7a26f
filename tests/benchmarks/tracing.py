"""Lens tracing in float64, arrays in and arrays out, beside batoid."""

import dataclasses
import importlib.util
import os
from functools import partial

import numpy as np
from table import Table
from timing import Task, cost_of, median, taking_turns

import plenoptic as pl

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before batoid is imported: one thread for both programs

LENSES = ("double-gauss-100mm-f2", "double-gauss-105mm-f1.4", "achromat-100mm-f4.4")
WANTED, FEW = 16, 8
TOLERANCE = 1e-9  # mm; a dozen refractions at 100 mm leave some 1e-12 of rounding, a wrong surface leaves much more
SPHERES = "spheres"
OURS, BARE, CLIPPING = "plenoptic", "batoid", "batoid, with semi-diameters and stop"


def tables(*, quick):
    yield beside_batoid(10_000 if quick else 1_000_000, rounds=2 if quick else 7)
    yield shapes(10_000 if quick else 1_000_000, rounds=2 if quick else 9)
    yield directions_and_sizes(10_000 if quick else 1_000_000, rounds=2 if quick else 7)


def rays_towards(lens, n, *, z=-404.0, field=5.0):
    """Random rays from a square in front of the lens that fill its first surface's middle half."""
    random = np.random.default_rng(0)
    origin = np.column_stack([random.uniform(-field, field, (n, 2)), np.full(n, z)])
    reach = 0.5 * lens.elements[0].semi_diameter
    target = np.column_stack([random.uniform(-reach, reach, (n, 2)), np.full(n, lens.vertices[0])])
    along = target - origin
    return pl.RayBundle(origin, along / np.linalg.norm(along, axis=1, keepdims=True))


def refracting(lens):
    return sum(isinstance(element, pl.Surface) for element in lens.elements)


def beside_batoid(n, *, rounds):
    installed = importlib.util.find_spec("batoid") is not None
    rows = []
    for name in LENSES:
        lens = pl.load_lens(name)
        rays = rays_towards(lens, n)
        tasks = {OURS: Task(lambda _, lens=lens, rays=rays: lens.trace(rays, threads=1))}
        if installed:
            bare, clipping = batoid_lens(lens, clips=False), batoid_lens(lens, clips=True)
            _check_agreement(lens, rays, clipping)
            # batoid overwrites its rays; the copy is not timed.
            tasks[BARE] = Task(bare.trace, partial(batoid_rays, rays))
            tasks[CLIPPING] = Task(clipping.trace, partial(batoid_rays, rays))
        costs = {program: median(cost) for program, cost in taking_turns(tasks, rounds=rounds).items()}
        work = 1e-6 * n * refracting(lens)
        for program, cost in costs.items():
            rows.append((name, refracting(lens), program, *cost, work / cost.cpu, cost.cpu / costs[OURS].cpu))
    columns = (
        "lens | refracting surfaces | program | wall s | CPU s | million ray-surfaces per CPU-second | times "
        "plenoptic's CPU time"
    )
    agreement = f"Both programs' rays end within {TOLERANCE:g} mm of each other, and the same ones are clipped."
    wanted = (
        f"Wanted: {WANTED} times batoid, {FEW} with few surfaces. Only refracting surfaces count; the stop comes "
        f"on top in `{OURS}` and in `{CLIPPING}`, while `{BARE}` clips nothing and is timed without the copy of "
        "its rays, which it overwrites. Medians of alternating runs."
    )
    absent = "batoid is not installed: pip install '.[validation]' adds it to this table."
    title = f"Lens tracing, {n:,} rays, float64, one thread"
    return Table(title, columns, rows, [wanted, agreement if installed else absent])


def shapes(n, *, rounds):
    """What conics, aspheres and places out of the axis cost a lens of which one surface has them."""
    lens = pl.load_lens(LENSES[0])
    rays = rays_towards(lens, n)
    variants = {
        SPHERES: lens,
        "one conic": _shaped(lens, conic=-0.5),
        "one asphere, r^4 to r^8": _shaped(lens, conic=-0.5, aspheric=(0.0, 1e-8, 1e-12, 1e-16)),
        "one asphere, r^4 to r^16": _shaped(lens, conic=-0.5, aspheric=(0.0, 1e-8, 1e-12, 1e-16, 0, 0, 0, 1e-30)),
        "one surface tilted": lens.moved(0, tilt=(0.001, 0.0, 0.0)),
        "all tilted": lens.moved(slice(None), tilt=(0.001, 0.0, 0.0)),
        "LensModel.PARAXIAL": lens.with_model(pl.LensModel.PARAXIAL),
    }
    tasks = {name: Task(lambda _, lens=lens: lens.trace(rays, threads=1)) for name, lens in variants.items()}
    costs = {name: median(cost) for name, cost in taking_turns(tasks, rounds=rounds).items()}
    pass_ = {name: float(np.mean(variants[name].trace(rays).status == 0)) for name in costs}
    rows = [(name, pass_[name], *cost, cost.cpu / costs[SPHERES].cpu) for name, cost in costs.items()]
    remark = "Wanted: one asphere at most 1.5 times the time of spheres alone. Medians of alternating runs."
    columns = "lens | share of rays that pass | wall s | CPU s | times the CPU time of spheres alone"
    return Table(f"Lens tracing: shapes and places, {n:,} rays, one thread", columns, rows, [remark])


def _shaped(lens, **fields):
    """The lens with another shape for its first surface."""
    changed = dataclasses.replace(lens.elements[0], **fields)
    return dataclasses.replace(lens, elements=[changed, *lens.elements[1:]])


def batoid_lens(lens, *, clips):
    """The same surfaces for batoid, in mm; with `clips` their semi-diameters and the stop too."""
    import batoid

    indices = lens.indices(587.6)
    items = []
    for i, (z, element) in enumerate(zip(lens.vertices, lens.elements, strict=True)):
        place = batoid.CoordSys([0.0, 0.0, float(z)])
        opening = batoid.ObscNegation(batoid.ObscCircle(element.semi_diameter)) if clips else None
        before, behind = (batoid.ConstMedium(float(index)) for index in indices[i : i + 2])
        media = {"inMedium": before, "outMedium": behind}
        if isinstance(element, pl.Surface):
            shape = batoid.Plane() if np.isinf(element.radius) else batoid.Sphere(element.radius)
            items.append(batoid.RefractiveInterface(shape, obscuration=opening, name=str(i), coordSys=place, **media))
        elif clips:
            items.append(batoid.Baffle(batoid.Plane(), obscuration=opening, name=str(i), coordSys=place, **media))
    return batoid.CompoundOptic(items, name="lens")


def batoid_rays(rays):
    import batoid

    wavelength = 1e-9 * rays.wavelength
    return batoid.RayVector(*rays.origin.T.copy(), *rays.direction.T.copy(), wavelength=wavelength)


def _check_agreement(lens, rays, optic):
    ours, theirs = lens.trace(rays), optic.trace(batoid_rays(rays))
    arrived = ours.status == pl.RayStatus.OK
    assert arrived.mean() > 0.5, "most rays are to pass the lens"
    np.testing.assert_array_equal(arrived, ~(theirs.vignetted | theirs.failed))
    ends = theirs.r[arrived] + [0.0, 0.0, lens.vertices[-1]]  # batoid's z begins at the last vertex
    np.testing.assert_allclose(ours.origin[arrived], ends, rtol=0, atol=TOLERANCE)
    # batoid's rays have velocities; in air of index 1 these are directions.
    np.testing.assert_allclose(ours.direction[arrived], theirs.v[arrived], rtol=0, atol=TOLERANCE)


def directions_and_sizes(most, *, rounds):
    """Both ways through the lens, small bundles and large ones, on one thread and on two."""
    lens = pl.load_lens(LENSES[0])
    rows = []
    for n in sorted({1, 100, 10_000, most}):
        rays = rays_towards(lens, n)
        out = lens.trace(rays)
        back = pl.RayBundle(out.origin, -out.direction)  # as many as came through; the others stay lost
        calls = max(1, min(1000, 100_000 // n))
        for way, trace, bundle in (("forward", lens.trace, rays), ("reverse", lens.trace_reverse, back)):
            for threads in (1, 2) if n == most else (1,):
                task = Task(lambda _, t=trace, b=bundle, k=threads: t(b, threads=k))
                cost_of(task)
                cost = median([cost_of(task, calls=calls) for _ in range(rounds)])
                rows.append((f"{n:,}", way, threads, *_rates(cost, n, lens)))
    columns = "rays | way | threads | microseconds per call | million ray-surfaces per wall second | per CPU-second"
    return Table(f"Lens tracing: {lens.name}, both ways, small bundles and two threads", columns, rows)


def _rates(cost, n, lens):
    work = 1e-6 * n * refracting(lens)
    return 1e6 * cost.wall, work / cost.wall, work / cost.cpu
