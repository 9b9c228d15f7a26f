"""Light sheets on surfaces and in media, against closed forms."""

import dataclasses
import math
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError, SceneError

sys.path.insert(0, str(Path(__file__).parent))
from pinholes import pinhole, radiance, radiance_once  # noqa: E402

Medium = pl.materials.Medium
NARROW = pinhole(1e-4, 2)
"""Sees 0.02 mm of a surface 100 mm away."""
ALBEDO = 0.7


def floor(normal=(0.0, 0.0, 1.0), material=None):
    """A square whose middle is 100 mm in front of the camera."""
    normal = np.divide(normal, np.linalg.norm(normal))
    u = np.cross(normal, (0.3, 1.0, 0.1))
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    corner = np.array([0.0, 0.0, -100.0]) - 40 * (u + v)
    return pl.quad(corner, 80 * u, 80 * v, material=pl.Lambertian(ALBEDO) if material is None else material)


def vector_irradiance(sheet, point):
    """Power per area along each axis, constant between two rays; slope of the rays; and distance from the waist."""
    s, a = ((np.asarray(point) - sheet.position) @ axis for axis in (sheet.direction, sheet.normal))
    square = (sheet.thickness / 2) ** 2 + (s * math.tan(sheet.divergence)) ** 2
    slope = a * s * math.tan(sheet.divergence) ** 2 / square
    across = sheet.thickness / 2 / math.sqrt(square) * math.exp(-2 * a * a / square)
    return np.multiply.outer(sheet.irradiance, across * (sheet.direction + slope * sheet.normal)), slope, s


@pytest.mark.parametrize(
    ("sheet", "normal"),
    [
        (pl.lights.Sheet((0, 0, 9), (0, 0, -1), (1, 0, 0), thickness=50.0, irradiance=3.0), (0, 0, 1)),
        (pl.lights.Sheet((20, 5, 9), (0.3, 0, -1), (1, 0, 0.3), 50.0, 3.0, divergence=0.4), (0, 0, 1)),
        (pl.lights.Sheet((-20, 5, -9), (0.3, 0.5, -1), (1, 0, 0.3), 30.0, (3.0, 0, 1.0), 0.4), (0.8, 0.1, 1)),
        (pl.lights.Sheet((9, 7, -150), (0, 0.1, -1), (0, 1, 0.1), 40.0, 2.0, 1.0, start=-140.0), (0.1, 0.8, 1)),
    ],
)
def test_surfaces_are_lit_by_the_closed_form(sheet, normal):
    # The place that is seen varies by 1e-4 of the sheet's width: linear terms cancel, squares are 1e-8.
    seen = radiance_once(pl.Scene([floor(normal)], [sheet]), NARROW, samples=256, max_bounces=1).mean(axis=(0, 1))
    power, slope, s = vector_irradiance(sheet, (0, 0, -100))
    expected = ALBEDO / math.pi * -power @ np.divide(normal, np.linalg.norm(normal))
    assert np.any(expected > 0.01)
    np.testing.assert_allclose(seen, np.broadcast_to(expected, seen.shape), rtol=1e-5, atol=1e-12)
    # The methods of the light are the same law.
    point = [(0, 0, -100)]
    of_sheet = np.multiply.outer(sheet.irradiance_at(point)[0], sheet.directions_at(point)[0])
    np.testing.assert_allclose(of_sheet, power, rtol=1e-12, atol=1e-15)
    length = math.inf if sheet.start is None else (s - sheet.start) * math.hypot(1, slope)
    assert sheet.lengths_at(point)[0] == pytest.approx(length, rel=1e-12)


def test_planes_across_the_sheet_get_the_same_power():
    camera, sheet = pinhole(0.5, 32), pl.lights.Sheet((0, 0, -30), (0, 0, -1), (1, 0, 0), 8.0, 2.0, divergence=0.15)
    expected = 2.0 * 4.0 * math.sqrt(math.pi / 2)
    for z in (-20.0, -30.0, -60.0, -120.0):
        plane = pl.quad((-200, -200, z), (400, 0, 0), (0, 400, 0), material=pl.Lambertian(1.0))
        mean, error = radiance(pl.Scene([plane], [sheet]), camera, samples=16, seeds=8, max_bounces=1)
        width = -z * 2 * 0.5 / 32
        power, error = math.pi * width * mean.sum() / 32, math.pi * width * np.sqrt(np.square(error).sum()) / 32
        # Pixels weigh places within them by the fourth power of the cosine: up to 1e-3.
        assert error < 5e-3 * expected and abs(power - expected) < 4.5 * error + 2e-3 * expected, z


