"""Is the standard error right? True errors of many seeds against a converged reference, beside what is stated."""

import dataclasses
import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import reference
from table import Table

import plenoptic as pl
from plenoptic.truth.channels import Truth

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "validation"))
import mitsuba_scenes as scenes  # noqa: E402

REFERENCE_SEED = 1_000_003
REPLICATES = 16
TARGETS = {"white": 0.02, "`check`": 0.02, "room, 8 bounces": 0.02, "`objects`: beside the cube": 0.15}
LIT = 0.1  # of the reference's 99th percentile of channel means
FILM_TARGET = 0.1
STUDENT = 2.13145  # 95 % of Student's t distribution with 15 degrees of freedom lie within


def tables(*, quick):
    side, seeds, converged = (8, 2, 1 << 10) if quick else (24, 16, 1 << 15)
    numbers = (64,) if quick else (64, 256, 1024)
    fixed, adaptive = [], []
    for subject in subjects(side):
        name, truth = subject.name, Converged(subject, converged)
        for samples in numbers:
            found = honesty(truth, range(seeds), samples=samples)
            fixed.append((name, samples, 100 * found.error, *_cells(found)))
        if name in TARGETS:
            target = 5 * TARGETS[name] if quick else TARGETS[name]
            found = honesty(truth, range(seeds), target_error=target)
            reached = 100 * target, 100 * found.stated, 100 * found.error, round(found.samples)
            adaptive.append((name, *reached, *_cells(found)))
    shared = (
        "true over standard error | mean error / its standard error | 95 % intervals that hold: all lit pixels % | "
        "where one sample weighs less than the true error % | these pixels %"
    )
    remark = (
        f"{side} x {side} pixels, {REPLICATES} replicates, {seeds} seeds a row, references of {converged} samples with "
        "another seed, whose own variance is subtracted. Errors are relative RMS over lit pixels. Of three channels "
        "the mean error is that of the one that is farthest off."
    )
    columns = f"scene | samples | error % | {shared}"
    yield Table("Is the standard error right? A fixed number of samples", columns, fixed, [remark])
    columns = f"scene | target % | stated error % | true error % | samples, mean | {shared}"
    yield Table("The same with a target error", columns, adaptive, [remark])
    yield _reported(quick=quick)


def _reported(*, quick):
    """What an exposure says of its own error, on films that show whole scenes."""
    side, seeds, converged = (16, 2, 256) if quick else (64, 24, 1 << 14)
    rows = []
    for film in films(side):
        truth = Converged(film, converged)
        target = 0.5 if quick else FILM_TARGET
        budgets = {f"{n} samples": {"samples": n} for n in ((32,) if quick else (32, 128))}
        for name, budget in (budgets | {f"target {100 * target:g} %": {"target_error": target}}).items():
            found = honesty(truth, range(seeds), replicates=2, **budget)
            errors = f"{100 * found.error:.2f}", f"{100 * found.stated:.2f}", f"{found.stated / found.error:.3f}"
            rows.append((film.name, name, round(found.samples), *errors, round(found.rare * seeds)))
    remark = (
        f"{side} x {side} pixels, 2 replicates, {seeds} seeds a row, references of {converged} samples. RMS over seeds "
        "and lit pixels of the reference. Rare: how many exposures say that light is too rare to know their error."
    )
    columns = "scene | ends by | samples | true error % | reported % | reported over true | rare"
    return Table("What exposures report", columns, rows, [remark])


def _cells(found):
    ratio = f"{found.ratio:.3f} ± {found.ratio_error:.3f}"
    spread = None if math.isnan(found.covered_spread) else f"{100 * found.covered_spread:.1f}"
    return ratio, f"{found.mean_error:+.2f}", f"{100 * found.covered:.1f}", spread, f"{100 * found.spread:.0f}"


class Subject(NamedTuple):
    """A crop that is rendered; a scene of None is the white image."""

    name: str
    scene: pl.Scene | None
    camera: pl.PlenopticCamera
    region: tuple[slice, slice]
    options: dict[str, object] = {}


