"""Pictures beside those of Mitsuba 3, a path tracer that was written independently, of the same scenes and cameras.

Both see a scene through a thin lens with a round stop. What is compared is radiance: our irradiance over the closed
form of the aperture's projected solid angle. Mitsuba gives all of the aperture the same weight, we the projected solid
angle of each part of it. From one edge of the stop to the other that changes by 8 (off axis) (aperture radius) / (image
distance)^2, 0.7 % in the corners: a blurred edge shows it by some 0.1 % of its contrast, below the noise.

Mitsuba starts rays 9e-5 (1 + largest coordinate) above a surface. So all scenes stand around the origin of the world.
"""

import numpy as np
import pytest

import plenoptic as pl

pytest.importorskip("mitsuba", reason="the extra `validation` installs it")
import in_mitsuba  # noqa: E402
from mitsuba_scenes import SCENES, camera, lambertian_bodies, objects, open_box, projected_solid_angles  # noqa: E402

pytestmark = pytest.mark.validation

SAMPLES = 1024
BLOCK = 8
"""Pixels along a block."""
MOST = 4.5
"""Standard errors: by chance, one of 1.5e5 numbers is farther off."""
PRECISION = 3e-3
"""Relative standard error of the mean over the picture: a test that knows less shows nothing."""


def disagreements(ours, theirs, least=0.85):
    """In which respects two pictures differ by more than their standard errors allow.

    Standard errors come from 16 replicates and 16 seeds. If noise is normal, a difference over such an error has the
    variance n / (n - 2), n between 15 and 30, and so an RMS of 1.04 to 1.07. Blocks have far more degrees of freedom.
    """
    difference = ours.image - theirs.image
    variance = ours.standard_error**2 + theirs.standard_error**2
    noisy = variance > 0
    found = []
    if np.any(difference[~noisy]):
        found.append("pixels without noise")
    error_of_mean = np.sqrt(variance.mean(axis=(0, 1)) / variance[..., 0].size)
    if np.any(error_of_mean > PRECISION * theirs.image.mean(axis=(0, 1))):
        found.append("precision")
    if np.any(np.abs(difference.mean(axis=(0, 1))) > MOST * error_of_mean):
        found.append("mean")
    if not least < rms(difference[noisy] / np.sqrt(variance[noisy])) < 1.2:
        found.append("pixels")
    lit = block_sums(variance) > 0
    blocks = np.where(lit, block_sums(difference) / np.sqrt(np.where(lit, block_sums(variance), 1.0)), 0.0)
    # An RMS of n numbers scatters by 1 / sqrt(2 n); the three channels may be as one.
    if rms(blocks) > 1 + MOST / np.sqrt(2 * blocks[..., 0].size) or np.abs(blocks).max() > MOST:
        found.append("blocks")
    grey, error = difference.mean(axis=-1), np.sqrt(variance).mean(axis=-1)  # channels may be as one
    for axis, name in ((0, "shift along columns"), (1, "shift along rows")):
        slope = np.gradient(theirs.image.mean(axis=-1), axis=axis)
        # What a shift would explain of the difference, over the standard error of that.
        if np.abs(np.sum(slope * grey)) > MOST * np.sqrt(np.sum((slope * error) ** 2)):
            found.append(name)
    return found


def rms(numbers):
    return float(np.sqrt(np.mean(np.square(numbers))))


def block_sums(array):
    rows, columns, channels = array.shape
    return array.reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK, channels).sum(axis=(1, 3))


def both(scene, seen_by, **settings):
    settings = {"samples": SAMPLES, **settings}
    return in_mitsuba.ours(scene, seen_by, **settings), in_mitsuba.theirs(scene, seen_by, **settings)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
def test_both_see_the_same(scene):
    assert disagreements(*both(scene(), camera())) == []


def test_both_see_the_reference_scene_alike():
    seen_by = camera(pixel_pitch=0.1, position=(0, 0, 404))
    assert disagreements(*both(objects(), seen_by, samples=2 * SAMPLES)) == []


@pytest.mark.parametrize("max_bounces", [0, 1, 2])
def test_depth_limits_mean_the_same(max_bounces):
    # Without a bounce only edges are noisy, and stratified points there make less noise together than replicates say.
    pictures = both(open_box(), camera(), max_bounces=max_bounces, samples=4 * SAMPLES)
    assert disagreements(*pictures, least=0.85 if max_bounces else 0.5) == []


def test_a_wide_stop_blurs_alike():
    """Bodies up to 13 mm out of focus: circles of confusion of up to 1.2 pixels."""
    seen_by = camera(semi_diameter=6.0)
    assert disagreements(*both(lambertian_bodies(), seen_by, samples=2 * SAMPLES)) == []


def test_the_white_image_is_the_projected_solid_angle_of_the_aperture():
    """Averaged over the pixels: at their centres it differs by 4e-7, 19 times the error."""
    seen_by, finer = camera(semi_diameter=10.0), camera(semi_diameter=10.0, pixel_pitch=0.15 / 8, pixels=8 * 48)
    white = pl.render_white(seen_by, samples=2048, progress=False)
    closed = projected_solid_angles(finer).reshape(48, 8, 48, 8).mean(axis=(1, 3))[..., None]
    error = np.sqrt(np.mean(white.standard_error**2) / white.image.size)
    assert abs((white.image - closed).mean()) < MOST * error < 1e-3 * closed.mean()


def test_what_would_be_wrong_would_show():
    """Half a percent of the light, a tenth of a percent of a picture's width, and one wrong surface."""
    ours, theirs = both(lambertian_bodies(), camera())
    down, right = (np.gradient(theirs.image, axis=axis) for axis in (0, 1))
    assert "mean" in disagreements(ours._replace(image=1.005 * ours.image), theirs)
    assert "shift along columns" in disagreements(ours._replace(image=ours.image + 0.048 * down), theirs)
    assert "shift along rows" in disagreements(ours._replace(image=ours.image + 0.048 * right), theirs)
    spot = np.ones((48, 48, 1))
    spot[8:16, 16:24] = 1.02
    assert disagreements(ours._replace(image=spot * ours.image), theirs) == ["blocks"]
    assert "pixels" in disagreements(
        ours._replace(standard_error=0.5 * ours.standard_error),
        theirs._replace(standard_error=0.5 * theirs.standard_error),
    )
