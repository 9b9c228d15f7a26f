"""What a simpler main lens or microlens saves, and by how much its image is wrong: an error study of the models."""

import dataclasses

import reference
from table import Table

import plenoptic as pl
from plenoptic.study import Variant

MICROLENSES = {"SPHERICAL": {"thickness": 0.1, "index": 1.5}, "FLAT_HIGH_INDEX": {"thickness": 0.01, "index": 200.0}}
MICROLENSES |= {"THIN": {}, "PINHOLE": {}}


def tables(*, quick):
    plain, cameras = reference.camera(), {}
    for name, fields in MICROLENSES.items():
        array = dataclasses.replace(plain.microlenses, model=pl.optics.MicrolensModel[name], **fields)
        cameras[name] = dataclasses.replace(plain, microlenses=array)
    variants = {f"EXACT lens, {name} microlenses": Variant(camera=camera) for name, camera in cameras.items()}
    for model in (pl.LensModel.PARAXIAL, pl.LensModel.THIN, pl.LensModel.NONE):
        variants[f"{model.name} lens, THIN microlenses"] = Variant(camera=cameras["THIN"], lens=model)
    how = {"samples": (8 if quick else 1024,), "seeds": 2 if quick else 3, "repeats": 1, "threads": 1}
    for title, scene in (("white image", None), ("`check`", pl.check_scene())):
        study = pl.study.error_against_time(scene, cameras["SPHERICAL"], variants, progress=False, **how)
        yield _table(title, study)


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
