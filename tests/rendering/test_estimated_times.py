"""Estimated processor time beside that of the render, which is held to a quarter of it: medians of calls in turns."""

import itertools
import statistics
import time

import numpy as np
import pytest

import plenoptic as pl

pytestmark = pytest.mark.slow
WITHIN, NOISE = 0.25, 0.15
"""Largest error of estimates, and what a shared machine adds to it in medians of some turns."""


def camera():
    """A new one: nothing is known from the render before. 34 mm fill the picture at z = -404 mm."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(2.0)).with_model(pl.LensModel.THIN)
    return pl.PlenopticCamera(lens, pl.Sensor((192, 192), 0.05), 130.0).focused_at(z=-404.0)


def glass_in_a_corner():
    """Three layers of balls, between which light is bent and thrown to and fro, before a wall that shines."""
    wall = pl.quad((-100, -100, -600), (200, 0, 0), (0, 200, 0), material=pl.Emissive(1.0, two_sided=True))
    ball = pl.sphere(1.2, segments=(48, 24), material=pl.Dielectric(1.7))
    places = itertools.product(np.arange(4.0, 20.0, 2.5), np.arange(4.0, 20.0, 2.5), (-404, -407, -410))
    return pl.Scene([wall, *(ball.translated(*place) for place in places)])


def medians(scene, camera, **options):
    """Processor time of renders and its estimate, of new cameras."""
    estimates, times = [], []
    for _ in range(5):
        estimates.append(pl.estimate(scene, camera(), **options).cpu_seconds.value)
        fresh, begin = camera(), time.process_time()
        pl.render(scene, fresh, **options)
        times.append(time.process_time() - begin)
    return statistics.median(times), statistics.median(estimates)


def test_a_corner_that_costs_several_times_the_rest():
    scene, options = glass_in_a_corner(), {"max_bounces": 24, "truth": pl.Truth.NONE, "progress": False}

    def estimated(**more):
        return pl.estimate(scene, camera(), samples=64, **options, **more).cpu_seconds.value

    pl.render(scene, camera(), samples=4, **options)  # compiles
    took, whole = medians(scene, camera, samples=64, **options)
    assert abs(took / whole - 1) < WITHIN + NOISE
    # By its left half alone the frame would cost half of that, and by that corner several times as much.
    corner, left = 16 * estimated(region=np.s_[:48, 144:]), 2 * estimated(region=np.s_[:, :96])
    assert corner > 3 * left
    assert left < (1 - WITHIN) * took and corner > (1 + WITHIN) * took


@pytest.mark.parametrize("side, samples", [(8, 4), (48, 512)], ids=["the set-up of pairs", "paths of their own"])
def test_ghosts_of_a_lens(side, samples):
    def camera():
        return pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(side, side))

    options = {"samples": 64, "ghosts": pl.rendering.Ghosts(sensor=0.3, samples=samples), "progress": False}
    pl.render(pl.check_scene(), camera(), **options)  # compiles
    took, estimated = medians(pl.check_scene(), camera, **options)
    assert abs(took / estimated - 1) < WITHIN + NOISE
    image = pl.estimate(pl.check_scene(), camera(), **{**options, "ghosts": None}).cpu_seconds.value
    assert image < (1 - WITHIN) * took
