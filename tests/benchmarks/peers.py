"""Error against CPU time beside Mitsuba: the same scenes, thin lens and limit of depth."""

import functools
import importlib.util
import os
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from table import Table
from timing import median, timed

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
SCENES = ("lambertian_bodies", "metals", "glass", "textured", "environment", "many_lights", "objects")
OURS = "plenoptic"

# Makers of renderers take a scene and a camera; renderers a number of samples and a seed, and give (H, W) radiance, the
# mean of the channels.


def tables(*, quick):
    programs, absent = installed()
    seeds, converged, one, several = (1, 8, 4, (1, 4)) if quick else (3, 256, 256, (4, 16, 64))
    at_one, at_several, means = [], [], []
    for name in SCENES[-1:] if quick else SCENES:
        # Each scene is gone before the next: Mitsuba's calls take longer with others about.
        shown = Shown(name, programs, converged)
        at_one += shown.errors(one, seeds)
        if name in (SCENES[0], SCENES[-1]):
            at_several += [row for samples in several for row in shown.errors(samples, seeds)]
        means += shown.compared()
        del shown
    columns = "scene | samples | program | CPU ms per pixel | median relative error % | relative RMS error % | "
    columns += "RMS^2 x CPU, us per pixel | over plenoptic's"
    remark = (
        f"{SIDE} x {SIDE} pixels through a thin lens, at most {BOUNCES} bounces, each program with its own Russian "
        f"roulette, one thread, whole warm calls in turns, one replicate. Lit pixels, mean of the channels, against a "
        f"reference of the program's own. {absent}"
    )
    yield Table("Other renderers: error against time, one number of samples", columns, at_one, [remark])
    yield Table("Other renderers: error against time, several", columns, at_several, [remark])
    if means:
        columns = "scene | program | its mean over plenoptic's, less 1, % | standard error % | RMS z of lit pixels"
        yield Table("Other renderers: their references beside plenoptic's", columns, means)


def installed():
    """Renderers that can be had here, and sentences on those that cannot."""
    programs = {OURS: plenoptic}
    absent, with_llvm = "", "DRJIT_LIBLLVM_PATH" in os.environ
    if importlib.util.find_spec("mitsuba") is None:
        absent += "Mitsuba is left out: it is not installed; the extra `validation` has it. "
    else:
        for variant in ("scalar_rgb", "llvm_ad_rgb")[: 1 + with_llvm]:
            for sampler in ("independent", "multijitter"):
                programs[f"Mitsuba {variant}, {sampler}"] = functools.partial(mitsuba, variant, sampler)
    if len(programs) == 3:
        absent += "`llvm_ad_rgb` is left out: DRJIT_LIBLLVM_PATH must name libLLVM.so, version 19 (older ones crash). "
    return programs, absent


def plenoptic(scene, camera):
    white = mitsuba_scenes.projected_solid_angles(camera)

    def render(samples, seed):
        settings = {"max_bounces": BOUNCES, "replicates": 1, "threads": 1, "truth": pl.Truth.NONE, "progress": False}
        shot = pl.render(scene, camera, samples=samples, seed=seed, **settings)
        return np.asarray((shot.image / white).mean(axis=2, dtype=np.float64))

    return render


def mitsuba(variant, sampler, scene, camera):
    import drjit
    import in_mitsuba
    import mitsuba as mi

    drjit.set_thread_count(1)
    mi.set_variant(variant)
    described = in_mitsuba.described_scene(scene, camera, max_bounces=BOUNCES)
    described["integrator"]["rr_depth"] = 5  # Mitsuba's own default
    described["sensor"]["sampler"] = {"type": sampler}
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
    """A scene in all renderers, with a reference of each family of them."""

    def __init__(self, name, programs, converged):
        width, place = (4.8, (0, 0, 404)) if name == "objects" else (7.2, mitsuba_scenes.VIEWED_FROM)
        camera = mitsuba_scenes.camera(semi_diameter=5.0, pixel_pitch=width / SIDE, position=place, pixels=SIDE)
        self.name, scene = name, getattr(mitsuba_scenes, name)()
        self.renderers = {program: maker(scene, camera) for program, maker in programs.items()}
        best = {program.split()[0]: program for program in programs}  # the last of a family converges fastest
        self.references = {family: reference_of(self.renderers[best[family]], converged) for family in best}
        image = self.references[OURS].image
        self.lit = image > LIT * np.percentile(image, 99)

    def errors(self, samples, seeds):
        """Of each program: what a number of samples costs, and how far it is off; all in turns, first unseen."""
        found = {program: [] for program in self.renderers}
        for seed in range(seeds + 1):
            for program, render in self.renderers.items():
                found[program].append(timed(render, samples, seed))
        first = None
        for program, (_, *runs) in found.items():
            reference = self.references[program.split()[0]]
            off = np.array([image[self.lit] / reference.image[self.lit] - 1.0 for _, image in runs])
            own = np.mean((reference.standard_error[self.lit] / reference.image[self.lit]) ** 2)
            ms, rms = 1e3 * median([cost for cost, _ in runs]).cpu / PIXELS, np.sqrt(max(np.mean(off**2) - own, 0.0))
            worth = rms**2 * ms
            first = worth if first is None else first
            errors = 100 * float(np.median(np.abs(off))), 100 * float(rms)
            yield self.name, samples, program, ms, *errors, 1e3 * float(worth), float(worth / first)

    def compared(self):
        """Whether references show the same as this package's."""
        ours = self.references[OURS]
        for family, theirs in list(self.references.items())[1:]:
            error = np.hypot(ours.standard_error, theirs.standard_error)
            z = ((theirs.image - ours.image) / error)[self.lit & (error > 0)]
            of_mean = 100 * np.sqrt(np.mean(error**2) / PIXELS) / ours.image.mean()
            mean = 100 * (theirs.image.mean() / ours.image.mean() - 1)
            yield self.name, family, float(mean), float(of_mean), float(np.sqrt(np.mean(z**2)))
