"""Vignetting, illumination and the size of the field: closed forms, and the renderer."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import largest_field, relative_illumination, vignetting
from plenoptic.aiming import aimed_rays_reverse, chief_ray
from plenoptic.optics.lens.elements import with_round_stops

RADIUS, RIM, APART = 4.0, 6.0, 20.0


def two_stops() -> pl.LensStack:
    """An iris of 4 mm, 20 mm behind a hole of 6 mm, and surfaces that do nothing."""
    nothing = pl.Surface(math.inf, 1.0, pl.optics.AIR, semi_diameter=500.0)
    return pl.LensStack([nothing, pl.CircularStop(RIM, thickness=APART), pl.CircularStop(RADIUS)], iris=2)


def overlap(a: float, b: float, apart: float) -> float:
    """Area that two circles have in common."""
    if apart >= a + b:
        return 0.0
    if apart <= abs(a - b):
        return math.pi * min(a, b) ** 2
    u = math.acos((apart**2 + a**2 - b**2) / (2 * apart * a))
    v = math.acos((apart**2 + b**2 - a**2) / (2 * apart * b))
    return a * a * (u - math.sin(2 * u) / 2) + b * b * (v - math.sin(2 * v) / 2)


def test_two_stops_leave_the_overlap_of_two_circles():
    angles = np.array([-0.3, 0.0, 0.2, 0.3, 0.6])
    found = vignetting(two_stops(), angles, grid=128)
    shift = APART * np.tan(angles)
    expected = np.array([overlap(RADIUS, RIM, abs(s)) for s in shift]) / (math.pi * RADIUS**2)
    assert np.all(np.abs(found.fraction - expected) <= 4 * found.standard_error + 1e-12)
    # From above, light reaches the upper part of the iris less: the rays come down from the hole by the shift.
    cut = np.where(np.abs(shift) < RADIUS + RIM, np.minimum(1.0, (RIM - np.abs(shift)) / RADIUS), np.nan)
    whole = np.where(np.isnan(cut), np.nan, 1.0)
    # Found to two parts in 129^3.
    assert found.upper == pytest.approx(np.where(angles > 0, cut, whole), abs=2e-6, nan_ok=True)
    assert found.lower == pytest.approx(-np.where(angles < 0, cut, whole), abs=2e-6, nan_ok=True)
    assert largest_field(two_stops()) == pytest.approx(math.atan(RIM / APART), rel=2e-6)
    # From a point at a finite distance, through the centre of the iris.
    assert largest_field(two_stops(), z_object=-200.0) == pytest.approx(200.0 * RIM / APART, rel=2e-6)


def test_the_error_of_the_fraction_is_that_of_other_grids():
    angles = np.linspace(0.15, 0.4, 12)
    expected = np.array([overlap(RADIUS, RIM, s) for s in APART * np.tan(angles)]) / (math.pi * RADIUS**2)
    off = []
    for grid in (40, 47, 61, 75):
        found = vignetting(two_stops(), angles, grid=grid)
        off.append((found.fraction - expected) / found.standard_error)
    # 48 samples of 1, which are not quite independent; the symmetry of the outline to the grid costs some.
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 2.0


# Beyond their largest fields, of 33 and 67 degrees, which nobody uses, these two pass some rays again.
def test_chief_rays_pass_up_to_the_largest_field():
    for name in sorted({*pl.lens_names()} - {"tessar-102mm-f4.5", "asphere-15mm-f0.9"}):
        lens = pl.load_lens(name)
        # A secondary mirror shades the middle of the pupil, where chief rays pass.
        lens = dataclasses.replace(lens, elements=with_round_stops(lens.elements))
        limit = largest_field(lens)
        for share, passes in ((0.5, True), (0.9999, True), (1.0001, False)):
            assert (lens.trace(chief_ray(lens, field=(0.0, share * limit))).status[0] == 0) == passes, name


def test_the_fourth_power_of_the_cosine_and_the_aperture_angle_decide():
    # Without glass, the iris alone: its projected solid angle from the plane of the image.
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(0.5)).with_model(pl.LensModel.NONE)
    angles = np.array([0.0, 0.2, 0.5, 0.7])
    found = relative_illumination(lens, angles)
    distance = found.z_image
    assert found.heights == pytest.approx(-distance * np.tan(angles), abs=1e-10)
    assert found.projected_solid_angle[0] == pytest.approx(math.pi * 0.5**2 / (0.5**2 + distance**2), rel=1e-3)
    # A disc of finite size differs by (0.5 / 100)^2.
    assert np.all(np.abs(found.relative - np.cos(angles) ** 4) <= 4 * found.standard_error + 1e-4)
    for name in ("topogon-100mm-f6.3", "fisheye-100mm-f8", "achromat-100mm-f4.4"):
        lens = pl.load_lens(name)
        found = relative_illumination(lens, [0.0, 0.1])
        rim = aimed_rays_reverse(lens, image_point=(0, 0), z_image=found.z_image, pupil=[[0.0, 1.0]])
        # pi sin^2 u', exactly, where the iris is what limits; about 20000 cells count to 3e-4.
        assert found.projected_solid_angle[0] == pytest.approx(math.pi * rim.direction[0, 1] ** 2, rel=1.3e-3), name
        assert found.relative[0] == 1.0 and found.standard_error[0] == 0.0, name


def test_the_renderer_sees_the_same_illumination():
    for name in ("double-gauss-100mm-f2", "singlet-100mm-f4"):
        lens = pl.load_lens(name)
        pitch, rows = 0.05, 801
        found = relative_illumination(lens, np.array([0.0, 0.16]))
        camera = pl.PlenopticCamera(lens=lens, sensor=pl.Sensor(shape=(rows, 1), pixel_pitch=pitch),
                                    stop_to_microlenses=found.z_image)  # fmt: skip
        for height, solid in zip(found.heights, found.projected_solid_angle, strict=True):
            # By symmetry, above and below the axis are the same.
            row = round((abs(height) / pitch) + rows / 2 - 0.5)
            white = pl.render_white(camera, samples=4096, region=np.s_[row : row + 1, 0:1], progress=False)
            # Seven degrees of freedom: 6 standard errors are 1 in 2000.
            error = 6 * np.hypot(white.standard_error[0, 0, 0], 3e-4 * solid)
            # The pixel's centre is up to half a pitch away, over which the illumination changes by some 1e-3.
            assert abs(white.image[0, 0, 0] - solid) < error + 1.5e-3 * solid, name


def test_what_no_ray_reaches_is_dark():
    lens = pl.load_lens("double-gauss-100mm-f2")
    found = relative_illumination(lens, [0.1, 0.7])
    assert 0.5 < found.relative[0] < 1 and found.relative[1] == 0.0
    none = vignetting(lens, [0.7])
    assert none.fraction[0] == 0.0 and math.isnan(none.upper[0])
    # A polygonal iris counts its own area.
    assert vignetting(lens.with_stop(pl.PolygonStop(blades=6, semi_diameter=5.0)), [0.0]).fraction.tolist() == [1.0]
    with pytest.raises(pl.errors.InvalidValueError, match="at least 8"):
        relative_illumination(lens, [0.1], grid=2)
    with pytest.raises(pl.errors.InvalidValueError, match="behind the last"):
        relative_illumination(lens, [1.0], z_object=-1e3 / 14)
