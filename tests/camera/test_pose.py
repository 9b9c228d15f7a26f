import math
import pickle

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import plenoptic as pl

EPS = np.finfo(float).eps
POINT = st.tuples(*[st.floats(-1e3, 1e3)] * 3)


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


def test_known_frames():
    pose = pl.Pose.look_at((0, 0, 900), (0, 0, 0))
    assert np.array_equal(pose.rotation, np.eye(3)) and pose.position.tolist() == [0, 0, 900]
    # Looking along +x with z up, as in a landscape: right is -y.
    pose = pl.Pose.look_at((0, 0, 0), (5, 0, 0), (0, 0, 1))
    assert pose.rotation.T.tolist() == [[0, -1, 0], [0, 0, 1], [-1, 0, 0]]


def test_impossible_views_and_poses():
    for *view, message in (
        ((0, 0, 0), (0, 0, 0), (0, 1, 0), "are 0.0 mm apart"),
        ((0, 0, 0), (math.inf, 0, 0), (0, 1, 0), "are inf mm apart"),
        ((0, math.nan, 0), (0, 0, 1), (0, 1, 0), "are nan mm apart"),
        ((0, 0, 9), (0, 0, 0), (0, 0, 1), "lies along the view; choose another"),
        ((0, 0, 9), (0, 0, 0), (0, 0, 0), "lies along the view; choose another"),
        ((0, 0, 9), (0, 0, 0), (0, math.nan, 0), "up .*; choose another"),
        ((0, 0), (0, 0, 0), (0, 1, 0), r"position has shape \(2,\)"),
        ((0, 0, 1), "origin", (0, 1, 0), "look_at is not an array of numbers"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.Pose.look_at(*view)
    for rotation, position, message in (
        (np.diag([1.0, 1, -1]), np.zeros(3), "not a right-handed orthonormal"),
        (2 * np.eye(3), np.zeros(3), "not a right-handed orthonormal"),
        (np.eye(3) * math.nan, np.zeros(3), "not finite"),
        (np.eye(3), [0, math.inf, 0], "not finite"),
        (np.eye(4), np.zeros(3), r"rotation has shape \(4, 4\)"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.Pose(rotation, position)


def test_a_pose_is_a_value():
    pose = pl.Pose.look_at((1, 2, 3), (0, 0, 0))
    assert pose == pl.Pose.look_at((1.0, 2.0, 3.0), (0, 0, 0)) != pl.Pose.look_at((1, 2, 4), (0, 0, 0))
    copy = pickle.loads(pickle.dumps(pose))
    assert copy == pose and hash(copy) == hash(pose) and not copy.rotation.flags.writeable
    assert eval(repr(pose), {"Pose": pl.Pose}) == pose
