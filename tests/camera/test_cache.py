"""Last-result cache of camera records and illuminated pixels."""

import dataclasses
import gc
import weakref
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from camera_helpers import the_lens, with_array

import plenoptic as pl
from plenoptic.camera import cache
from plenoptic.camera.cache import prepared_camera

SCENE = pl.Scene([pl.quad((-30, -30, -404), (60, 0, 0), (0, 60, 0), material=pl.Emissive(1.0))])
REGION = np.s_[240:264, 240:264]
ALL = 24 * 24


@pytest.fixture
def counted(monkeypatch):
    """Count compiled cameras, and pixels whose aperture regions are computed."""
    count, find, compile_it = SimpleNamespace(pixels=0, compiled=0), cache.illuminated_pixels, cache.camera_record

    def illuminated_pixels(record, pixels, number, **how):
        count.pixels += len(pixels)
        return find(record, pixels, number, **how)

    def camera_record(camera):
        count.compiled += 1
        return compile_it(camera)

    monkeypatch.setattr(cache, "illuminated_pixels", illuminated_pixels)
    monkeypatch.setattr(cache, "camera_record", camera_record)
    return count


def rendered(camera, **settings):
    budget = {} if "target_error" in settings else {"samples": 8}
    return pl.render(SCENE, camera, **{"region": REGION, "progress": False, "threads": 1, **budget, **settings})


def same(one, other):
    return one.image.tobytes() == other.image.tobytes() and np.array_equal(one.standard_error, other.standard_error)


def test_a_camera_is_compiled_once(counted):
    camera = pl.camera.example_camera()
    first = rendered(camera)
    assert counted.pixels == ALL and not prepared_camera(camera)._illuminated  # who renders once has no use for it
    assert same(rendered(camera), first) and counted.pixels == 2 * ALL
    assert same(rendered(camera), first) and counted.pixels == 2 * ALL
    pl.ground_truth(SCENE, camera, region=REGION)
    assert counted.compiled == 1
    # One of equal parts is another one.
    other = pl.camera.example_camera()
    assert other == camera and same(rendered(other), first)
    assert counted.compiled == 2 and counted.pixels == 3 * ALL


def test_a_camera_with_another_pose_is_not_compiled_again(counted):
    camera = pl.camera.example_camera()
    poses = [pl.Pose.look_at((x, 3.0, 5.0), (0, 0, -404)) for x in (0.0, 2.0, 4.0)]
    # As in a loop over frames: what they share stays with the sensor.
    shots = [rendered(dataclasses.replace(camera, pose=pose)) for pose in poses]
    assert counted.compiled == 1 and counted.pixels == 2 * ALL  # kept from the second time on
    for shot, pose in zip(shots, poses, strict=True):
        assert same(shot, rendered(dataclasses.replace(pl.camera.example_camera(), pose=pose)))
    assert counted.compiled == 4


def test_illuminated_pixels_are_computed_once_for_all_steps(counted):
    camera = pl.camera.example_camera()
    shot = rendered(camera, target_error=0.02)
    assert shot.samples > 32 and counted.pixels == ALL
    # Other tiles take the place of these.
    cut = rendered(camera, tile_side=7)
    assert counted.pixels == 2 * ALL and not prepared_camera(camera)._illuminated
    assert same(cut, rendered(camera))


def test_the_cache_has_a_size_limit(counted, monkeypatch):
    camera, budget = pl.camera.example_camera(), {"target_error": 0.02, "tile_side": 8}
    whole = rendered(camera, **budget)
    assert counted.pixels == ALL
    for limit in (0, 100_000):
        monkeypatch.setattr(cache, "MAX_CACHED_BYTES", limit)
        counted.pixels, other = 0, pl.camera.example_camera()
        assert same(rendered(other, **budget), whole)
        assert counted.pixels > ALL  # in each step those for which there was no room
        cached = prepared_camera(other)._illuminated.values()
        arrays = [
            array for illuminated in cached for array in (*illuminated[:3], *illuminated.regions) if array is not None
        ]
        assert sum(array.nbytes for array in arrays) <= limit
        assert (len(cached) > 0) == (limit > 0)
        assert all(
            array.base is None for illuminated in cached for array in illuminated.regions[:4]
        )  # which would have room for more


def test_dark_pixels_and_different_microlenses_are_cached():
    camera = pl.camera.example_camera()
    dark = dataclasses.replace(camera, lens=the_lens(0.05))
    for each in (with_array(camera, focal_lengths=(1.8, 2.0, 2.2)), dark):
        first = rendered(each, tile_side=3)
        assert all(same(rendered(each, tile_side=3), first) for _ in range(2))
        assert prepared_camera(each)._illuminated


def test_the_cache_is_freed_with_its_camera():
    camera = pl.camera.example_camera()
    rendered(camera, target_error=0.05)
    reference = weakref.ref(prepared_camera(camera))
    assert prepared_camera(camera) is reference() and reference()._illuminated
    del camera
    gc.collect()
    assert reference() is None
    # And when another one comes.
    one, other = pl.camera.example_camera(), pl.camera.example_camera()
    reference = weakref.ref(prepared_camera(one))
    prepared_camera(other)
    gc.collect()
    assert reference() is None


def test_threads_with_different_tiles_do_not_interfere():
    camera, sides, shots = pl.camera.example_camera(), (5, 8, 16), {}
    single = rendered(camera)

    def work(side):
        for _ in range(4):
            shots[side] = rendered(camera, tile_side=side)

    with ThreadPoolExecutor(len(sides)) as threads:
        list(threads.map(work, sides))
    assert all(same(shots[side], single) for side in sides)
