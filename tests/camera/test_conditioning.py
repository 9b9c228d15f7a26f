"""Condition numbers of the paths of a camera: those that are rendered."""

import dataclasses

import numpy as np
import pytest
from camera_helpers import camera_with, refused

import plenoptic as pl
from plenoptic.camera.camera_record import camera_record
from plenoptic.camera.conditioning import camera_conditioning

CAMERA = camera_with(stop=10.0, shape=(64, 48))
TABLES = camera_record(CAMERA)
SKY = pl.Scene(background=1.0)
SENSOR, PIXEL = (0, 64, 0, 48), (32, 33, 24, 25)


def test_paths_are_those_that_are_rendered():
    # All paths of a pixel and of a single replicate: the same rays, and so the same ones lost where.
    for row, column in ((32, 24), (3, 40)):
        region = np.s_[row : row + 1, column : column + 1]
        sky = pl.render(SKY, CAMERA, samples=1024, replicates=1, seed=7, region=region, progress=False)
        conditioning = camera_conditioning(TABLES, (row, row + 1, column, column + 1), seed=7, rays=1024)
        assert conditioning.rays == sky.stats.paths == 1024
        assert conditioning.lost == sky.stats.lost and len(conditioning.lost) >= 1


def test_pixels_are_spread_over_the_region():
    conditioning = camera_conditioning(TABLES, SENSOR, seed=3)
    assert 900 <= conditioning.rays <= 1024
    assert conditioning.elements.tolist() == list(range(10, -1, -1))
    assert conditioning.reached[0] == conditioning.rays - sum(conditioning.lost_at(None).values())
    assert conditioning == camera_conditioning(TABLES, SENSOR, seed=3) != camera_conditioning(TABLES, SENSOR, seed=4)
    # As many lost as in the image, within five standard deviations of as many independent paths.
    lost_fraction = 1.0 - pl.render(SKY, CAMERA, samples=8, seed=3, progress=False).stats.fraction_through_lens
    lost = sum(conditioning.lost_by_cause.values())
    assert abs(lost - lost_fraction * conditioning.rays) < 5 * np.sqrt(
        conditioning.rays * lost_fraction * (1 - lost_fraction)
    )


def test_digits_are_lost_on_the_way_from_the_array():
    # 93 mm from the array to the last surface, of semi-diameter 18 mm, twice, and the terms of its equation and its
    # place, 30.31 mm: about 220 / 20 mm.
    conditioning = camera_conditioning(TABLES, SENSOR)
    last = CAMERA.lens.elements[10].semi_diameter
    assert conditioning.cancellation[0, 1] * last == pytest.approx(2 * (123.3 - 30.31) + 30.31, rel=0.05)
    assert conditioning.worst.element == 10 and conditioning.worst.condition.name == "CANCELLATION"


def test_dark_pixels_have_no_rays():
    # Behind a small iris, micro images are small, and some pixels of a row lie between them.
    small = camera_with(stop=0.5, shape=(64, 48))
    tables = camera_record(small)
    rays = []
    for column in range(20, 30):
        conditioning = camera_conditioning(tables, (32, 33, column, column + 1), rays=16)
        region = np.s_[32:33, column : column + 1]
        stats = pl.render_white(small, samples=16, region=region, replicates=8, progress=False).stats
        assert conditioning.rays == stats.paths
        dark = sum(count for cause, element, count in stats.lost if cause == "missed" and element is None)
        assert (conditioning.worst is None) == (conditioning.rays == dark)
        rays.append(conditioning.rays)
    assert set(rays) == {0, 16}
    with refused("conditioning is 0"):
        pl.render_white(small, samples=16, conditioning=0, progress=False)


@pytest.mark.slow
def test_paths_of_colour_cameras_have_their_wavelengths():
    colour = dataclasses.replace(CAMERA, sensitivity=pl.sensitivities.cie_1931())
    region = np.s_[32:33, 24:25]
    sky = pl.render(SKY, colour, samples=1024, replicates=1, seed=7, region=region, progress=False)
    conditioning = camera_conditioning(camera_record(colour), PIXEL, seed=7, rays=1024)
    assert conditioning.lost == sky.stats.lost
    # Red and blue meet the surfaces otherwise than the camera's own wavelength.
    assert conditioning.refraction[0].tolist() != camera_conditioning(TABLES, PIXEL, seed=7).refraction[0].tolist()
