import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import CAMERA, refused, with_array
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import plenoptic as pl

SCENE, SENSOR = pl.optics.ConvexSide
EPS = 2.0**-52
POINT = st.tuples(*[st.floats(-1e3, 1e3)] * 3)


def changed(**changes):
    return dataclasses.replace(CAMERA, **changes)


def spherical(side):
    model = pl.optics.MicrolensModel.SPHERICAL
    return with_array(CAMERA, model=model, thickness=0.3, index=1.5, convex_side=side).microlenses


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
        ({"stop_to_microlenses": math.nan}, "stop_to_microlenses is nan; it must be finite"),
        ({"stop_to_microlenses": math.inf}, "stop_to_microlenses is inf; it must be finite"),
        ({"microlenses_to_sensor": 0.0}, "microlenses_to_sensor is 0 mm; it must be above 1e-15 mm"),
        ({"microlenses": None}, "microlenses_to_sensor is 1.7 mm without microlenses; leave it at 0"),
        ({"microlenses": None, "microlenses_to_sensor": 0.0, "stop_to_microlenses": 20.0}, "must be above 30.31"),
        # The plate: its flat side lies thickness / index = 0.2 mm from the principal plane inside.
        ({"microlenses": spherical(SCENE), "microlenses_to_sensor": 0.19}, "must be above 0.2 mm"),
        ({"microlenses": spherical(SENSOR), "stop_to_microlenses": 30.5}, "must be above 30.51"),
        ({"microlenses": "hexagonal"}, "microlenses is 'hexagonal'; it must be a MicrolensArray or None"),
        ({"sensor": (512, 512)}, r"sensor is \(512, 512\); it must be a Sensor"),
        ({"wavelength": 0.0}, "wavelength is 0 nm; it must be above 0"),
        ({"pose": "upside down"}, "pose"),
    ):
        with refused(message):
            changed(**changes)
    # What just fits is possible.
    changed(stop_to_microlenses=30.32)
    changed(microlenses=spherical(SCENE), microlenses_to_sensor=0.21, stop_to_microlenses=30.32)
    # Towards the sensor the vertex is the rear principal plane, and the glass lies on its other side.
    changed(microlenses=spherical(SENSOR), microlenses_to_sensor=0.01, stop_to_microlenses=30.52)


def test_a_posed_camera_is_moved_in_nothing_else():
    camera = CAMERA.posed((1, 2, 3), (4, 5, 6), (0, 0, 1))
    assert camera.pose == pl.Pose.look_at((1, 2, 3), (4, 5, 6), (0, 0, 1))
    assert dataclasses.replace(camera, pose=None) == CAMERA


@settings(max_examples=40)
@given(position=POINT, target=POINT, up=POINT)
def test_look_at_is_a_right_handed_frame_that_looks_along_minus_z(position, target, up):
    view = np.subtract(target, position)
    distance = np.linalg.norm(view)
    assume(distance > 1e-3)
    sine = np.linalg.norm(np.cross(view, up)) / distance
    assume(sine > 1e-6 * max(1.0, np.linalg.norm(up)))
    pose = pl.Pose.look_at(position, target, up)
    x, y, z = pose.rotation.T
    # Cross products of unit vectors; x is perpendicular to z to an eps of up's length over its part across the view.
    worse = 16 * EPS * np.linalg.norm(up) / sine
    assert np.abs(pose.rotation @ pose.rotation.T - np.eye(3)).max() <= 16 * EPS + worse
    assert np.cross(x, y) == pytest.approx(z, abs=16 * EPS + worse)
    # The target lies on the axis, in front; up has no part along x and a positive one along y.
    scale = 1e3 + distance
    assert pose.to_camera(target) == pytest.approx([0, 0, -distance], abs=16 * EPS * scale + worse * distance)
    assert np.dot(up, x) == pytest.approx(0.0, abs=(16 * EPS + worse) * np.linalg.norm(up))
    assert np.dot(up, y) > 0


@settings(max_examples=20)
@given(position=POINT, points=st.lists(POINT, min_size=1, max_size=5))
def test_there_and_back(position, points):
    pose = pl.Pose.look_at(position, (1.5e3, 1.7e3, 2e3), (0.3, 1.0, -0.2))
    # Sums of three products and a shift, of numbers up to 4000 mm.
    assert pose.to_camera(pose.to_world(points)) == pytest.approx(np.array(points), abs=16 * EPS * 8e3)
    assert pose.to_world(pose.to_camera(points)) == pytest.approx(np.array(points), abs=16 * EPS * 8e3)


def test_impossible_views_and_poses():
    for *view, message in (
        ((0, 0, 0), (0, 0, 0), (0, 1, 0), "are 0.0 mm apart"),
        ((0, 0, 0), (math.inf, 0, 0), (0, 1, 0), "are inf mm apart"),
        ((0, math.nan, 0), (0, 0, 1), (0, 1, 0), "are nan mm apart"),
        ((0, 0, 9), (0, 0, 0), (0, 0, 1), "lies along the view; choose another"),
        ((0, 0, 9), (0, 0, 0), (0, 0, 0), "lies along the view; choose another"),
        ((0, 0, 9), (0, 0, 0), (0, math.nan, 0), "up .*; choose another"),
        ((0, 0, 1), "origin", (0, 1, 0), "look_at is not an array of numbers"),
    ):
        with refused(message):
            pl.Pose.look_at(*view)
    for rotation, position, message in (
        (np.diag([1.0, 1, -1]), np.zeros(3), "not a right-handed orthonormal"),
        (2 * np.eye(3), np.zeros(3), "not a right-handed orthonormal"),
        (np.eye(3) * math.nan, np.zeros(3), "defect nan"),
        (np.eye(3), [0, math.inf, 0], "not finite"),
        (np.eye(4), np.zeros(3), r"rotation has shape \(4, 4\)"),
    ):
        with refused(message):
            pl.Pose(rotation, position)