class Honesty(NamedTuple):
    """What stated errors are worth. Shares are of lit pixels and channels, over all seeds."""

    error: float  # RMS over lit pixels of the true error over the brightness
    stated: float  # `Exposure.relative_error`, RMS over the seeds
    samples: float  # mean over lit pixels
    ratio: float  # RMS of the true error over RMS of the standard error
    ratio_error: float
    mean_error: float  # the farthest of the channels, in its standard errors
    covered: float  # share of 95 % intervals that hold the truth
    covered_spread: float  # the same where the true standard error is at least mean / n
    spread: float  # share of these pixels
    rare: float  # share of the exposures whose light is too rare
    shots: list[pl.Exposure]


def room():
    """Four matt walls under a ceiling that shines, open to the camera: three fifths of its light come by bounces."""
    right, up, deep, matt = (14, 0, 0), (0, 14, 0), (0, 0, 24), pl.Lambertian(0.7)
    edges = (right, up), (deep, right), (up, deep)
    walls = [pl.quad((-7, -7, -411), *both, material=matt) for both in edges]
    walls.append(pl.quad((7, -7, -411), deep, up, material=matt))
    ceiling = pl.quad((-7, 7, -411), right, deep, material=pl.Emissive(1.0, two_sided=True))
    return pl.Scene([*walls, ceiling])


def coloured():
    """Matt plates of two colours under a lamp of a third."""
    floor = pl.quad((-30, -30, -404), (60, 0, 0), (0, 60, 0), material=pl.Lambertian((0.8, 0.5, 0.1)))
    plate = pl.quad((-3, -3, -402), (3, 0, 1), (0, 6, 0), material=pl.Lambertian((0.1, 0.3, 0.9)))
    lamp = pl.QuadLight((0, 30, -360), (20, 0, 0), (0, 12, -16), radiance=(3.0, 5.0, 9.0), two_sided=True)
    return pl.Scene(meshes=[floor, plate], lights=[lamp], background=(0.2, 0.1, 0.3))


def subjects(side):
    camera = reference.camera()
    colour = dataclasses.replace(camera, sensitivity=pl.sensitivities.colour_camera())

    def crop(row, column):
        return np.s_[row : row + side, column : column + side]

    objects, direct = pl.objects_scene(), {"max_bounces": 1}
    places = {"board": (40, 40), "metal ball": (310, 340), "glass ball": (110, 200), "beside the cube": (310, 150)}
    return [
        Subject("white", None, camera, crop(240, 240)),
        Subject("`check`", pl.check_scene(), camera, crop(240, 240)),
        Subject("room, 8 bounces", room(), camera, crop(330, 120)),
        Subject("coloured plates, spectral", coloured(), colour, crop(224, 150)),
        Subject("`objects`: board, 1 bounce", objects, camera, crop(40, 40), direct),
        Subject("`objects`: cube, 1 bounce", objects, camera, crop(310, 150), direct),
        *(Subject(f"`objects`: {name}", objects, camera, crop(*place)) for name, place in places.items()),
    ]


def films(side):
    """Scenes by a thin lens, each on a whole small film, and parts of the reference camera's."""
    camera, whole = scenes.camera(pixel_pitch=7.2 / side), np.s_[:side, :side]
    camera = dataclasses.replace(camera, sensor=pl.Sensor((side, side), 7.2 / side))
    plenoptic, middle = reference.camera(), np.s_[224 : 224 + side, 224 : 224 + side]
    return [
        Subject("white", None, plenoptic, middle),
        Subject("`check`", pl.check_scene(), plenoptic, middle),
        Subject("many lights", scenes.many_lights(), camera, whole),
        Subject("textures, environment", textures(), camera, whole),
        Subject("glass", scenes.glass(), camera, whole),
        Subject("`objects`", scenes.objects(), camera, whole),
        Subject("`objects`, plenoptic", pl.objects_scene(), plenoptic, middle),
        Subject("caustic", caustic(16.0, 5.0), camera, whole),
        Subject("rare caustic", caustic(2.0, 300.0), camera, whole),
    ]


