"""What a simpler main lens or microlens saves, and by how much its image is wrong: an error study of the models."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import reference
from table import Table

import plenoptic as pl
from plenoptic.study import ErrorTable, Variant

MICROLENSES = {
    "SPHERICAL": {"model": pl.optics.MicrolensModel.SPHERICAL, "thickness": 0.1, "index": 1.5},
    "FLAT_HIGH_INDEX": {"model": pl.optics.MicrolensModel.FLAT_HIGH_INDEX, "thickness": 0.01, "index": 200.0},
    "THIN": {"model": pl.optics.MicrolensModel.THIN},
    "PINHOLE": {"model": pl.optics.MicrolensModel.PINHOLE},
}


def tables(*, quick: bool) -> Iterator[Table]:
    cameras, samples = [_with(fields) for fields in MICROLENSES.values()], 8 if quick else 1024
    variants = {
        f"EXACT lens, {name} microlenses": Variant(camera=camera)
        for name, camera in zip(MICROLENSES, cameras, strict=True)
    }
    for model in (pl.LensModel.PARAXIAL, pl.LensModel.THIN, pl.LensModel.NONE):
        variants[f"{model.name} lens, THIN microlenses"] = Variant(camera=cameras[2], lens=model)
    for title, scene in (("white image", None), ("`check`", pl.check_scene())):
        study = pl.study.error_against_time(
            scene,
            cameras[0],
            variants,
            samples=(samples,),
            seeds=2 if quick else 3,
            repeats=1,
            threads=1,
            progress=False,
        )
        yield _table(title, study)


def _with(fields: dict[str, object]) -> pl.PlenopticCamera:
    camera = reference.camera()
    return dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, **fields))  # type: ignore[arg-type, type-var]


def _table(title: str, study: ErrorTable) -> Table:
    first = study.rows[0]
    rows = [
        (
            row.variant,
            1e3 * row.cpu_seconds / study.pixels,
            row.cpu_seconds / first.cpu_seconds,
            100 * row.noise,
            100 * row.bias if row.bias_is_found else f"< {100 * row.bias_limit:.2g}",
        )
        for row in study.rows
    ]
    return Table(
        f"Fidelity against time: {title}, mode 2.0, 64 x 64 pixels, {first.samples} samples, one thread",
        ("model", "CPU ms per pixel", "time over the first", "noise %", "bias %"),
        rows,
        [
            f"{study.lit_pixels} lit pixels, {study.seeds} seeds; the reference is the first model with "
            f"{study.reference_samples} samples, and its own error, {100 * study.reference_error:.2g} %, is "
            "subtracted. NONE has no lens, and so another picture. THIN has its planes of focus moved by the distance "
            "of the lens's principal planes."
        ],
    )
