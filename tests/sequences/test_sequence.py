"""Frames of a sequence: things are where motions say, what stands still is built once, and bits know no history."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.scene import cache
from plenoptic.scene.geometry import moving

REGION = np.s_[244:268, 244:268]
TURN = pl.Motion.screw((0, 2), axis=(1, 1, 0), through=(3, 0, -404), angle_deg=200, advance=4)
SLIDE = pl.Motion((0, 2), [pl.Pose(np.eye(3), (x, 0, 0)) for x in (0, -9)])
LAMP = pl.QuadLight.facing((0, 60, -300), (0, 0, -404), (40, 40), radiance=10)


def scene(lights=(LAMP,)):
    ball = pl.sphere(2.0, center=(-3, 0, -404))
    die = pl.box(5, material=pl.Lambertian((0.8, 0.3, 0.1))).rotated_deg((1, 2, 3), 20).translated(3, 0, -404)
    floor = pl.quad((-50, -6, -450), (100, 0, 0), (0, 0, 80))
    wall = pl.quad((-80, -80, -440), (160, 0, 0), (0, 160, 0))
    parts = [dataclasses.replace(die, name="die"), floor, dataclasses.replace(ball, name="ball"), wall]
    return pl.Scene(parts, lights, background=0.1)


@pytest.fixture(scope="module")
def sequence():
    camera = dataclasses.replace(pl.camera.example_camera(), sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.03))
    past = pl.Motion((0, 2), [pl.Pose.look_at((x, 5, 0), (0, 0, -404)) for x in (-20, 20)])
    times = np.linspace(0, 2, 5)
    return pl.Sequence(scene(), camera, times, motions={"ball": SLIDE, "die": TURN}, camera_motion=past)


def plain(sequence, k):
    """The scene of a frame with moved copies of meshes, as users would write it by hand."""
    found = list(sequence.scene.meshes)
    for name, motion in sequence.motions:
        place, pose = sequence.scene.object_names.index(name), motion.at(float(sequence.times[k]))
        matrix = np.vstack([np.column_stack([pose.rotation, pose.position]), [0, 0, 0, 1]])
        found[place] = found[place].transformed(matrix)
    return dataclasses.replace(sequence.scene, meshes=tuple(found))


def rendered(frame, **settings):
    return pl.render(frame.scene, frame.camera, **{"samples": 4, "region": REGION, "progress": False, **settings})


def test_what_moves_is_where_its_motion_says(sequence):
    for k in (0, 1, 3):
        frame = sequence[k]
        assert frame.time == sequence.times[k] and frame.scene.object_names == sequence.scene.object_names
        scenes = frame.scene, plain(sequence, k)
        found, expected = (pl.ground_truth(each, frame.camera, region=REGION) for each in scenes)
        assert set(np.unique(expected.object)) >= {0, 3}
        # Both are traced in float64 from the same corners, after a triangle was found in float32: edges may differ.
        same = found.object == expected.object
        assert same.mean() > 0.995
        np.testing.assert_allclose(found.position[same], expected.position[same], atol=1e-9)
        np.testing.assert_allclose(found.normal[same], expected.normal[same], atol=1e-6)


def test_bits_do_not_depend_on_the_frames_before(sequence):
    forwards = [rendered(frame).image.tobytes() for frame in sequence]
    backwards = [rendered(sequence[k]).image.tobytes() for k in range(4, -1, -1)][::-1]
    assert forwards == backwards and len(set(forwards)) == 5
    fresh = dataclasses.replace(sequence, scene=scene(), camera=dataclasses.replace(sequence.camera))
    assert rendered(fresh[2]).image.tobytes() == forwards[2]


def test_what_stands_still_is_built_once_and_nothing_is_kept(sequence, monkeypatch):
    build, numbers = moving.build_intersector, []

    def counted(geometry, *instances):
        numbers.append(len(geometry.triangles))
        return build(geometry, *instances)

    monkeypatch.setattr(moving, "build_intersector", counted)
    again = dataclasses.replace(sequence, scene=scene())
    records = []
    for frame in again:
        prepared = cache.prepared_scene(frame.scene)
        assert prepared.intersector is not None
        records.append(prepared.record.geometry)
        del frame
    # The floor, the wall and the lamp; the die and the ball: each once, for all frames.
    assert sorted(numbers) == sorted([2 + 2 + 2, *(len(again.scene.meshes[k].faces) for k in (0, 2))])
    for record in records[1:]:
        assert record.vertices is records[0].vertices and record.triangles is records[0].triangles
        assert np.array_equal(record.middle, records[0].middle)
    # Nothing is kept when the sequence goes.
    here = pl.Sequence(scene(), pl.camera.example_camera(), (0, 1), motions={"die": TURN})
    assert cache.prepared_scene(here[0].scene).intersector is not None
    assert cache._kept._last is not None
    del here
    assert cache._last._last is None and cache._kept._last is None


def test_only_the_camera_moves(sequence, monkeypatch):
    still = dataclasses.replace(sequence, motions={})
    assert all(frame.scene is still.scene for frame in still)
    posed = dataclasses.replace(still, camera=still.camera.posed((0, 0, 9), look_at=(9, 0, 9)))
    first = posed[0].camera.pose
    expected = still[0].camera.pose.to_world(posed.camera.pose.to_world([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(first.to_world([1.0, 2.0, 3.0]), expected, atol=1e-12)
    # Lights change and trees stay.
    lights = [[dataclasses.replace(LAMP, radiance=r)] for r in (10.0, 20.0)]
    changing = pl.Sequence(scene(), sequence.camera, (0, 1), motions={"die": TURN}, lights=lights)
    assert [frame.scene.lights[0].radiance for frame in changing] == [10.0, 20.0]
    first = cache.prepared_scene(changing[0].scene).intersector
    second = cache.prepared_scene(changing[1].scene).intersector
    assert first._still is second._still and first.meshes[0].tree is second.meshes[0].tree


def test_impossible_sequences_are_refused(sequence):
    assert repr(sequence) == "Sequence(5 frames from 0 to 2 s, moving: die, ball, the camera)"
    assert len(list(sequence)) == len(sequence) == 5 and sequence[-1].time == 2.0
    with pytest.raises(IndexError):
        sequence[5]
    for change, what in (
        ({"times": (0, 0)}, "ascend"),
        ({"motions": {"dice": TURN}}, "'dice', which 0 meshes"),
        ({"motions": {"QuadLight 0": TURN}}, "move lights by"),
        ({"motions": {"die": np.eye(4)}}, "motion of 'die'"),
        ({"lights": [[LAMP]]}, "lights for 1 frames of 5"),
        ({"lights": 5 * [[1.0]]}, "lights holds float"),
    ):
        with pytest.raises(InvalidValueError, match=what):
            dataclasses.replace(sequence, **change)
