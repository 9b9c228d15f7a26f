"""What is compiled ahead is what is needed then: nothing is compiled twice, and nothing is forgotten."""

import dataclasses

import pytest

import plenoptic as pl
from plenoptic.core.waiting.compiling import compiling
from plenoptic.study.cameras import reference_camera

CAMERA = dataclasses.replace(reference_camera(), sensor=pl.Sensor(shape=(48, 48), pixel_pitch=0.01))


def test_then_nothing_is_compiled():
    scene = pl.check_scene()
    pl.warm_up(scene, CAMERA, progress=False)
    before = list(compiling.names)
    again = pl.warm_up(scene, CAMERA, progress=False)
    assert again.kernels == () and again.seconds < 5.0 and "nothing" in repr(again)
    pl.render(scene, CAMERA, samples=4, truth=pl.Truth.ALL, progress=False)
    pl.render(scene, CAMERA, target_error=0.5, samples=16, progress=False)
    pl.render_white(CAMERA, samples=4, progress=False)
    pl.ground_truth(scene, CAMERA)
    CAMERA.project([(0, 0, -404), (1, 2, -404)], scene)
    pl.point_spread(CAMERA, (0, 0, -404), rays=64)
    pl.microlens_centres(CAMERA)
    assert compiling.names == before


def test_cameras_of_all_kinds_and_no_scene():
    for camera in (
        CAMERA.posed((0, 0, 100), (0, 0, 0)),
        pl.PlenopticCamera(lens=CAMERA.lens, sensor=CAMERA.sensor, stop_to_microlenses=134.6),
    ):
        pl.warm_up(None, camera, progress=False)
        assert pl.warm_up(None, camera, progress=False).kernels == ()
    with pytest.raises(pl.errors.InvalidValueError, match="scene is a PlenopticCamera"):
        pl.warm_up(CAMERA, CAMERA)
