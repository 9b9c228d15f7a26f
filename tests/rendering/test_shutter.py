"""Exposures over time: against means of still frames, rolling ones against geometry, and nothing for nothing."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.rendering.plan.shutter import open_shutter
from plenoptic.scene.cache import prepared_scene
from plenoptic.sequences import Shutter

SIZE = 16
TURN = pl.Motion.screw((0, 1), axis=(0.2, 1, 0.1), through=(1, 0, -404), angle_deg=300, advance=2)
SLIDE = pl.Motion.screw((0, 1), axis=(1, 0.2, 0), advance=8.0)
PAST = pl.Motion((0, 1), [pl.Pose.look_at((x, 1, 0), (0, 0, -404), up=(0.01 * x, 1, 0)) for x in (-8, 8)])


def camera(shutter=None, **changes):
    """A sharp one, with few large pixels."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(3.0))
    sensor = pl.Sensor(shape=(SIZE, SIZE), pixel_pitch=0.2)
    found = pl.PlenopticCamera(lens=lens, sensor=sensor, stop_to_microlenses=125.0, shutter=shutter)
    return dataclasses.replace(found, **changes)


def scene():
    """Matt and smooth things that move before a wall that does not."""
    lamp = pl.QuadLight.facing((0, 60, -300), (0, 0, -404), (40, 40), radiance=2.0)
    parts = {
        "wall": pl.quad((-80, -80, -440), (160, 0, 0), (0, 160, 0), material=pl.Lambertian((0.2, 0.4, 0.6))),
        "die": pl.box(3.0, center=(1.5, 0, -404), material=pl.Lambertian((0.8, 0.3, 0.1))),
        "ball": pl.sphere(1.2, center=(-3, 0, -400), material=pl.Conductor(0.9)),
        "glass": pl.sphere(1.0, center=(0, -2, -396), material=pl.Dielectric(1.5)),
    }
    return pl.Scene([dataclasses.replace(part, name=name) for name, part in parts.items()], [lamp], background=1.0)


def sequence(times, shutter=None):
    motions = {"die": TURN, "ball": SLIDE, "glass": SLIDE}
    return pl.Sequence(scene(), camera(shutter), times, motions=motions, camera_motion=PAST)


def rendered(frame, **settings):
    return pl.render(frame.scene, frame.camera, **{"progress": False, "truth": pl.Truth.NONE, **settings})


def test_motion_blur_is_the_mean_of_still_frames():
    # A blurred exposure against the mean of still frames at the middles of equal intervals.
    duration, count, each, samples = 0.4, 64, 16, 1024
    shot = rendered(sequence([0.5], Shutter(duration))[0], samples=samples, replicates=16)
    times = 0.5 + duration * ((np.arange(count) + 0.5) / count - 0.5)
    frames = [rendered(frame, samples=each, replicates=1, seed=k + 1).image for k, frame in enumerate(sequence(times))]
    # The frames in 16 groups, each spread over the whole time: their spread is that of the mean, and a little more.
    groups = np.array([np.mean(frames[k::16], axis=0) for k in range(16)])
    mean, error = groups.mean(axis=0), np.hypot(groups.std(axis=0, ddof=1) / 4.0, shot.standard_error)
    z = (shot.image - mean) / error
    # Errors are known to a quarter from 16 groups: Student's t of some 20 degrees of freedom, whose variance is 1.1.
    # Pixels are independent; the mean square of 768 of them scatters by some 8 %.
    assert 0.6 < np.mean(z**2) < 1.5
    assert np.mean(np.abs(z) > 3) < 0.015
    assert abs(z.mean()) < 4 * np.sqrt(3 / z.size)  # channels share their paths
    still = rendered(sequence([0.5])[0], samples=samples, replicates=16)
    assert np.mean((still.image - mean) ** 2 / (error**2 + still.standard_error**2)) > 3  # the test can fail


def test_a_rolling_shutter_slants_an_edge():
    bare = camera(sensor=pl.Sensor(shape=(24, 48), pixel_pitch=0.1))
    bare = dataclasses.replace(bare, lens=bare.lens.with_stop(pl.CircularStop(0.5)))
    blind = pl.quad((-40, -40, -404), (40, 0, 0), (0, 80, 0), material=pl.Lambertian(0.0))
    speed, row_time = 80.0, 0.004
    slide = pl.Motion((0, 1), [pl.Pose(np.eye(3), (x, 0, 0)) for x in (-speed / 2, speed / 2)])
    world = pl.Scene([dataclasses.replace(blind, name="blind")], background=1.0)
    rolling = dataclasses.replace(bare, shutter=Shutter(1e-4, row_time=row_time))
    (frame,) = pl.Sequence(world, rolling, [0.5], motions={"blind": slide})
    sky = dataclasses.replace(frame, scene=pl.Scene(background=1.0))
    seen, bright = (rendered(each, samples=1024).image[:, :, 0] for each in (frame, sky))
    edge = (1.0 - seen / bright).sum(axis=1)
    rows = np.arange(24)
    slope, middle = np.polyfit(rows - 11.5, edge, 1)
    per_mm = [bare.project([(x, 0, -404.0)], progress=False).pixel[0, 1] for x in (-0.5, 0.5)]
    expected = (per_mm[1] - per_mm[0]) * speed * row_time  # pixels a row
    # The dark part is left of its edge: it grows from row to row.
    assert slope == pytest.approx(expected, rel=2e-3)
    assert abs(expected) * 23 > 15
    assert np.abs(edge - (middle + slope * (rows - 11.5))).max() < 0.15
    assert middle == pytest.approx(24.0, abs=0.1)  # truth is that of the middle of the sensor
    # From the bottom up it slants the other way.
    upwards = dataclasses.replace(frame.camera, shutter=Shutter(1e-4, row_time=-row_time))
    other = rendered(dataclasses.replace(frame, camera=upwards), samples=256).image[:, :, 0]
    assert np.corrcoef(other.sum(axis=1), rows)[0, 1] > 0.9


