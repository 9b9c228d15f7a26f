"""What feeds pixels, found through the openings of the lens, brings the light that bounds on its pupil bring."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera import record

LENS = pl.load_lens("double-gauss-100mm-f2")
ARRAY = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL)
PINHOLES = dataclasses.replace(ARRAY, model=pl.optics.MicrolensModel.PINHOLE)
CLEAR = dataclasses.replace(
    ARRAY,
    aperture=pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, fill_factor=0.7, gaps=pl.optics.Gaps.CLEAR),
)


def camera_of(stop: float, array: pl.MicrolensArray = ARRAY, size: int = 512) -> pl.PlenopticCamera:
    return pl.PlenopticCamera(
        lens=LENS.with_stop(pl.CircularStop(stop)),
        microlenses=array,
        sensor=pl.Sensor(shape=(size, size), pixel_pitch=0.01),
        stop_to_microlenses=123.3,
        microlenses_to_sensor=1.7,
    )


@pytest.mark.parametrize("camera", [camera_of(5.0), camera_of(0.5, PINHOLES), camera_of(0.5)])
def test_exact_regions_bring_the_light_of_bounds(camera, monkeypatch):
    # Pinholes send all rays of a cell alike: no movement of their regions with the point on the pixel can be known.
    arguments = {"samples": 256, "replicates": 16, "region": np.s_[:32, :32], "progress": False}
    sky = pl.Scene(background=1.0)
    exact = pl.render(sky, camera, seed=1, **arguments)
    monkeypatch.setattr(record, "why_bounds", lambda *_, **__: "they do")
    bounds = pl.render(sky, dataclasses.replace(camera), seed=2, **arguments)
    error = np.hypot(exact.standard_error, bounds.standard_error).astype(float)
    assert abs(float(exact.image.sum()) - float(bounds.image.sum())) <= 4 * np.sqrt((error**2).sum())
    assert exact.stats.paths_through_lens / exact.stats.paths > bounds.stats.paths_through_lens / bounds.stats.paths


@pytest.mark.parametrize(
    "camera, exact",
    [
        (camera_of(5.0), True),
        (camera_of(4.0, size=8192), True),
        (camera_of(20.0), False),
        (camera_of(8.0, dataclasses.replace(ARRAY, pitch=0.08)), False),
        (camera_of(5.0, CLEAR), False),
    ],
)
def test_many_microlenses_and_clear_gaps_are_left_to_bounds(camera, exact):
    assert record.camera_record(camera).exact == exact