@pytest.mark.filterwarnings("ignore:the image is black")
def test_rays_fan_out_and_begin_at_the_start():
    # A plate 20 mm before the floor throws the shadow of its edge x = 4 to x = 4 / (1 - slope of 1 mm * 20 mm).
    sheet = pl.lights.Sheet((0, 0, 0), (0, 0, -1), (1, 0, 0), thickness=12.0, divergence=0.2)
    square = 36.0 + (100 * math.tan(0.2)) ** 2
    edge = 4.0 / (1 - 20 * 100 * math.tan(0.2) ** 2 / square)
    assert edge > 4.5
    plate = pl.quad((-50, -50, -80), (54, 0, 0), (0, 100, 0), material=pl.Lambertian(0.0))
    for x, start, is_lit in ((edge - 0.05, None, False), (edge + 0.05, None, True), (edge - 0.05, 85.0, True)):
        light = dataclasses.replace(sheet, start=start)
        camera = dataclasses.replace(NARROW, pose=pl.Pose.look_at((60, 0, -90), (x, 0, -100)))
        seen = radiance_once(pl.Scene([floor(), plate], [light], background=1e-6), camera, samples=16, max_bounces=1)
        assert np.all((seen > 1e-3) == is_lit), (x, start)
    scene = pl.Scene([floor()], [dataclasses.replace(sheet, start=101.0)])
    with pytest.warns(pl.errors.ImplausibleSceneWarning, match="Sheet 0 passes"):
        assert not radiance_once(scene, NARROW, samples=4).any()
    assert radiance_once(scene.with_lights([dataclasses.replace(sheet, start=99.0)]), NARROW, samples=4).all()


def test_a_medium_weakens_the_light_from_its_start():
    sheet = pl.lights.Sheet((20, 5, 9), (0.3, 0, -1), (1, 0, 0.3), 50.0, 3.0, divergence=0.4, start=-30.0)
    medium = Medium(absorption=(0.01, 0.02, 0.0))
    clear, dim = (
        radiance_once(pl.Scene([floor()], [sheet], medium=m), NARROW, samples=64, max_bounces=1) for m in (None, medium)
    )
    _, slope, s = vector_irradiance(sheet, (0, 0, -100))
    length = (s + 30.0) * math.hypot(1, slope) + 100.0
    np.testing.assert_allclose((dim / clear).mean(axis=(0, 1)), np.exp([-0.01 * length, -0.02 * length, 0]), rtol=1e-5)


@pytest.mark.parametrize("wavelength", [430.0, 505.0, 590.0])
def test_wavelengths_are_weakened_each_by_its_own_coefficient(wavelength):
    camera = dataclasses.replace(NARROW, sensitivity=pl.sensor.Sensitivity.lines([wavelength]))
    coefficients = 30 * np.array(pl.materials.pure_water().absorption)
    light = pl.lights.Sheet((20, 0, 0), (0, 0, -1), (1, 0, 0), 60.0, (1.0, 3.0, 2.0), start=-50.0)
    scene = pl.Scene([floor()], [light], medium=Medium(tuple(coefficients)))
    seen = radiance_once(scene, camera, samples=256, max_bounces=1)
    emitted, weakening = (pl.sensor.rgb_to_spectrum(rgb, [wavelength])[0] for rgb in (light.irradiance, coefficients))
    expected = ALBEDO / math.pi * emitted * math.exp(-2 * (20 / 30) ** 2 - weakening * 250.0)
    assert seen.mean() == pytest.approx(expected, rel=1e-5)
    # Weakened by red, green and blue before the mixture it would be another light.
    mixed = pl.sensor.rgb_to_spectrum(light.irradiance * np.exp(-coefficients * 250.0), [wavelength])[0]
    assert abs(mixed / (emitted * math.exp(-weakening * 250.0)) - 1) > 1e-3


@pytest.mark.filterwarnings("ignore:this scene is hardly")
def test_sheets_that_meet_nothing_are_told():
    camera, away = pinhole(0.2, 4), pl.lights.Sheet((0, 0, 500), (1, 0, 0), (0, 0, 1), thickness=2.0, start=-100.0)
    particles = pl.Points([(0, 0, -90)], sheet=dataclasses.replace(away, position=(0, 0, -90)), cross_section=0.1)
    settings = {"samples": 4, "progress": False, "max_bounces": 1}
    with pytest.warns(pl.errors.ImplausibleSceneWarning, match="Sheet 0 passes all meshes and particles"):
        pl.render(pl.Scene([floor()], [away], background=0.1), camera, **settings)
    with pytest.warns(pl.errors.BlackImageWarning, match="Sheet 1 shines past them"):
        dark = dataclasses.replace(away, irradiance=0.0)
        pl.render(pl.Scene([floor()], [dark, dataclasses.replace(away, position=(0, 0, -97))]), camera, **settings)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for scene in (
            pl.Scene([floor()], [dataclasses.replace(away, position=(0, 0, -101))], background=0.1),
            pl.Scene([floor()], [dataclasses.replace(away, position=(0, 0, -50))], medium=Medium(scattering=0.01)),
            pl.Scene([], [dataclasses.replace(away, position=(0, 0, -50))], medium=Medium(scattering=0.01)),
            pl.Scene([], [particles.sheet], points=particles),
            pl.Scene([floor()], [particles.sheet], points=particles),
        ):
            pl.render(scene, camera, **settings)


def test_sheets_without_start_are_refused_in_media_without_bound():
    sheet = pl.lights.Sheet((0, 0, -90), (1, 0, 0), (0, 0, 1), thickness=2.0)
    with pytest.raises(SceneError, match="light sheet from infinity.*give the sheet a start="):
        pl.Scene([floor()], [sheet], medium=Medium(0.1))
    with pytest.raises(InvalidValueError, match="start is nan"):
        dataclasses.replace(sheet, start=math.nan)
    assert pl.Scene([floor()], [dataclasses.replace(sheet, start=-9)], medium=Medium(0.1)).lights[0].start == -9
