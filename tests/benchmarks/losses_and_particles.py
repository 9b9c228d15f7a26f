"""What particles, losses of coatings and ghosts cost: CPU time at equal error, and the wall time of two threads."""

import dataclasses
import functools
import time

import numpy as np
import reference
from table import Table
from timing import apart, median, memory, taking_turns, timed

import plenoptic as pl


def tables(*, quick):
    yield particles(1000 if quick else 100_000, 512 if quick else 4096)
    yield losses(quick)
    yield ghosts(quick)


def particles(number, side):
    rows = [
        [f"{name}, {threads} thread{'s' * (threads > 1)}", *apart(traced, name, number, side, threads)]
        for name in ("weights", "image")
        for threads in (1, 2)
    ]
    remark = (
        "Points at random places in 100 x 100 x 40 mm around the plane in focus. Each row is a process of its own, "
    )
    remark += "with libraries of some 200 MiB. The first thread starts the others, and adds up while they trace."
    columns = "what | wall s | CPU s | CPU s of the first thread | error % | peak MiB"
    title = f"{number} particles, {side} x {side} pixels, double Gauss"
    return Table(title, columns, rows, [remark])


def traced(name, number, side, threads):
    """Wall and CPU seconds, those of the first thread, median error of a particle's light in %, and the peak in MiB."""
    camera = reference.built((side, side))
    positions = np.random.default_rng(0).uniform((-50, -50, -424), (50, 50, -384), (number, 3))

    def work(some):
        points = pl.Points(some, intensity=1.0)
        if name == "weights":
            return pl.rendering.point_weights(points, camera, progress=False, threads=threads)
        return pl.render(pl.Scene(points=points), camera, samples=1, progress=False, threads=threads)

    work(positions[:100])  # compiles
    begin = time.thread_time()
    cost, result = timed(work, positions)
    first = time.thread_time() - begin
    error = 100 * float(np.nanmedian(result.light_error / result.light)) if name == "weights" else None
    return [cost.wall, cost.cpu, first, error, int(memory("VmHWM") / 2**20)]


def losses(quick):
    """CPU time of the same samples with coatings over that without, and that at equal error."""
    side, samples, rounds = (16, 4, 1) if quick else (64, 256, 5)
    conventional = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(side, side))
    in_colour = dataclasses.replace(conventional, sensitivity=pl.sensitivities.linear_srgb())
    yellowish = dataclasses.replace(in_colour, lens=_absorbing(in_colour.lens))
    cases = {
        "`objects`": (pl.objects_scene(), reference.camera()),
        "a background": (pl.Scene(background=1.0), reference.camera()),
        "`check`, conventional": (pl.check_scene(), conventional),
        "`check`, conventional, wavelengths drawn": (pl.check_scene(), in_colour),
        "white, conventional, wavelengths drawn": (None, in_colour),
        "white, conventional, wavelengths drawn, absorbing glass": (None, yellowish),
        "white": (None, reference.camera()),
        "white, plates": (None, _with_plates(reference.camera())),
    }
    rows = []
    for name, (scene, camera) in cases.items():
        if camera.microlenses is not None and camera.microlenses.is_plate:
            coated = _with_plates(camera, coating=pl.optics.SingleLayer())
        else:
            coated = dataclasses.replace(camera, lens=pl.optics.coated(camera.lens, pl.optics.SingleLayer()))
        options = {"samples": samples, "threads": 1}
        if camera.microlenses is not None:
            options["region"] = reference.middle(side)
        work = {
            (which, turn): functools.partial(reference.exposed, scene, one, **options)
            for which, one in (("ideal", camera), ("coated", coated))
            for turn in ("first", "again")
        }
        costs, shots = taking_turns(work, rounds=rounds)
        setup = [median(costs[which, "first"]).cpu - median(costs[which, "again"]).cpu for which in ("ideal", "coated")]
        rows.append([name, *_compared(costs, shots, ("ideal", "again"), ("coated", "again")), *setup])
    columns = "image | CPU s, ideal | CPU s, coated | times | error %, ideal | error %, coated | times at equal error"
    columns += " | CPU s to set up, ideal | CPU s to set up, coated"
    remark = (
        f"{side} x {side} pixels, {samples} samples, one thread, medians of {rounds} in turns; a render before each "
        "sets up its camera; a single layer of MgF2 on all surfaces of the lens, or on plates of "
        "microlenses behind a lens without coatings."
    )
    return Table("Losses of coatings", columns, rows, [remark])


def _absorbing(lens):
    """The lens with glasses that absorb, which cost nothing without coatings."""
    elements = [
        dataclasses.replace(
            element,
            medium=pl.optics.AbsorbingGlass(element.medium, [300, 500, 900], [0.9, 0.99, 0.995], thickness=10.0),
        )
        if isinstance(element, pl.Surface) and element.medium is not pl.optics.AIR
        else element
        for element in lens.elements
    ]
    return dataclasses.replace(lens, elements=elements)


def _with_plates(camera, **changes):
    array = dataclasses.replace(camera.microlenses, model=pl.optics.MicrolensModel.SPHERICAL, **changes)
    return dataclasses.replace(camera, microlenses=array)


def ghosts(quick):
    """CPU time of an image with its ghosts over that without, at equal error of the sum."""
    side, samples, rounds = (16, 16, 1) if quick else (64, 256, 3)
    camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(side, side))
    options = {"samples": samples, "threads": 1, "progress": False}
    work = {"none": functools.partial(pl.render, pl.check_scene(), camera, **options)}
    numbers = (2, samples // 16, samples // 4)
    for number in numbers:
        settings = pl.rendering.Ghosts(samples=number)
        work[number] = functools.partial(pl.render, pl.check_scene(), camera, ghosts=settings, **options)
    costs, shots = taking_turns(work, rounds=rounds)
    setup = max(median(costs[2]).cpu - median(costs["none"]).cpu, 0.0)
    rows = [[number, *_compared(costs, shots, "none", number, setup)] for number in numbers[1:]]
    columns = (
        "samples of ghosts | CPU s without | CPU s with | times | error % without | error % with | times at equal error"
    )
    remark = f"`check` in a conventional camera, double Gauss, {side} x {side} pixels, {samples} samples, one thread, "
    remark += f"medians of {rounds} in turns, without {setup:.2g} CPU s to set up ghosts (2 samples of them)."
    return Table("Ghosts of 45 pairs", columns, rows, [remark])


def _compared(costs, shots, one, other, setup=0.0):
    seconds = [median(costs[one]).cpu, median(costs[other]).cpu - setup]
    errors = [100 * shots[which].relative_error for which in (one, other)]
    times = seconds[1] / seconds[0]
    return [*seconds, times, *errors, times * (errors[1] / errors[0]) ** 2]
