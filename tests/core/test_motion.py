"""Rigid motions: keyframes are met, turns and screws are exact, and motions can be seen from elsewhere."""

import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.motions.rotation import rotation_about
from plenoptic.errors import InvalidValueError

AXIS, THROUGH = np.array([1.0, 2.0, -0.5]), np.array([30.0, -20.0, -404.0])
POINTS = np.random.default_rng(1).uniform(-50, 50, (20, 3)) + THROUGH
SCREW = pl.Motion.screw((1.0, 3.0), axis=AXIS, through=THROUGH, angle_deg=1000.0, advance=7.0)


def screwed(points, angle, shift):
    unit = AXIS / np.linalg.norm(AXIS)
    return (points - THROUGH) @ rotation_about(AXIS, math.fmod(angle, math.tau)).T + THROUGH + shift * unit


def poses(count, seed=2):
    rng = np.random.default_rng(seed)
    turns = np.concatenate([[np.zeros(3)], np.cumsum(rng.uniform(-1, 1, (count - 1, 3)), axis=0)])
    rotations = [rotation_about(turn if turn.any() else (1, 0, 0), np.linalg.norm(turn)) for turn in turns]
    return [pl.Pose(rotation, rng.uniform(-99, 99, 3)) for rotation in rotations]


def test_a_screw_is_exact_between_its_keyframes():
    for time in [1.0, 1.1, 1.77, 2.0, 2.9, 3.0]:
        part = (time - 1.0) / 2.0
        expected = screwed(POINTS, part * math.radians(1000.0), part * 7.0)
        # Rounding of coordinates of some 400 mm, through some ten products.
        np.testing.assert_allclose(SCREW.at(time).to_world(POINTS), expected, atol=1e-11)


def test_bodies_stand_still_before_and_after():
    for before, after in ((-5.0, 1.0), (9.0, 3.0)):
        assert SCREW.at(before) == SCREW.at(after)
    assert pl.Motion([0.5], poses(1)).at(9.0) == poses(1)[0]
    assert not SCREW.moves(-2, 1.0) and SCREW.moves(-2, 1.1) and not SCREW.moves(3.0, 4.0)


def test_keyframes_are_met_and_turns_between_them_are_even():
    keyframes = poses(5)
    motion = pl.Motion([0.0, 0.1, 0.7, 2.0, 2.5], keyframes, pivot=(3, 4, 5))
    for time, pose in zip(motion.times, keyframes, strict=True):
        matrices = motion.at(time)
        np.testing.assert_allclose(matrices.rotation, pose.rotation, atol=1e-15)
        np.testing.assert_allclose(matrices.to_world((3, 4, 5)), pose.to_world((3, 4, 5)), atol=1e-13)
    # Slerp: equal times, equal turns, all about one axis; the pivot on a line.
    matrices = motion.matrices(np.linspace(0.7, 2.0, 5))
    steps = matrices[1:, :, :3] @ matrices[:-1, :, :3].transpose(0, 2, 1)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-15)
    pivots = matrices[:, :, :3] @ [3, 4, 5] + matrices[:, :, 3]
    np.testing.assert_allclose(np.diff(pivots, 2, axis=0), 0, atol=1e-12)
    assert motion.at(0.3) == motion.at(0.3) and hash(motion) == hash(pl.Motion(motion.times, keyframes, (3, 4, 5)))


def test_a_motion_seen_from_a_time_and_in_another_world_is_the_same():
    motion = pl.Motion([0.0, 0.4, 1.0], poses(3), pivot=(3, 4, 5))
    reference = motion.at(0.3)
    for time in (-0.2, 0.0, 0.35, 0.9):
        relative, pose = motion.seen_from(0.3).at(time).to_world(reference.to_world(POINTS)), motion.at(time)
        np.testing.assert_allclose(relative, motion.at(0.3 + time).to_world(POINTS), atol=1e-11)
        turn, shift = rotation_about((1, 1, 0), 0.7), np.array([5.0, 6.0, 7.0])
        transformed = motion.in_frame(turn, shift, 2.0).at(time).to_world(2.0 * POINTS @ turn.T + shift)
        np.testing.assert_allclose(transformed, 2.0 * pose.to_world(POINTS) @ turn.T + shift, atol=1e-11)


def test_small_and_large_turns_keep_their_digits():
    for angle in (1e-9, 1e-5, 1.0, 3.1):
        motion = pl.Motion([0, 1], [pl.Pose(rotation_about(AXIS, a), np.zeros(3)) for a in (0.0, angle)])
        off = motion.at(0.25).rotation - rotation_about(AXIS, 0.25 * angle)
        assert np.abs(off).max() < 4e-16 + 1e-15 * angle


def test_impossible_motions_are_refused():
    for make, what in [
        (lambda: pl.Motion([0, 0], poses(2)), "ascend"),
        (lambda: pl.Motion([], []), "ascend"),
        (lambda: pl.Motion([0, 1], poses(3)), "3 poses for 2 times"),
        (lambda: pl.Motion([0], [np.eye(4)]), "poses"),
        (lambda: pl.Motion([0, 1], [pl.Pose(np.diag([s, s, 1]), np.zeros(3)) for s in (1, -1)]), "half a turn"),
        (lambda: pl.Motion.screw((0, 1), axis=(0, 0, 0)), "axis"),
        (lambda: pl.Motion.screw((0, 1), axis=(0, 0, 1), angle_deg=math.inf), "angle_deg"),
    ]:
        with pytest.raises(InvalidValueError, match=what):
            make()
