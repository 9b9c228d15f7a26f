"""Does the interval hold that `pl.estimate` gives where a target error ends a render? Ten renders, each asked about."""

import numpy as np
import reference
from honesty import Subject, caustic, expose, scenes
from table import Table
from timing import timed

import plenoptic as pl

WARM = 4
"""Samples of a render before, which compiles."""
TILE = 64
"""Side of tiles that end by themselves."""


def tables(*, quick):
    side = TILE if quick else 512
    aims = [(subject, (4 * targets[0],) if quick else targets) for subject, targets in subjects(side)]
    rows = [_row(subject, target) for subject, targets in aims for target in targets]
    held = [sum(row[i] == "yes" for row in rows) for i in (4, 8)]
    columns = "scene, target | CPU s estimated | from, to | CPU s | holds | samples estimated | from, to | samples | "
    columns += "holds | CPU s of the estimate"
    remark = f"Of {len(rows)} intervals of CPU time {held[0]} hold, of those of samples {held[1]}; 8 of 10 are wanted."
    yield Table(f"Estimates where a target error ends a render, {side} x {side} pixels", columns, rows, [remark])


def subjects(side):
    """Scenes, and the errors that are aimed at."""
    camera, middle = reference.camera(), reference.middle(side)
    thin = scenes.camera(pixel_pitch=7.2 / side, pixels=side)
    return [
        (Subject("`objects`", pl.objects_scene(), camera, middle), (0.2, 0.1)),
        (Subject("`check`", pl.check_scene(), camera, middle), (0.05, 0.025)),
        (Subject("still life", pl.still_life(), camera, middle), (0.2, 0.1)),
        (Subject("white", None, camera, middle), (0.008, 0.003)),
        (Subject("caustic", caustic(16.0, 5.0), thin, np.s_[:side, :side]), (0.2, 0.1)),
    ]


def _row(subject, target):
    given = {"target_error": target, "region": subject.region}
    expose(subject, samples=WARM)
    took, found = timed(pl.estimate, subject.scene, subject.camera, truth=pl.Truth.NONE, progress=False, **given)
    cost, shot = timed(expose, subject, target_error=target)
    asked = *_cells(found.cpu_seconds, cost.cpu), *_cells(found.samples, _paths_of_a_pixel(shot))
    return f"{subject.name}, {100 * target:g} %", *asked, took.cpu


def _paths_of_a_pixel(shot):
    """On average, with those that do not count in the image: of a tile all pixels have as many."""
    if shot.sample_counts is None:
        return float(shot.samples or 0)
    rows, columns = (length // TILE for length in shot.sample_counts.shape)
    return float(shot.sample_counts.reshape(rows, TILE, columns, TILE).max(axis=(1, 3)).mean())


def _cells(found, true):
    between = f"{found.low:.3g}, {found.high:.3g}"
    return found.value, between, true, "yes" if found.low <= true <= found.high else "no"
