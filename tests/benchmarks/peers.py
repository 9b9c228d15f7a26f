"""Error against CPU time beside Mitsuba: the same scenes, thin lens and limit of depth."""

import importlib.util
import os
import statistics
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from table import Table
from timing import timed

import plenoptic as pl

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "validation"))
import mitsuba_scenes

SIDE = 64
PIXELS = SIDE * SIDE
BOUNCES = 8
LIT = 0.1  # of the 99th percentile of this package's reference
REFERENCE_SEED = 1_000_003
PARTS = 8
"""Renders whose mean is a reference; their spread is its error."""
SCENES = (
    *("lambertian_bodies", "metals", "glass", "textured", "environment", "many_lights"),
    *("fog", "haze", "cloud", "murky_glass", "objects"),
)
OURS = "plenoptic"

# Makers of renderers take a scene and a camera; renderers a number of samples and a seed, and give (H, W) radiance, the
# mean of the channels.


def tables(*, quick):
    rounds, converged, samples = (1, 8, (4,)) if quick else (5, 256, (16, 64, 256))
    programs, remarks = {OURS: plenoptic}, []
    if importlib.util.find_spec("mitsuba") is None:
        remarks.append("Mitsuba is left out: it is not installed; the extra `validation` has it.")
    else:
        programs[f"Mitsuba {variant()}"] = mitsuba
        if variant() == "scalar_rgb":
            remarks.append("`llvm_ad_rgb` is faster: DRJIT_LIBLLVM_PATH must name libLLVM.so, version 19.")
    rows, means = [], []
    for name in SCENES[-1:] if quick else SCENES:
        shown = Shown(name, programs, converged)
        rows += [shown.row(number, rounds) for number in samples]
        means += shown.references_compared()
        del shown  # Mitsuba's calls take longer with other scenes about
    columns = ["scene", "samples", *(f"{program}: {part}" for program in programs for part in ("CPU ms/px", "RMS %"))]
    columns += ["theirs over ours, RMS^2 x CPU", "least and most of the rounds"][: 2 * len(programs) - 2]
    remark = (
        f"{SIDE} x {SIDE} pixels through a thin lens, at most {BOUNCES} bounces, each program with its own Russian "
        f"roulette, one thread, whole warm calls in turns, medians of {rounds} rounds, one replicate. Errors of lit "
        "pixels, mean of the channels, relative to a reference of the program's own."
    )
    yield Table("Other renderers: error and time", columns, rows, [remark, *remarks])
    if means:
        columns = "scene | its mean over plenoptic's, less 1, % | standard error % | RMS z of lit pixels"
        yield Table("Other renderers: their references beside plenoptic's", columns, means)


def variant():
    """Mitsuba's fastest variant that is installed, of those without a graphics card."""
    return "llvm_ad_rgb" if "DRJIT_LIBLLVM_PATH" in os.environ else "scalar_rgb"


def plenoptic(scene, camera):
    white = mitsuba_scenes.projected_solid_angles(camera)

    def render(samples, seed):
        settings = {"max_bounces": BOUNCES, "replicates": 1, "threads": 1, "truth": pl.Truth.NONE, "progress": False}
        shot = pl.render(scene, camera, samples=samples, seed=seed, **settings)
        return np.asarray((shot.image / white).mean(axis=2, dtype=np.float64))

    return render


def mitsuba(scene, camera):
    import drjit
    import in_mitsuba
    import mitsuba as mi

    drjit.set_thread_count(1)
    mi.set_variant(variant())
    described = in_mitsuba.described_scene(scene, camera, max_bounces=BOUNCES)
    described["integrator"]["rr_depth"] = 5  # Mitsuba's own default
    described["sensor"]["sampler"] = {"type": "multijitter"}
    loaded = mi.load_dict(described)

    def render(samples, seed):
        shown = loaded.integrator().render(loaded, spp=samples, seed=seed)  # mi.render would switch variants, for 70 ms
        return np.array(shown, dtype=np.float64).mean(axis=2)

    return render


class Reference(NamedTuple):
    """A converged picture and its standard error."""

    image: np.ndarray
    standard_error: np.ndarray


def reference_of(render, samples):
    parts = np.array([render(samples, REFERENCE_SEED + part) for part in range(PARTS)])
    return Reference(parts.mean(axis=0), parts.std(axis=0, ddof=1) / np.sqrt(PARTS))


class Shown:
    """A scene in all programs, with a reference of each."""

    def __init__(self, name, programs, converged):
        width, position = (4.8, (0, 0, 404)) if name == "objects" else (7.2, mitsuba_scenes.VIEWED_FROM)
        camera = mitsuba_scenes.camera(semi_diameter=5.0, pixel_pitch=width / SIDE, position=position, pixels=SIDE)
        self.name, scene = name, getattr(mitsuba_scenes, name)()
        self.renderers = [maker(scene, camera) for maker in programs.values()]
        self.references = [reference_of(render, converged) for render in self.renderers]
        image = self.references[0].image
        self.lit = image > LIT * np.percentile(image, 99)

    def row(self, samples, rounds):
        """Cost and error of each program, and the ratio of RMS^2 x CPU in each round; a first round is not counted."""
        ms, variance = np.zeros((2, len(self.renderers), rounds + 1))
        for seed in range(rounds + 1):
            for k, (render, reference) in enumerate(zip(self.renderers, self.references, strict=True)):
                cost, image = timed(render, samples, seed)
                error = image[self.lit] / reference.image[self.lit] - 1.0
                uncertainty = reference.standard_error[self.lit] / reference.image[self.lit]
                ms[k, seed], variance[k, seed] = 1e3 * cost.cpu / PIXELS, np.mean(error**2) - np.mean(uncertainty**2)
        ms, rms = ms[:, 1:], 100 * np.sqrt(np.maximum(variance[:, 1:].mean(axis=1), 0.0))
        cells = [cell for k in range(len(ms)) for cell in (float(np.median(ms[k])), float(rms[k]))]
        if len(ms) == 1:
            return [self.name, samples, *cells]
        ratios = (variance[1, 1:] * ms[1] / (variance[0, 1:] * ms[0])).tolist()
        spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
        return [self.name, samples, *cells, round(statistics.median(ratios), 2), spread]

    def references_compared(self):
        """Difference of the references of both programs."""
        ours = self.references[0]
        for theirs in self.references[1:]:
            error = np.hypot(ours.standard_error, theirs.standard_error)
            chosen = self.lit & (error > 0)
            z = (theirs.image - ours.image)[chosen] / error[chosen]
            of_mean = 100 * np.sqrt(np.mean(error**2) / PIXELS) / ours.image.mean()
            mean = 100 * (theirs.image.mean() / ours.image.mean() - 1)
            yield self.name, float(mean), float(of_mean), float(np.sqrt(np.mean(z**2)))
