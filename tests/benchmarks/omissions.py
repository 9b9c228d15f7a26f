"""Cost of parts: the plain camera with one part more. `plenoptic study cost` leaves stages of bundled cases out."""

import dataclasses
import math
from functools import partial

import numpy as np
import reference
from table import Table
from timing import median, taking_turns

import plenoptic as pl
from plenoptic.truth.channels import Truth

SHARE = 1.4826
"""Standard deviation over the median absolute deviation of normal numbers."""

BEFORE, AFTER = "plain camera", "plain camera, once more"
TRUTHS = {"depth": Truth.DEPTH, "position and normal": Truth.POSITION | Truth.NORMAL, "all channels": Truth.ALL}


def tables(*, quick):
    yield part_costs(quick=quick)


def part_costs(*, quick):
    """CPU time of the reference camera with one part more, over that of the plain one."""
    samples, rounds, side = (1, 1, 32) if quick else (32, 9, 256)
    plain = reference.camera()
    variants = {BEFORE: (plain, Truth.NONE)}
    variants |= {name: (changed, Truth.NONE) for name, changed in cameras(plain).items()}
    variants |= {f"truth: {name}": (plain, truth) for name, truth in TRUTHS.items()}
    if quick:
        variants = dict(list(variants.items())[:2])
    variants |= {AFTER: (plain, Truth.NONE)}
    return compared(variants, samples=samples, rounds=rounds, side=side)


def cameras(plain):
    """The plain camera with one thing more."""
    tilt = (math.radians(0.5), 0.0, 0.0)
    circle, clear = pl.optics.ApertureShape.CIRCLE, pl.optics.Gaps.CLEAR

    def array(**changes):
        return dataclasses.replace(plain, microlenses=dataclasses.replace(plain.microlenses, **changes))

    def sensor(**changes):
        return dataclasses.replace(plain, sensor=dataclasses.replace(plain.sensor, **changes))

    def sensitive(sensitivity):
        return dataclasses.replace(plain, sensitivity=sensitivity)

    return {
        "tilted sensor": plain.moved(pl.CameraPart.SENSOR, tilt=tilt),
        "tilted array": plain.moved(pl.CameraPart.MICROLENSES, tilt=tilt),
        "tilted lens": plain.moved(pl.CameraPart.LENS, tilt=tilt),
        "three types of microlenses": array(focal_lengths=(1.9, 2.0, 2.1)),
        "round openings, fill factor 0.9": array(aperture=pl.optics.MicrolensAperture(circle, 0.9)),
        "clear gaps, fill factor 0.9": array(aperture=pl.optics.MicrolensAperture(circle, 0.9, clear)),
        "imperfections: listed lenses": array(imperfections=pl.MicrolensImperfections(pitch_jitter=0.002)),
        "pixel aperture 0.8 x 0.8": sensor(pixel_aperture=(0.8, 0.8)),
        "angular response": sensor(angular_response=pl.sensor.AngularResponse(well_depth=0.8, pupil_distance=130.0)),
        "dust: 1e2 grains over the sensor": _dusty(plain, 100),
        "dust: 1e5 grains over the sensor": _dusty(plain, 100_000),
        "colour: three lines": sensitive(pl.sensor.Sensitivity.lines((610.0, 550.0, 465.0))),
        "colour: spectral": sensitive(pl.sensitivities.colour_camera()),
    }


def _dusty(plain, grains):
    """So many grains that cover 1 % of the sensor, 0.5 mm above it."""
    half = 0.5 * plain.sensor.size[0]
    radius = math.sqrt(0.01 * (2 * half) ** 2 / (math.pi * grains))
    place = np.random.default_rng(0).uniform(-half, half, (grains, 2))
    dust = pl.Blemishes(pl.BlemishSite.SENSOR, place, place, np.full(grains, radius), np.zeros(grains), height=0.5)
    return dataclasses.replace(plain, blemishes=(dust,))


def compared(variants, *, samples, rounds, side):
    """CPU time of each variant over that of the plain camera in the same round, before and after it."""
    how = {"samples": samples, "region": reference.middle(side), "threads": 1}
    render, scene = partial(reference.exposed, **how), pl.check_scene()
    tasks = {name: partial(render, scene, camera, truth=truth) for name, (camera, truth) in variants.items()}
    costs, shots = taking_turns(tasks, rounds=rounds)
    cpu = {name: np.array([cost.cpu for cost in each]) for name, each in costs.items()}
    rows = []
    for name, shot in shots.items():
        over = 100 * (cpu[name] / (cpu[AFTER] if name == BEFORE else 0.5 * (cpu[BEFORE] + cpu[AFTER])) - 1)
        more = float(np.median(over))
        # The median of n normal numbers has a standard error of sqrt(pi / 2) / sqrt(n) standard deviations.
        error = math.sqrt(0.5 * math.pi / rounds) * SHARE * float(np.median(np.abs(over - more)))
        million = 1e-6 * side**2 * samples
        rows.append((name, median(costs[name]).cpu / million, 100 * shot.stats.fraction_through_lens, more, error))
    columns = "camera | CPU s per million paths | % of paths leave the lens | % more CPU time | standard error"
    title = f"What parts cost: `check`, {side} x {side} pixels, {samples} samples, one thread, {rounds} rounds"
    remarks = (
        "Errors are of the median over the rounds. Ground truth is found once for each pixel, whatever the samples.",
    )
    return Table(title, columns, rows, remarks)
