"""What a simpler main lens or microlens saves, and by how much its image is wrong: an error study of the models."""

import dataclasses

import reference
from table import Table

import plenoptic as pl
from plenoptic.study import Variant

MICROLENSES = {
    "SPHERICAL": {"model": pl.optics.MicrolensModel.SPHERICAL, "thickness": 0.1, "index": 1.5},
    "FLAT_HIGH_INDEX": {"model": pl.optics.MicrolensModel.FLAT_HIGH_INDEX, "thickness": 0.01, "index": 200.0},
    "THIN": {"model": pl.optics.MicrolensModel.THIN},
    "PINHOLE": {"model": pl.optics.MicrolensModel.PINHOLE},
}


def tables(*, quick):
    cameras, samples = [_with(fields) for fields in MICROLENSES.values()], 8 if quick else 1024
    named = [f"EXACT lens, {name} microlenses" for name in MICROLENSES]
    variants = {name: Variant(camera=camera) for name, camera in zip(named, cameras, strict=True)}
    for model in (pl.LensModel.PARAXIAL, pl.LensModel.THIN, pl.LensModel.NONE):
        variants[f"{model.name} lens, THIN microlenses"] = Variant(camera=cameras[2], lens=model)
    how = {"samples": (samples,), "seeds": 2 if quick else 3, "repeats": 1, "threads": 1, "progress": False}
    for title, scene in (("white image", None), ("`check`", pl.check_scene())):
        yield _table(title, pl.study.error_against_time(scene, cameras[0], variants, **how))


def _with(fields):
    camera = reference.camera()
    return dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, **fields))


def _table(title, study):
    first = study.rows[0]
    rows = []
    for row in study.rows:
        bias = 100 * row.bias if row.bias_is_found else f"< {100 * row.bias_limit:.2g}"
        cost = 1e3 * row.cpu_seconds / study.pixels, row.cpu_seconds / first.cpu_seconds
        rows.append((row.variant, *cost, 100 * row.noise, bias))
    remark = (
        f"{study.lit_pixels} lit pixels, {study.seeds} seeds; the reference is the first model with "
        f"{study.reference_samples} samples, and its own error, {100 * study.reference_error:.2g} %, is "
        "subtracted. NONE has no lens, and so another picture. THIN has its planes of focus moved by the distance "
        "of the lens's principal planes."
    )
    title = f"Fidelity against time: {title}, mode 2.0, 64 x 64 pixels, {first.samples} samples, one thread"
    return Table(title, "model | CPU ms per pixel | time over the first | noise % | bias %", rows, [remark])
