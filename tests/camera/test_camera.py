import dataclasses
import math
import pickle

import pytest

import plenoptic as pl
from plenoptic.study.cameras import reference_camera

CAMERA = reference_camera()
SCENE, SENSOR = pl.optics.ConvexSide.SCENE, pl.optics.ConvexSide.SENSOR
EPS = 2.0**-52


def changed(**changes):
    return dataclasses.replace(CAMERA, **changes)


def spherical(side):
    model = pl.optics.MicrolensModel.SPHERICAL
    return dataclasses.replace(CAMERA.microlenses, model=model, thickness=0.3, index=1.5, convex_side=side)


def test_the_sensor_lies_behind_both_principal_planes():
    assert CAMERA.z_sensor == pytest.approx(125.0, abs=2 * EPS * 125)
    for side in (SCENE, SENSOR):
        # 0.3 (1 - 1 / 1.5) = 0.1 between the principal planes.
        assert changed(microlenses=spherical(side)).z_sensor == pytest.approx(125.1, abs=4 * EPS * 125)
    assert changed(microlenses=None, microlenses_to_sensor=0.0).z_sensor == 123.3


def test_impossible_cameras():
    for changes, message in (
        ({"stop_to_microlenses": 30.0}, "stop_to_microlenses is 30 mm; .* must be above 30.31"),
        ({"stop_to_microlenses": 30.31}, "must be above 30.31"),
        ({"stop_to_microlenses": -5.0}, "must be above 30.31"),
        ({"stop_to_microlenses": math.nan}, "stop_to_microlenses is nan; it must be finite"),
        ({"stop_to_microlenses": math.inf}, "stop_to_microlenses is inf; it must be finite"),
        ({"microlenses_to_sensor": 0.0}, "microlenses_to_sensor is 0 mm; it must be above 1e-15 mm"),
        ({"microlenses_to_sensor": -1.0}, "microlenses_to_sensor is -1 mm"),
        ({"microlenses": None}, "microlenses_to_sensor is 1.7 mm without microlenses; leave it at 0"),
        ({"microlenses": None, "microlenses_to_sensor": 0.0, "stop_to_microlenses": 20.0}, "must be above 30.31"),
        # The plate: its flat side lies thickness / index = 0.2 mm from the principal plane inside.
        ({"microlenses": spherical(SCENE), "microlenses_to_sensor": 0.19}, "must be above 0.2 mm"),
        ({"microlenses": spherical(SENSOR), "stop_to_microlenses": 30.5}, "must be above 30.51"),
        ({"microlenses": "hexagonal"}, "microlenses is 'hexagonal'; it must be a MicrolensArray or None"),
        ({"lens": None}, "lens is None; it must be a LensStack"),
        ({"sensor": (512, 512)}, r"sensor is \(512, 512\); it must be a Sensor"),
        ({"wavelength": 0.55}, "wavelength is 0.55 nm; .*wavelengths are in nanometres"),
        ({"wavelength": 0.0}, "wavelength is 0 nm; it must be above 0"),
        ({"pose": "upside down"}, "pose"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            changed(**changes)
    with pytest.raises(pl.errors.InvalidValueError, match="distinct finite points"):
        CAMERA.posed((1, 2, 3), (1, 2, 3))


def test_what_just_fits_is_possible():
    changed(stop_to_microlenses=30.32)
    changed(microlenses=spherical(SCENE), microlenses_to_sensor=0.21, stop_to_microlenses=30.32)
    # Towards the sensor the vertex is the rear principal plane, and the glass lies on its other side.
    changed(microlenses=spherical(SENSOR), microlenses_to_sensor=0.01, stop_to_microlenses=30.52)


def test_a_posed_camera_is_a_value_and_is_moved_in_nothing_else():
    camera = CAMERA.posed(position=(0, 0, 900), look_at=(0, 0, 0))
    assert camera == reference_camera().posed(position=(0, 0, 900.0), look_at=(0, 0, 0)) != CAMERA
    assert camera != dataclasses.replace(camera, microlenses_to_sensor=1.8)
    copy = pickle.loads(pickle.dumps(camera))
    assert copy == camera and hash(copy) == hash(camera) and not copy.pose.rotation.flags.writeable
    camera = CAMERA.posed((1, 2, 3), (4, 5, 6), (0, 0, 1))
    assert camera.pose == pl.Pose.look_at((1, 2, 3), (4, 5, 6), (0, 0, 1))
    assert dataclasses.replace(camera, pose=None) == CAMERA
