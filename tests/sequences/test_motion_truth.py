"""Where pixels' points go: against moved points and `camera.project`, and what hides them."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError

SIZE = 32
TURN = pl.Motion.screw((0, 1), axis=(1, 2, 0.5), through=(0, 0, -404), angle_deg=30, advance=1.5)
PAST = pl.Motion((0, 1), [pl.Pose.look_at((x, 3, 5), (0.3, 0, -404), up=(x / 40, 1, 0)) for x in (-4, 6)])


def camera(**changes):
    """The reference camera with a small sensor, whose pixels are larger."""
    return dataclasses.replace(
        pl.camera.example_camera(), sensor=pl.Sensor(shape=(SIZE, SIZE), pixel_pitch=0.1), **changes
    )


def scene():
    die = dataclasses.replace(pl.box(2.4).translated(z=-404), name="die")
    return pl.Scene([pl.quad((-80, -80, -420), (160, 0, 0), (0, 160, 0)), die], background=0.2)


def moved(sequence, truth, time):
    """Positions of pixels at another time, by the motion of their objects."""
    expected = truth.position.copy()
    die = truth.object == 1
    here = TURN.at(sequence.times[0])
    body = (truth.position[die] - here.position) @ here.rotation
    expected[die] = TURN.at(time).to_world(body)
    return expected


@pytest.fixture(scope="module", params=["microlenses", "plates", "none"])
def case(request):
    found = camera()
    if request.param == "plates":
        model = pl.optics.MicrolensModel.SPHERICAL
        found = dataclasses.replace(found, microlenses=dataclasses.replace(found.microlenses, model=model))
    if request.param == "none":
        found = dataclasses.replace(found, microlenses=None, microlenses_to_sensor=0.0)
    sequence = pl.Sequence(scene(), found, (0.2, 0.7), motions={"die": TURN}, camera_motion=PAST)
    frames = sequence[0], sequence[1]
    truth = pl.ground_truth(frames[0].scene, frames[0].camera, progress=False)
    return sequence, frames, truth, pl.sequences.motion_truth(*frames, progress=False)


def test_points_are_where_motions_take_them_and_the_same_frame_does_not_move(case):
    sequence, frames, truth, motion = case
    assert motion.shape == truth.shape
    met = truth.object >= 0
    assert (truth.object == 1).sum() > 40 and (truth.object == 0).sum() > 40
    assert np.array_equal(np.isfinite(motion.position).all(axis=2), met)
    np.testing.assert_allclose(motion.position[met], moved(sequence, truth, 0.7)[met], atol=1e-9)
    still = pl.sequences.motion_truth(frames[0], frames[0], region=np.s_[8:16, 8:20])
    assert still.shape == (8, 12) and repr(still).startswith("MotionTruth(8 x 12, ")
    met = np.isfinite(still.shift).all(axis=2)
    assert met.any()
    np.testing.assert_allclose(still.shift[met], 0, atol=1e-9)


def test_shifts_are_those_of_projected_points(case):
    sequence, frames, truth, motion = case
    rng = np.random.default_rng(4)
    rows, columns = np.nonzero(np.isfinite(motion.shift).all(axis=2))
    some = rng.choice(len(rows), min(60, len(rows)), replace=False)
    rows, columns = rows[some], columns[some]
    seen = [
        frame.camera.project(points[rows, columns], frame.scene, progress=False)
        for frame, points in zip(frames, (truth.position, moved(sequence, truth, 0.7)), strict=True)
    ]
    compared = 0
    for k, (row, column) in enumerate(zip(rows, columns, strict=True)):
        found = []
        for each in seen:
            mine = each.point == k
            if truth.microlens is not None:
                mine &= (each.index == truth.microlens[row, column]).all(axis=1)
            found.append(each.selected(mine))
        now, then = found
        if not len(now) or not len(then):
            assert not len(then) or not now.passes.any()
            continue
        shift = (then.pixel[0] - now.pixel[0])[::-1]
        np.testing.assert_allclose(motion.shift[row, column], shift, atol=1e-6)
        lands = np.abs(then.position[0]).max() <= SIZE * 0.1 / 2
        assert motion.visible[row, column] == (then.visible[0] and then.passes[0] and lands)
        compared += 1
    assert compared > 30


def test_what_is_hidden_or_leaves_is_not_visible():
    flat = camera(microlenses=None, microlenses_to_sensor=0.0)
    wall = pl.quad((-80, -80, -420), (160, 0, 0), (0, 160, 0), material=pl.Lambertian(0.5))
    cover = dataclasses.replace(pl.quad((-10, -2, -300), (9, 0, 0), (0, 4, 0)), name="cover")
    slide = pl.Motion.screw((0, 1), axis=(1, 0, 0), advance=20.0)
    frames = pl.Sequence(pl.Scene([wall, cover], background=0.1), flat, (0, 0.3, 1), motions={"cover": slide})
    before = pl.ground_truth(frames[0].scene, frames[0].camera, truth=pl.Truth.OBJECT)
    after = pl.ground_truth(frames[1].scene, frames[1].camera, truth=pl.Truth.OBJECT)
    motion = pl.sequences.motion_truth(frames[0], frames[1])
    wall_both = (before.object == 0) & (after.object == 0)
    covered = (before.object == 0) & (after.object == 1)
    assert wall_both.sum() > 50 and covered.sum() > 50
    assert motion.visible[wall_both].mean() > 0.9 and motion.visible[covered].mean() < 0.1  # but for blurred edges
    np.testing.assert_allclose(motion.shift[before.object == 0], 0, atol=1e-9)
    # The image of what moves right goes left.
    seen = pl.sequences.motion_truth(frames[1], frames[2])
    cover_now = after.object == 1
    assert (np.abs(seen.shift[cover_now][:, 0]) > SIZE / 2).all() and not seen.visible[cover_now].any()


def test_frames_that_have_nothing_in_common_are_refused():
    first = pl.Sequence(scene(), camera(), (0.2, 0.7), motions={"die": TURN})[0]
    for change, what in (
        ({"scene": pl.Scene(background=1.0)}, "no mesh"),
        ({"scene": pl.Scene([pl.box(3)])}, "different triangles"),
        ({"camera": dataclasses.replace(first.camera, sensor=pl.Sensor((4, 4), 0.1))}, "different cameras"),
    ):
        with pytest.raises(InvalidValueError, match=what):
            pl.sequences.motion_truth(first, dataclasses.replace(first, **change))
