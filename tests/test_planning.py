"""What runs for a camera, and what is left out."""

import dataclasses

import pytest

import plenoptic as pl

CAMERA = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2"),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)


def aspheric(lens: pl.LensStack) -> pl.LensStack:
    first = dataclasses.replace(lens.elements[0], aspheric=(0.0, 1e-8))
    return dataclasses.replace(lens, elements=[first, *lens.elements[1:]])


@pytest.mark.parametrize(
    ("lens", "running"),
    [
        (CAMERA.lens, set()),
        (aspheric(CAMERA.lens), {pl.Stage.ASPHERES}),
        (CAMERA.lens.moved(3, shift=(0.1, 0, 0)), {pl.Stage.PLACEMENTS}),
        (aspheric(CAMERA.lens).moved(0, tilt=(0.1, 0, 0)), {pl.Stage.ASPHERES, pl.Stage.PLACEMENTS}),
        (aspheric(CAMERA.lens).with_model(pl.LensModel.THIN), set()),
        (CAMERA.lens.with_stop(pl.PolygonStop(6, 5.0)), {pl.Stage.SHAPED_STOPS}),
    ],
)
def test_a_lens_runs_what_it_has(lens, running):
    plan = pl.plan(None, dataclasses.replace(CAMERA, lens=lens))
    choices = {pl.Stage.ASPHERES, pl.Stage.PLACEMENTS, pl.Stage.SHAPED_STOPS}
    assert {stage for stage in choices if plan.runs(stage)} == running
    assert plan.runs(pl.Stage.LENS)


@pytest.mark.parametrize("model", list(pl.MicrolensModel))
def test_plates_run_where_microlenses_have_surfaces(model):
    index = 100.0 if model is pl.MicrolensModel.FLAT_HIGH_INDEX else 1.5
    array = dataclasses.replace(CAMERA.microlenses, model=model, index=index)
    plan = pl.plan(None, dataclasses.replace(CAMERA, microlenses=array))
    assert plan.runs(pl.Stage.MICROLENS_PLATES) == (model >= pl.MicrolensModel.FLAT_HIGH_INDEX)
    assert "left out  aspheres" in repr(plan)