def test_where_nothing_moves_bits_and_kernels_are_those_without_a_shutter():
    (still,) = sequence([2.0])
    (shut,) = sequence([2.0], Shutter(0.4, row_time=0.001))  # motions have ended
    assert shut.camera.shutter is not None and shut.camera.shutter.motion is not None
    assert rendered(still, samples=4).image.tobytes() == rendered(shut, samples=4).image.tobytes()
    assert not pl.plan(shut.scene, shut.camera).runs(pl.rendering.Stage.SHUTTER)
    (moving,) = sequence([0.5], Shutter(0.1))
    assert pl.plan(moving.scene, moving.camera).runs(pl.rendering.Stage.SHUTTER)
    record = prepared_scene(shut.scene).record
    assert open_shutter(shut.camera, record) is None and open_shutter(still.camera, record) is None
    plain = pl.Scene([pl.box(3).translated(z=-404)], background=1.0)
    images = [pl.render(plain, camera(shutter), samples=4, progress=False).image for shutter in (None, Shutter(0.1))]
    assert images[0].tobytes() == images[1].tobytes()


def test_bits_depend_on_neither_tiles_nor_threads_nor_regions():
    (frame,) = sequence([0.5], Shutter(0.2, row_time=0.01))
    whole = rendered(frame, samples=8).image
    assert rendered(frame, samples=8, tile_side=5, threads=1).image.tobytes() == whole.tobytes()
    part = rendered(frame, samples=8, region=np.s_[4:9, 3:14]).image
    assert part.tobytes() == whole[4:9, 3:14].tobytes()
    independent = rendered(frame, samples=8, sampler=pl.rendering.Sampler.RANDOM).image
    assert np.isfinite(independent).all() and independent.tobytes() != whole.tobytes()


def test_a_path_is_replayed_at_its_time():
    (frame,) = sequence([0.5], Shutter(0.4))
    shot = rendered(frame, samples=16, replicates=1)
    met = set()
    for row, column in ((7, 9), (8, 4), (10, 8)):
        replays = [pl.replay(shot, frame.scene, pixel=(row, column), sample=k) for k in range(16)]
        total = sum(each.contribution for each in replays) / 16
        np.testing.assert_allclose(total, shot.image[row, column], rtol=1e-5)
        for each in replays:
            met |= {event.place.object for event in each.events if hasattr(event, "place")}
            assert all(np.isfinite(event.point).all() for event in each.events if hasattr(event, "place"))
    assert len(met) >= 3


def test_truth_is_that_of_the_middle(tmp_path):
    (open_,), (still,) = sequence([0.5], Shutter(0.4, row_time=0.01)), sequence([0.5])
    truths = [pl.ground_truth(frame.scene, frame.camera, progress=False) for frame in (open_, still)]
    assert truths[0] == truths[1]
    shot = rendered(open_, samples=2, truth=pl.Truth.DEPTH | pl.Truth.OBJECT)
    assert np.array_equal(shot.truth.depth, still_depth := truths[1].depth) and still_depth.shape == (SIZE, SIZE)
    # The camera goes into a file.
    pl.package.save_value(open_.camera, tmp_path / "camera.json")
    assert pl.package.load_value(tmp_path / "camera.json") == open_.camera


def test_what_cannot_be_blurred_is_refused():
    shining = pl.Scene([pl.box(3, material=pl.Emissive(1.0)).translated(z=-404)])
    clear = pl.MetallicRoughness((0.5, 0.5, 0.5), opacity=0.5)
    veiled = pl.Scene([pl.box(3).translated(z=-404), pl.box(1, material=clear)], background=1.0)
    for world, what in ((shining, "emits moves"), (veiled, "not opaque")):
        moves = pl.Sequence(world, camera(Shutter(0.1)), [0.5], motions={"Mesh 0": SLIDE})
        with pytest.raises(SceneError, match=what):
            rendered(moves[0], samples=1)
        rendered(pl.Sequence(world, camera(Shutter(0.1)), [0.5], camera_motion=PAST)[0], samples=1)
    for numbers, what in (((0.0,), "duration"), ((1.0, np.inf), "row_time"), ((1, 0, 3), "motion")):
        with pytest.raises(InvalidValueError, match=what):
            Shutter(*numbers)
