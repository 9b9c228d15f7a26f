"""What a simpler main lens or microlens saves, and by how much its image is wrong."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import reference
from table import Table
from timing import Task, median, taking_turns

import plenoptic as pl
from plenoptic.camera.truth import Truth

EXACT = pl.LensModel.EXACT
PLATE = {"thickness": 0.1, "index": 1.5}
FLAT = {"thickness": 0.01, "index": 200.0}
MICROLENSES = {
    "SPHERICAL": {"model": pl.MicrolensModel.SPHERICAL, **PLATE},
    "FLAT_HIGH_INDEX": {"model": pl.MicrolensModel.FLAT_HIGH_INDEX, **FLAT},
    "THIN": {"model": pl.MicrolensModel.THIN},
    "PINHOLE": {"model": pl.MicrolensModel.PINHOLE},
}


def tables(*, quick: bool) -> Iterator[Table]:
    samples, rounds = (8, 1) if quick else (1024, 3)
    yield biases("white image", None, samples=samples, rounds=rounds)
    yield biases("`check`", pl.check_scene(), samples=samples, rounds=rounds)


def variants() -> dict[str, pl.PlenopticCamera]:
    """The most faithful camera first: all others are compared with it."""
    camera = reference.camera()
    made = {}
    for name, fields in MICROLENSES.items():
        made[f"EXACT lens, {name} microlenses"] = _with(camera, EXACT, fields)
    for model in (pl.LensModel.PARAXIAL, pl.LensModel.THIN, pl.LensModel.NONE):
        made[f"{model.name} lens, THIN microlenses"] = _with(camera, model, MICROLENSES["THIN"])
    return made


def _with(camera: pl.PlenopticCamera, model: pl.LensModel, fields: dict[str, object]) -> pl.PlenopticCamera:
    microlenses = dataclasses.replace(camera.microlenses, **fields)  # type: ignore[arg-type]
    return dataclasses.replace(camera, lens=camera.lens.with_model(model), microlenses=microlenses)


def biases(title: str, scene: pl.Scene | None, *, samples: int, rounds: int) -> Table:
    """Difference of the image from the most faithful one, its own noise subtracted, and CPU time."""
    crop = np.s_[224:288, 224:288]
    cameras = variants()
    shots: dict[str, pl.Exposure] = {}

    def task(name: str) -> Task:
        def run(_: None) -> None:
            shots[name] = reference.exposed(
                scene, cameras[name], samples=samples, region=crop, truth=Truth.NONE, threads=1
            )

        return Task(run)

    costs = taking_turns({name: task(name) for name in cameras}, rounds=rounds)
    first, *_ = cameras
    true = shots[first].image.astype(np.float64)
    lit = true > 0.1 * np.percentile(true, 99)
    rows = []
    for name, shot in shots.items():
        off = (shot.image - true)[lit]
        noise = np.square(shot.standard_error[lit], dtype=np.float64) + np.square(shots[first].standard_error[lit])
        bias = np.sqrt(max(np.mean(np.square(off, dtype=np.float64)) - np.mean(noise), 0.0))
        sum_off = shot.image.sum(dtype=np.float64) / true.sum() - 1
        cost = median(costs[name])
        rows.append(
            (
                name,
                1e3 * cost.cpu / true.size,
                cost.cpu / median(costs[first]).cpu,
                100 * float(np.sqrt(np.mean(np.square(shot.standard_error[lit], dtype=np.float64)))) / true[lit].mean(),
                None if name == first else 100 * bias / true[lit].mean(),
                None if name == first else 100 * sum_off,
            )
        )
    columns = (
        "model",
        "CPU ms per pixel",
        "time over the first",
        "standard error %",
        "RMS difference from the first %",
        "difference of the sum %",
    )
    return Table(
        f"Fidelity against time: {title}, mode 2.0, 64 x 64 pixels, {samples} samples, one thread",
        columns,
        rows,
        [
            "Differences are over lit pixels and relative to their mean, the noise of both images subtracted. NONE has "
            "no lens, and so another picture. THIN has its planes of focus moved by the distance of the lens's "
            "principal planes.",
        ],
    )
