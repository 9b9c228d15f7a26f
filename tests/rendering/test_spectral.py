"""Spectral rendering: one pass agrees with many monochrome renderings."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl

CAMERA = pl.camera.example_camera()
REGION = np.s_[200:224, 230:262]
LINES = pl.sensor.Sensitivity.lines((640.0, 550.0, 450.0))


def coloured_scene(transform=lambda colour: colour):
    """Scene with coloured materials, or with a function of their colours."""
    floor = pl.quad((-30, -30, -404), (60, 0, 0), (0, 60, 0), material=pl.Lambertian(transform((0.8, 0.5, 0.1))))
    wall = pl.quad((-3, -3, -402), (3, 0, 1), (0, 6, 0), material=pl.Lambertian(transform((0.1, 0.3, 0.9))))
    light = pl.QuadLight((0, 30, -360), (20, 0, 0), (0, 12, -16), radiance=transform((3.0, 5.0, 9.0)), two_sided=True)
    lamp = pl.quad((1, -3, -403), (2, 0, 0), (0, 6, 0), material=pl.Emissive(transform((0.5, 0.2, 0.05))))
    return pl.Scene(meshes=[floor, wall, lamp], lights=[light], background=transform((0.2, 0.1, 0.3)))


@pytest.mark.parametrize("bounces", [3, *(pytest.param(n, marks=pytest.mark.slow) for n in (0, 1))])
def test_lines_are_three_monochrome_renderings(bounces):
    scene = coloured_scene()
    lines = dataclasses.replace(CAMERA, sensitivity=LINES)
    shot = pl.render(scene, lines, samples=768, region=REGION, max_bounces=bounces, progress=False)
    for channel, wavelength in enumerate((640.0, 550.0, 450.0)):
        at = dataclasses.replace(CAMERA, wavelength=wavelength)
        alone = pl.render(scene, at, samples=256, region=REGION, max_bounces=bounces, seed=1, progress=False)
        difference = float((shot.image[..., channel] - alone.image[..., channel]).sum(dtype=float))
        errors = np.hypot(shot.standard_error[..., channel], alone.standard_error[..., channel])
        assert abs(difference) < 4 * math.sqrt(np.square(errors, dtype=float).sum())


def test_one_spectral_pass_is_the_weighted_sum_of_monochrome_ones():
    # Smooth responses from 420 to 680 nm, and an image that changes smoothly with wavelength: 14 nodes of Gauss and
    # Legendre integrate both far below the noise.
    wavelengths = np.linspace(420.0, 680.0, 27)
    peaks, widths = np.array([600.0, 540.0, 470.0]), np.array([40.0, 40.0, 30.0])
    response = np.exp(-0.5 * ((wavelengths[:, None] - peaks) / widths) ** 2)
    seen = pl.sensor.Sensitivity(wavelengths, response)
    scene, settings = coloured_scene(), {"region": np.s_[8:24, 16:40], "max_bounces": 2, "progress": False}
    shot = pl.render(scene, dataclasses.replace(CAMERA, sensitivity=seen), samples=1024, **settings)
    nodes, weights = np.polynomial.legendre.leggauss(14)
    nodes, weights = 550.0 + 130.0 * nodes, 130.0 * weights
    share = weights[:, None] * seen.normalised.at(nodes)
    total, variance = np.zeros(3), np.zeros(3)
    for k, wavelength in enumerate(nodes):
        # A monochrome camera sees the scene's lift at its wavelength: as a grey scene of these values.
        grey = coloured_scene(lambda colour, at=wavelength: float(pl.sensor.rgb_to_spectrum(colour, [at])[0]))
        at = dataclasses.replace(CAMERA, wavelength=float(wavelength))
        alone = pl.render(grey, at, samples=256, seed=k + 1, **settings)
        total += share[k] * float(alone.image.sum(dtype=float))
        variance += share[k] ** 2 * float(np.square(alone.standard_error, dtype=float).sum())
    error = np.sqrt(variance + np.square(shot.standard_error, dtype=float).sum(axis=(0, 1)))
    # The responses are piecewise linear between samples 10 nm apart: the nodes see them to some 0.5 %.
    difference = shot.image.sum(axis=(0, 1), dtype=float) - total
    assert np.all(np.abs(difference) < 4 * error + 5e-3 * total)
    assert np.all(error < 0.02 * total)


def test_white_stays_white():
    # Radiance 1 is 1 at every wavelength, and sensitivities are normalised: channels differ by vignetting alone.
    response = np.array([[0.0, 0.2, 1.0], [0.3, 1.0, 0.1], [1.0, 0.1, 0.0]])
    seen = pl.sensor.Sensitivity(np.array([450.0, 550.0, 650.0]), response)
    shot = pl.render_white(dataclasses.replace(CAMERA, sensitivity=seen), samples=1024, region=REGION, progress=False)
    plain = pl.render_white(CAMERA, samples=256, region=REGION, seed=1, progress=False)
    ratio = shot.image.sum(axis=(0, 1), dtype=float) / float(plain.image.sum(dtype=float))
    error = np.sqrt(np.square(shot.standard_error, dtype=float).sum(axis=(0, 1))) / float(plain.image.sum(dtype=float))
    # The exit pupil's size changes with wavelength by less than 1 %.
    assert np.all(np.abs(ratio - 1) < 4 * error + 0.01)


def test_the_same_bits_in_regions_and_on_threads():
    camera = dataclasses.replace(CAMERA, sensitivity=LINES)
    scene = coloured_scene()
    whole = pl.render(scene, camera, samples=16, region=REGION, progress=False, threads=1)
    part = pl.render(scene, camera, samples=16, region=np.s_[206:220, 240:250], progress=False, threads=2, tile_side=5)
    assert np.array_equal(whole.image[6:20, 10:20], part.image)
