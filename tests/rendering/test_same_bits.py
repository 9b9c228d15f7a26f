"""The bits of images and truth depend neither on threads nor on tiles, regions and interruptions."""

import signal

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.rendering.schedule import tile_jobs

BY_NAME = pl.Truth.OBJECT_SHARE | pl.Truth.CHORD_DISPARITY | pl.Truth.OPTICAL_DISTANCE | pl.Truth.TRANSMITTANCE
EVERYTHING = pl.Truth.ALL | BY_NAME
LENS = pl.load_lens("double-gauss-100mm-f2")
VIEWS = [None, ((0, 0, 0), (-1, 0, 0), (0, 0, 1)), ((0, 0, 0), (0, 1, -0.3), (1, 0, 0))]


def trial(number):
    """A camera that looks at a finely divided ball with a light behind it, and how it is rendered."""
    rng = np.random.default_rng(number)
    odd = int(rng.integers(2))
    microlenses = rng.random() < 0.7
    lens = LENS.with_stop(pl.CircularStop(float(rng.choice([5.0, 1.0, 0.2]))))
    lens = lens.with_model([pl.LensModel.EXACT, pl.LensModel.THIN][rng.integers(2)])
    lattice = [pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE][rng.integers(2)]
    array = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=lattice) if microlenses else None
    sensor = pl.Sensor(shape=(32 + odd, 32 + odd), pixel_pitch=0.02 if microlenses else 0.7)
    camera = pl.PlenopticCamera(lens, sensor, 123.3, array, float(rng.choice([1.7, 2.0])) if microlenses else 0.0)
    ball = pl.sphere(180.0, center=(0, 0, -400), segments=(256, 128), material=pl.Lambertian(0.6))
    lamp = pl.QuadLight((-150, 150, -100), (300, 0, 0), (0, 0, 90), radiance=3.0)
    scene = pl.Scene([ball], lights=[lamp], background=0.3)
    view = VIEWS[rng.integers(3)]
    if view is not None:
        pose = camera.posed(*view).pose
        camera = camera.posed(*view)
        scene = scene.transformed(np.vstack([np.column_stack([pose.rotation, pose.position]), [0, 0, 0, 1]]))
    top, left = rng.integers(0, 12, 2)
    return scene, camera, np.s_[top : top + 15, left : left + 17]


def same(one, other):
    assert np.array_equal(one.image, other.image) and np.array_equal(one.standard_error, other.standard_error)
    assert one.truth == other.truth


def held(number, tmp_path, monkeypatch):
    scene, camera, region = trial(number)
    settings = {"samples": 8, "seed": number, "truth": EVERYTHING, "progress": False, "max_bounces": 1}
    whole = pl.render(scene, camera, threads=1, tile_side=16, **settings)
    assert np.isfinite(whole.truth.depth).any()
    for threads, side in ((2, 7), (3, 16), (8, 64)):
        same(pl.render(scene, camera, threads=threads, tile_side=side, **settings), whole)
    part = pl.render(scene, camera, threads=2, tile_side=7, region=region, **settings)
    assert np.array_equal(part.image, whole.image[region])
    seen = part.image.any(axis=-1)  # where all is dark, errors are those of what pixels around have met
    assert np.array_equal(part.standard_error[seen], whole.standard_error[region][seen])
    for name, array in part.truth.arrays().items():
        np.testing.assert_array_equal(array, getattr(whole.truth, name)[region], err_msg=name)
    assert pl.ground_truth(scene, camera, truth=EVERYTHING, threads=2) == whole.truth
    path, original, calls = tmp_path / f"{number}.part", tile_jobs.render_tile, []

    def interrupted(*arguments, **named):
        calls.append(0)
        if len(calls) == 5:
            signal.raise_signal(signal.SIGINT)
        return original(*arguments, **named)

    with monkeypatch.context() as patched:
        patched.setattr(tile_jobs, "render_tile", interrupted)
        with pytest.warns(pl.errors.BudgetWarning):
            begun = pl.render(scene, camera, threads=1, tile_side=7, checkpoint=path, **settings)
    assert begun.interrupted
    same(pl.render(scene, camera, threads=2, tile_side=7, checkpoint=path, **settings), whole)


@pytest.mark.filterwarnings("ignore::plenoptic.errors.PlenopticWarning")
@pytest.mark.parametrize("numbers", [range(1), pytest.param(range(1, 14), marks=pytest.mark.slow)])
def test_the_same_bits_however_it_is_rendered(numbers, tmp_path, monkeypatch):
    for number in numbers:
        held(number, tmp_path, monkeypatch)


def test_a_sensor_tilted_about_both_axes_has_the_same_bits_in_parts():
    """Centres of groups of pixels lie where outlines of the pupil change; products of arrays round by their length."""
    camera = pl.PlenopticCamera(pl.load_lens("double-gauss-105mm-f1.4"), pl.Sensor((12, 12), 0.025), 128.4)
    camera = camera.moved(pl.CameraPart.SENSOR, tilt=(0.01, 0.005, 0.0))
    scene = pl.Scene([pl.quad((-90, -90, -400), (180, 0, 0), (0, 180, 0), material=pl.Lambertian(0.6))], background=1.0)
    settings = {"samples": 16, "replicates": 8, "progress": False}
    for taken in (lambda **more: pl.render_white(camera, **more), lambda **more: pl.render(scene, camera, **more)):
        whole = taken(**settings)
        np.testing.assert_array_equal(taken(tile_side=4, **settings).image, whole.image)
        for row in range(0, 12, 3):
            part = taken(region=np.s_[row : row + 1, 8:9], **settings)
            np.testing.assert_array_equal(part.image, whole.image[row : row + 1, 8:9])
    np.testing.assert_array_equal(part.truth.depth, whole.truth.depth[row : row + 1, 8:9])