def textures():
    """Texels of two sizes under a sky with a bright spot."""
    rng = np.random.default_rng(4)
    coarse, fine = (pl.Texture(rng.uniform(0, 1, (n, n + 2, 3))) for n in (5, 40))
    picture = pl.quad((-20, -20, -8), (40, 0, 0), (0, 40, 0), material=pl.Lambertian(fine))
    block = scenes.tilted_box(8, (4, -3, 0), pl.Lambertian(coarse))
    sky = pl.EnvironmentMap(scenes.sky_map(64)).rotated((1, 2, 3), 0.4)
    return pl.Scene([picture, block, scenes.floor()], background=sky)


def caustic(side, radiance):
    """A glass ball between a square lamp and matt planes: paths find the lamp through it by chance alone."""
    ball = pl.sphere(4.0, center=(0, -3, 0), segments=(128, 64), material=pl.Dielectric(1.5))
    lamp = pl.QuadLight.facing((-10, 30, 5), (0, -3, 0), (side, side), radiance=radiance)
    return pl.Scene([ball, scenes.wall((0.7, 0.6, 0.5)), scenes.floor(0.7)], [lamp])


class Converged:
    """The truth about a crop, as far as many samples of another seed tell."""

    def __init__(self, subject, samples):
        shot = expose(subject, samples=samples, replicates=REPLICATES, seed=REFERENCE_SEED)
        self.subject, self.samples = subject, samples
        self.image = shot.image.astype(np.float64)
        self.variance = np.square(shot.standard_error, dtype=np.float64)
        mean = self.image.mean(axis=2)
        self.lit = mean > LIT * np.percentile(mean, 99)


def expose(subject, **settings):
    settings = {"region": subject.region, "truth": Truth.NONE, **subject.options, **settings}
    return reference.exposed(subject.scene, subject.camera, **settings)


def honesty(truth, seeds, **budget):
    """Errors of renderings with these seeds. Which pixels spread is judged by the other half of the seeds."""
    shots = [expose(truth.subject, seed=seed, **{"replicates": REPLICATES, **budget}) for seed in seeds]
    errors = np.array([(shot.image - truth.image)[truth.lit] for shot in shots])
    stated = np.array([np.square(shot.standard_error, dtype=np.float64)[truth.lit] for shot in shots])
    counts = np.array([counts_of(shot)[truth.lit] for shot in shots])[..., None]
    image, uncertain = truth.image[truth.lit], truth.variance[truth.lit]

    true = np.mean(errors**2, axis=0) - uncertain
    said = np.mean(stated, axis=0)
    ratio = math.sqrt(max(true.sum(), 0.0) / said.sum())
    scatter = math.sqrt(np.square((true - ratio**2 * said).sum(axis=1)).sum()) / said.sum() / (2 * ratio)
    # All seeds share the reference.
    totals = errors.mean(axis=0).sum(axis=0)
    mean_error = totals / np.sqrt(said.sum(axis=0) / len(shots) + uncertain.sum(axis=0))

    inside = np.square(errors) <= STUDENT**2 * stated + uncertain
    half = len(shots) // 2
    halves = (stated[half:], stated[:half]), (stated[:half], stated[half:])
    others = np.concatenate([np.broadcast_to(of.mean(axis=0), to.shape) for of, to in halves])
    spread = others >= np.square(image / counts)
    return Honesty(
        error=math.sqrt(max(float(np.mean(true.mean(axis=1) / image.mean(axis=1) ** 2)), 0.0)),
        stated=math.sqrt(np.mean([shot.relative_error**2 for shot in shots if shot.relative_error is not None])),
        samples=float(counts.mean()),
        ratio=ratio,
        ratio_error=scatter,
        mean_error=float(mean_error[np.argmax(np.abs(mean_error))]),
        covered=float(inside.mean()),
        covered_spread=float(inside[spread].mean()) if spread.any() else math.nan,
        spread=float(spread.mean()),
        rare=float(np.mean([bool(shot.rare_light) for shot in shots])),
        shots=shots,
    )


def counts_of(shot):
    """(H, W) samples of each pixel."""
    return np.full(shot.image.shape[:2], shot.samples) if shot.sample_counts is None else shot.sample_counts
