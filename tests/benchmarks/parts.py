"""What each part of a camera, colour and ground truth costs, against the plain camera at as many samples."""

import dataclasses
import math
import statistics
from typing import NamedTuple

import numpy as np
import reference
from table import Table
from timing import Cost, Task, taking_turns

import plenoptic as pl
from plenoptic.truth.channels import Truth

SHARE = 1.4826
"""Standard deviation over the median absolute deviation of normal numbers."""

BEFORE, AFTER = "plain camera", "plain camera, once more"


class Variant(NamedTuple):
    """A camera and what of the ground truth is wanted."""

    camera: pl.PlenopticCamera
    truth: Truth = Truth.NONE


def part_costs(*, quick):
    """CPU time of the reference camera with one part more, over that of the plain one."""
    samples, rounds, side = (1, 1, 32) if quick else (32, 9, 256)
    camera = reference.camera()
    variants = {BEFORE: Variant(camera)}
    variants |= {name: Variant(changed) for name, changed in cameras(camera).items()}
    variants |= {f"truth: {name}": Variant(camera, truth) for name, truth in TRUTHS.items()}
    if quick:
        variants = dict(list(variants.items())[:2])
    variants |= {AFTER: Variant(camera)}
    return compared(variants, samples=samples, rounds=rounds, side=side)


TRUTHS = {"depth": Truth.DEPTH, "position and normal": Truth.POSITION | Truth.NORMAL, "all channels": Truth.ALL}


def cameras(plain):
    """The plain camera with one thing more."""
    tilt = (math.radians(0.5), 0.0, 0.0)
    lines = pl.sensor.Sensitivity.lines((610.0, 550.0, 465.0))
    circle, clear = pl.optics.ApertureShape.CIRCLE, pl.optics.Gaps.CLEAR
    shifted = pl.sensor.AngularResponse(well_depth=0.8, pupil_distance=130.0)
    return {
        "tilted sensor": plain.moved(pl.CameraPart.SENSOR, tilt=tilt),
        "tilted array": plain.moved(pl.CameraPart.MICROLENSES, tilt=tilt),
        "tilted lens": plain.moved(pl.CameraPart.LENS, tilt=tilt),
        "three types of microlenses": _with_array(plain, focal_lengths=(1.9, 2.0, 2.1)),
        "round openings, fill factor 0.9": _with_array(plain, aperture=pl.optics.MicrolensAperture(circle, 0.9)),
        "clear gaps, fill factor 0.9": _with_array(plain, aperture=pl.optics.MicrolensAperture(circle, 0.9, clear)),
        "imperfections: listed lenses": _with_array(plain, imperfections=pl.MicrolensImperfections(pitch_jitter=0.002)),
        "pixel aperture 0.8 x 0.8": _with_sensor(plain, pixel_aperture=(0.8, 0.8)),
        "angular response": _with_sensor(plain, angular_response=shifted),
        "dust: 1e2 grains over the sensor": _dusty(plain, 100),
        "dust: 1e5 grains over the sensor": _dusty(plain, 100_000),
        "colour: three lines": dataclasses.replace(plain, sensitivity=lines),
        "colour: spectral": dataclasses.replace(plain, sensitivity=pl.sensitivities.colour_camera()),
    }


def _with_array(plain, **changes):
    return dataclasses.replace(plain, microlenses=dataclasses.replace(plain.microlenses, **changes))


def _with_sensor(plain, **changes):
    return dataclasses.replace(plain, sensor=dataclasses.replace(plain.sensor, **changes))


def _dusty(plain, grains):
    """So many grains that cover 1 % of the sensor, 0.5 mm above it."""
    half = 0.5 * plain.sensor.size[0]
    radius = math.sqrt(0.01 * (2 * half) ** 2 / (math.pi * grains))
    place = np.random.default_rng(0).uniform(-half, half, (grains, 2))
    dust = pl.Blemishes(pl.BlemishSite.SENSOR, place, place, np.full(grains, radius), np.zeros(grains), height=0.5)
    return dataclasses.replace(plain, blemishes=(dust,))


def compared(variants, *, samples, rounds, side):
    """CPU time of each variant over that of the plain camera in the same round, before and after it."""
    middle = slice(256 - side // 2, 256 + side // 2)
    scene = pl.check_scene()
    lit = {}

    def task(name, variant):
        def run(_):
            how = {"samples": samples, "region": (middle, middle), "truth": variant.truth, "threads": 1}
            shot = reference.exposed(scene, variant.camera, **how)
            lit[name] = 100 * shot.stats.fraction_through_lens

        return Task(run)

    costs = taking_turns({name: task(name, variant) for name, variant in variants.items()}, rounds=rounds)
    plain = [0.5 * (a.cpu + b.cpu) for a, b in zip(costs[BEFORE], costs[AFTER], strict=True)]
    rows = []
    for name in variants:
        more, error = _more(costs[name], costs[AFTER] if name == BEFORE else plain)
        million = 1e-6 * side**2 * samples
        rows.append((name, statistics.median(c.cpu for c in costs[name]) / million, lit[name], more, error))
    columns = ("camera", "CPU s per million paths", "% of paths leave the lens", "% more CPU time", "standard error")
    title = f"What parts cost: `check`, {side} x {side} pixels, {samples} samples, one thread, {rounds} rounds"
    remarks = (
        "Errors are of the median over the rounds. Ground truth is found once for each pixel, whatever the samples.",
    )
    return Table(title, columns, rows, remarks)


def _more(costs, plain):
    """Median over the rounds of the per cent by which a cost is above the plain one, and its standard error."""
    over = [100 * (cost.cpu / (p.cpu if isinstance(p, Cost) else p) - 1) for cost, p in zip(costs, plain, strict=True)]
    middle = statistics.median(over)
    spread = SHARE * statistics.median(abs(x - middle) for x in over)
    # The median of n normal numbers has a standard error of sqrt(pi / 2) / sqrt(n) standard deviations.
    return middle, math.sqrt(0.5 * math.pi / len(over)) * spread
