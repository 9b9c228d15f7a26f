"""Light of sheets that media scatter once towards the camera, against quadrature along the line of sight."""

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl

sys.path.insert(0, str(Path(__file__).parent))
from pinholes import flat, pinhole, radiance, radiance_once  # noqa: E402

Sheet, Medium = pl.lights.Sheet, pl.materials.Medium
NARROW = pinhole(1e-4, 2)
STOP = flat(pl.box(1.0, center=(0, 0, -400.5), material=pl.Lambertian(0.0)))
"""Ends the line of sight after 400 mm."""
WATER = Medium(1e-3, 2e-3, pl.materials.HenyeyGreenstein(0.5))


def scattered_once(sheet, absorption, scattering, g=0.0, irradiance=None, steps=400_000):
    """Midpoint rule along the axis of the camera: light is weakened from its start to there, and on to the camera."""
    t = (np.arange(steps) + 0.5) * (400.0 / steps)
    offset = np.stack([0 * t, 0 * t, -t], axis=1) - sheet.position
    s, a = offset @ sheet.direction, offset @ sheet.normal
    width2 = (sheet.thickness / 2) ** 2 + (s * math.tan(sheet.divergence)) ** 2
    slope = a * s * math.tan(sheet.divergence) ** 2 / width2
    stretch = np.hypot(1.0, slope)
    fluence = sheet.thickness / 2 / np.sqrt(width2) * np.exp(-2 * a * a / width2) * stretch * (s >= sheet.start)
    cosine = (sheet.direction[2] + slope * sheet.normal[2]) / stretch
    phase = (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
    left = np.exp(-(absorption + scattering) * (t + (s - sheet.start) * stretch))
    total = float(np.sum(fluence * phase * left)) * 400.0 / steps
    return scattering * total * (sheet.irradiance if irradiance is None else irradiance)


@pytest.mark.parametrize(
    ("sheet", "largest_error"),
    [
        # Across the ray, oblique, convergent, almost along it both ways, in its plane, and cut by the end of the ray.
        (Sheet((0, 0, -200), (1, 0, 0), (0, 0, 1), 1.0, 1e3, start=-100.0), 1e-4),
        (Sheet((0, 0, -200), (1, 0, -1), (1, 0, 1), 2.0, 1e3, divergence=0.1, start=-100.0), 3e-3),
        (Sheet((30, 0, -200), (1, 0, -1), (1, 0, 1), 2.0, 1e3, divergence=0.3, start=-100.0), 0.05),
        (Sheet((0, 0, -200), (0.02, 0, -1), (1, 0, 0.02), 2.0, 1e3, start=-100.0), 0.05),
        (Sheet((0.3, 0, -200), (0.05, 0, 1), (1, 0, -0.05), 2.0, 1e3, divergence=0.02, start=-150.0), 0.05),
        (Sheet((0.3, 0, -200), (0, 0, -1), (1, 0, 0), 2.0, 1e3, divergence=0.02, start=-150.0), 0.05),
        (Sheet((0, 0, -401), (1, 0, 0), (0, 0, 1), 3.0, 1e3, start=-100.0), 1e-4),
        (Sheet((0, 0, -100), (1, 0, 0), (0, 0, 1), 400.0, 1e3, start=-10.0), 0.05),
    ],
)
def test_light_of_sheets_is_that_of_quadrature(sheet, largest_error):
    scene = pl.Scene([STOP], [sheet], medium=WATER)
    shots = [radiance_once(scene, NARROW, 64, seed, max_bounces=1).mean() for seed in range(16)]
    expected = scattered_once(sheet, 1e-3, 2e-3, 0.5)
    # The spread of 4 pixels of 64 samples; 4.5 errors of the mean, and 1e-5 for the float32 of images and the surface.
    assert np.std(shots) < largest_error * expected
    assert abs(np.mean(shots) - expected) < 4.5 * np.std(shots, ddof=1) / 4 + 1e-5 * expected


@pytest.mark.parametrize(("scattering", "largest_error"), [(1e-4, 3e-6), (1e-3, 3e-5)])
def test_thin_sheets_in_thin_media_have_small_errors(scattering, largest_error):
    # With distances drawn by the extinction alone, 64 samples have errors of 2.5 and 2.3 here.
    sheet = Sheet((0, 0, -200), (1, 0, 0), (0, 0, 1), 1.0, 1e3, start=-100.0)
    scene = pl.Scene([STOP], [sheet], medium=Medium(0.0, scattering))
    seen = np.stack([radiance_once(scene, NARROW, 64, seed, max_bounces=1) for seed in range(8)])
    relative = seen / scattered_once(sheet, 0.0, scattering) - 1
    assert math.sqrt(np.square(relative).mean()) < largest_error


def test_scattered_light_has_the_coefficients_of_its_wavelength():
    water = pl.materials.pure_water()
    absorption, scattering, irradiance = 30 * np.array(water.absorption), np.array((1e-3, 2e-3, 4e-3)), (1.0, 3.0, 2.0)
    sheet = Sheet((0, 0, -200), (1, 0, 0), (0, 0, 1), 1.0, irradiance, start=-150.0)
    scene = pl.Scene([STOP], [sheet], medium=Medium(tuple(absorption), tuple(scattering)))
    for wavelength in (430.0, 590.0):
        camera = dataclasses.replace(NARROW, sensitivity=pl.sensor.Sensitivity.lines([wavelength]))
        a, b, light = (pl.sensor.rgb_to_spectrum(rgb, [wavelength])[0] for rgb in (absorption, scattering, irradiance))
        seen = radiance_once(scene, camera, 64, max_bounces=1).mean()
        assert seen == pytest.approx(scattered_once(sheet, a, b, irradiance=light), rel=2e-4)


def test_colours_beside_other_lights():
    # Three channels whose media differ, and a lamp that shines away from the line of sight and takes half of the draws.
    medium = Medium((1e-3, 3e-3, 0.0), (2e-3, 0.0, 5e-3), pl.materials.HenyeyGreenstein(0.5))
    sheet = Sheet((0, 0, -200), (1, 0, -0.3), (0.3, 0, 1), 4.0, (300.0, 200.0, 100.0), divergence=0.05, start=-100.0)
    lamp = pl.lights.SpotLight((30.0, 0.0, -100.0), (1, 0, 0), 1e5, inner_angle=0.1, outer_angle=0.2)
    scene = pl.Scene([STOP], [sheet, lamp], medium=medium)
    mean, error = radiance(scene, NARROW, samples=256, seeds=12, max_bounces=1)
    mean, error = mean.mean(axis=(0, 1)), np.sqrt(np.square(error).sum(axis=(0, 1))) / 4
    for c, (a, b) in enumerate(zip(medium.absorption, medium.scattering, strict=True)):
        expected = scattered_once(sheet, a, b, 0.5, irradiance=sheet.irradiance[c])
        assert error[c] <= 0.01 * expected
        assert abs(mean[c] - expected) <= 4.5 * error[c] + 1e-5 * expected
