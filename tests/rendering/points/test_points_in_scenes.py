"""Particles beside surfaces in renders: sums of both, hidden ones, regions, colours, sequences."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from camera_helpers import CAMERA, bare_camera

import plenoptic as pl

POINTS = pl.Points([(0.0, 0.0, -404.0), (1.5, 1.0, -400.0), (-2.0, 0.5, -410.0)], intensity=[1e-2, 2e-2, 3e-2])
BARE = bare_camera(shape=(64, 64), pitch=0.08)


def render(scene, camera=BARE, **options):
    return pl.render(scene, camera, **{"samples": 16, "progress": False} | options)


def test_the_image_is_the_sum_of_surfaces_and_particles():
    wall = pl.Scene([pl.quad((-50, -50, -450), (100, 0, 0), (0, 100, 0))], background=0.2)
    both, alone = render(dataclasses.replace(wall, points=POINTS)), render(wall)
    image, error = pl.rendering.point_weights(POINTS, BARE, scene=wall, progress=False).image()
    assert np.allclose(both.image, alone.image + image, rtol=1e-6, atol=0)
    assert np.allclose(both.standard_error, np.hypot(alone.standard_error, error), rtol=1e-6, atol=0)
    only = render(pl.Scene(points=POINTS))
    assert np.allclose(only.image, image, rtol=1e-6, atol=0) and only.image.any()
    assert np.allclose(only.standard_error, error, rtol=1e-6, atol=0)


def test_surfaces_hide_particles():
    """A screen before the upper half of the pupil's light halves the light of a particle; a closed one takes it."""
    free = pl.rendering.point_weights(POINTS, BARE, progress=False)
    screen = pl.Scene([pl.quad((-50, 0, -200), (100, 0, 0), (0, 50, 0))])
    half = pl.rendering.point_weights(POINTS, BARE, scene=screen, progress=False)
    # The first particle is on the axis, and the screen ends there.
    assert abs(half.light[0] / free.light[0] - 0.5) < 0.02
    closed = pl.Scene([pl.quad((-50, -50, -200), (100, 0, 0), (0, 100, 0))])
    assert not pl.rendering.point_weights(POINTS, BARE, scene=closed, progress=False).light.any()
    behind = pl.Scene([pl.quad((-50, -50, -500), (100, 0, 0), (0, 100, 0))])
    assert pl.rendering.point_weights(POINTS, BARE, scene=behind, progress=False) == free
    with pytest.warns(pl.errors.BlackImageWarning):
        render(pl.Scene(points=POINTS), region=np.s_[0:2, 0:2])


@pytest.mark.parametrize("scene", [pl.Scene(points=POINTS), pl.Scene(points=POINTS, background=0.1)])
def test_regions_and_threads_have_the_bits_of_the_whole(scene):
    whole = render(scene, threads=1)
    part = render(scene, threads=2, region=np.s_[16:40, 24:48])
    assert (part.image == whole.image[16:40, 24:48]).all()
    assert (part.standard_error == whole.standard_error[16:40, 24:48]).all()
    assert part.region == (16, 40, 24, 48) and whole.region is None


def test_exposures_of_two_seeds_are_merged():
    shots = [render(pl.Scene(points=POINTS), seed=seed) for seed in (0, 1)]
    both = pl.Exposure.merged(shots)
    mean = (shots[0].image.astype(float) + shots[1].image) / 2
    assert np.allclose(both.image, mean, rtol=1e-6) and both.replicates == 16
    assert (shots[0].image != shots[1].image).any()


def test_coloured_particles_before_a_grey_wall():
    red = dataclasses.replace(POINTS, intensity=np.outer(POINTS.intensity, [1.0, 0.0, 0.0]))
    shot = render(pl.Scene(points=red, background=0.1))
    wall = render(pl.Scene(background=0.1)).image
    assert shot.image.shape[2] == 3 and (shot.image[..., 1:] == wall).all() and (shot.image[..., :1] > wall).any()
    assert shot.standard_error.shape == shot.image.shape


def test_frames_of_a_sequence_have_their_particles():
    velocity, times = (100.0, 0.0, 0.0), [0.0, 0.002]
    frames = [POINTS.moved(velocity, time) for time in times]
    sequence = pl.Sequence(pl.Scene(points=POINTS), CAMERA, times, points=frames)
    assert [frame.scene.points for frame in sequence] == frames
    with pytest.raises(pl.errors.InvalidValueError, match="points for 1 frames of 2"):
        pl.Sequence(pl.Scene(points=POINTS), CAMERA, times, points=frames[:1])


def test_plans_and_truth_of_particles_alone_are_those_of_nothing():
    scene = pl.Scene(points=POINTS)
    assert "particles" in repr(scene) and pl.plan(scene, BARE) is not None
    with pytest.raises(pl.errors.InvalidValueError, match="leave out checkpoint"):
        render(scene, checkpoint="nowhere")


def test_renders_without_particles_load_none_of_their_code():
    code = (
        "import sys, numpy as np, plenoptic as pl; "
        "pl.render(pl.check_scene(), pl.camera.example_camera(), samples=2, region=np.s_[0:8, 0:8], progress=False); "
        "print([m for m in sys.modules if m.startswith('plenoptic.rendering.points') or m.startswith('scipy.sparse')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
