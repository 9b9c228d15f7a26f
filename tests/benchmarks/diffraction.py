"""What diffraction costs: CPU time at equal noise, of a scene and of the white image, over that of rays alone."""

import dataclasses
from unittest import mock

import numpy as np
import reference
from table import Table

import plenoptic as pl
from plenoptic.study import Variant

RAYS, UNCUT = "rays alone", "rays alone, nothing certain"


def tables(*, quick):
    samples, seeds, side = ((4, 16), 2, 16) if quick else ((16, 64, 256), 4, 128)
    camera = dataclasses.replace(reference.camera(), wavelength=550.0)
    bends = {"at microlenses": pl.Diffraction(), "and at the iris": pl.Diffraction(iris=True)}
    bent = {name: Variant(camera=dataclasses.replace(camera, diffraction=bend)) for name, bend in bends.items()}
    how = {"samples": samples, "region": reference.middle(side), "seeds": seeds, "progress": False}
    how |= {"reference": bent["at microlenses"], "reference_samples": 4 * samples[-1]}

    def study(scene, variants):
        return pl.study.error_against_time(scene, camera, variants, **how)

    scene, white = (study(what, {RAYS: Variant()} | bent) for what in (pl.objects_scene(), None))
    # The sampler of scenes: what surely passes the lens is traced as the rest is.
    with mock.patch("plenoptic.rendering.plan.camera_stages.no_core_reason", lambda _: "a scene is to be compared"):
        uncut = study(None, {UNCUT: Variant()})
    rows = [*_rows("`objects`", scene, {RAYS: scene.of(RAYS)})]
    for of in (uncut, white):
        rows += _rows("white", of, {RAYS: white.of(RAYS), UNCUT: uncut.of(UNCUT)})
    columns = "scene | bends | samples | CPU us per pixel and sample | noise % | bias % | CPU at equal noise | "
    columns += "over that where nothing is certain"
    remark = (
        f"The reference camera at 550 nm, central {side} x {side} pixels, {seeds} seeds, one thread, without setting "
        "up. Noise and bias are relative RMS over lit pixels, the bias beside bends at microlenses. CPU at equal noise "
        "is over that of rays alone, whose time follows a line between two of their rows, in logarithms; last, over "
        "that of rays in a white image of which all is sampled, as of a scene."
    )
    yield Table("What diffraction costs", columns, rows, [remark])


def _rows(name, study, over):
    for row in study.rows:
        each = 1e6 * _seconds(row) / (study.pixels * row.samples)
        bias = 100 * row.bias if row.bias_is_found else f"< {100 * row.bias_limit:.2g}"
        times = [_seconds(row) / seconds_at(rays, row.noise) for rays in over.values()]
        yield name, row.variant, row.samples, each, 100 * row.noise, bias, *times, *[None] * (2 - len(times))


def _seconds(row):
    """Without setting up, which the noise of the clock can make seem longer than all of a short call."""
    return max(row.cpu_seconds - row.setup_cpu_seconds, 1e-3 * row.cpu_seconds)


def seconds_at(rows, noise):
    """CPU seconds that a noise takes, on the line through the two rows next to it, in logarithms."""
    last = next((k for k in range(1, len(rows)) if rows[k].noise <= noise), len(rows) - 1)
    (x0, y0), (x1, y1) = np.log([(row.noise, _seconds(row)) for row in rows[last - 1 : last + 1]])
    return float(np.exp(y0 + (y1 - y0) * (np.log(noise) - x0) / (x1 - x0)))
