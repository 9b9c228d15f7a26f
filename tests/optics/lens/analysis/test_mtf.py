"""Geometric point spread and modulation transfer: uniform discs, sums, and how errors are reported."""

import math
import pickle

import mpmath
import numpy as np
import pytest

from plenoptic import CircularStop, LensModel, load_lens
from plenoptic.aberrations import diffraction_mtf, mtf, point_spread, spot_diagram
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.best_focus import working_f_number
from plenoptic.optics.lens.gaussian import paraxial

GAUSS = load_lens("double-gauss-100mm-f2")
DISC = GAUSS.with_model(LensModel.PARAXIAL).with_stop(CircularStop(10.0))  # out of focus, an evenly filled disc
DEFOCUS = 2.0
Z_DISC = paraxial.cardinal_points(DISC).rear_focus + DEFOCUS
DIAMETER = DEFOCUS / working_f_number(DISC)


def disc_mtf(frequencies: np.ndarray) -> np.ndarray:
    x = math.pi * DIAMETER * np.maximum(frequencies, 1e-5)  # at 0 from 1e-5, where it is 1 to 1e-10
    return np.array([abs(float(2 * mpmath.besselj(1, one) / one)) for one in x])


def test_a_uniform_disc():
    frequencies = np.linspace(0.0, 8.0 / DIAMETER, 41)
    found = mtf(DISC, frequencies, z_image=Z_DISC)
    expected = disc_mtf(frequencies)
    for modulus, error in ((found.tangential, found.tangential_error), (found.sagittal, found.sagittal_error)):
        # Student's t with 31 degrees of freedom exceeds 4.5 in 9e-5 of cases; near zeros of the MTF there is a bias.
        assert np.all(np.abs(modulus - expected) <= 4.5 * error + 1e-9) and np.all(error < 3e-3)
    assert found.tangential[0] == 1.0 and found.tangential_error[0] < 1e-15


def test_the_error_is_honest():
    frequency = np.array([0.6 / DIAMETER])
    expected = disc_mtf(frequency)[0]
    runs = [mtf(DISC, frequency, z_image=Z_DISC, rays=512, seed=seed) for seed in range(60)]
    scores = np.array([(run.tangential[0] - expected) / run.tangential_error[0] for run in runs])
    # As those of spots: Student's t with 31 degrees of freedom.
    assert 0.4 < np.mean(scores**2) < 1.9 and np.abs(scores).max() < 4.5
    stated = np.array([run.tangential_error[0] ** 2 for run in runs])
    assert stated.std(ddof=1) / stated.mean() < 0.35


def test_at_low_frequencies_only_the_variance_counts():
    for field in ((0.0, 0.0), (0.0, 0.1), (-0.1, 0.05)):
        spot = spot_diagram(GAUSS, field=field, rays=1 << 14)
        along = np.array(field) / math.hypot(*field) if any(field) else np.array([0.0, 1.0])
        along_field = along[0] * spot.x + along[1] * spot.y
        across = along[1] * spot.x - along[0] * spot.y
        frequency = 0.02 / spot.geometric_radius
        found = mtf(GAUSS, [frequency], field=field)
        for modulus, position in ((found.tangential, along_field), (found.sagittal, across)):
            variance = float(spot.weight @ (position - spot.weight @ position) ** 2)
            # ln MTF = -2 (pi nu)^2 variance + terms of (2 pi nu r)^4 / 24.
            limit = (2 * math.pi * 0.02) ** 4 / 24
            expected = -2 * (math.pi * frequency) ** 2 * variance
            assert math.log(modulus[0]) == pytest.approx(expected, abs=2 * limit), field


def test_values_lie_between_0_and_1():
    lines = (486.1, 587.6, 656.3)
    found = mtf(GAUSS, np.linspace(0.0, 100.0, 21), field=(0.05, 0.12), wavelength=lines, rays=2048)
    for values in (found.tangential, found.sagittal, found.diffraction):
        assert np.all((values >= 0) & (values <= 1)) and values[0] == 1.0
    assert found.wavelengths == lines and pickle.loads(pickle.dumps(found)) == found
    # A perfect image has full contrast: a spot of 1e-13 mm at 1000 cycles per mm.
    perfect = mtf(DISC, [0.0, 100.0, 1000.0], field=(0.0, 0.1))
    assert perfect.tangential == pytest.approx(1.0, abs=1e-9)
    assert perfect.sagittal == pytest.approx(1.0, abs=1e-9)
    assert mtf(GAUSS, 10.0, rays=64).tangential.shape == (1,)


def test_the_limit_by_diffraction_is_the_overlap_of_two_pupils():
    f_number, wavelength, nodes = 2.8, 550.0, 200_000
    cutoff = 1.0 / (f_number * wavelength * 1e-6)
    parts = np.array([0.0, 0.2, 0.5, 0.9, 1.0, 1.5])
    found = diffraction_mtf(parts * cutoff, f_number=f_number, wavelength=wavelength)
    # Two unit discs whose centres are 2 s apart: 4 times the part of one quadrant beyond x = s, over pi.
    for s, value in zip(np.minimum(parts, 1.0), found, strict=True):
        x = s + (np.arange(nodes) + 0.5) * (1.0 - s) / nodes
        # The midpoint rule at the square root's end: (1 / n)^1.5.
        assert value == pytest.approx(4.0 * np.sqrt(1.0 - x * x).mean() * (1.0 - s) / math.pi, abs=1e-7), s
    # It comes with an MTF.
    found = mtf(GAUSS, [50.0], z_object=-404.0, rays=64)
    f_number = working_f_number(GAUSS, -404.0)
    assert np.array_equal(found.diffraction, diffraction_mtf([50.0], f_number=f_number))
    nothing = mtf(GAUSS.with_model(LensModel.NONE), [1.0], z_object=-404.0, z_image=50.0, rays=64)
    assert np.isnan(nothing.diffraction).all()


def test_all_light_is_accounted_for():
    whole = point_spread(GAUSS, field=(0.0, 0.1), rays=1 << 14)
    assert whole.image.sum() == pytest.approx(1.0, rel=1e-12) and whole.outside < 1e-12
    part = point_spread(GAUSS, field=(0.0, 0.1), rays=1 << 14, pixel_size=0.001, shape=(20, 40))
    assert part.image.shape == (20, 40) and 0.1 < part.outside < 0.9
    assert part.image.sum() + part.outside == pytest.approx(1.0, rel=1e-12)
    # A perfect image falls on one pixel.
    assert point_spread(DISC, shape=(5, 5), pixel_size=0.001).image[2, 2] == pytest.approx(1.0, rel=1e-12)
    assert point_spread(DISC).image.sum() == pytest.approx(1.0, rel=1e-12)


def test_a_disc_is_flat_and_the_picture_seen_with_y_up():
    spread = point_spread(DISC, z_image=Z_DISC, shape=(40, 40), pixel_size=DIAMETER / 32)
    step = (np.arange(40) - 19.5) * DIAMETER / 32
    radius = np.hypot(*np.meshgrid(step, step))
    inside = radius < DIAMETER / 2 - DIAMETER / 32
    density = spread.image[inside]
    expected = (DIAMETER / 32) ** 2 / (math.pi * DIAMETER**2 / 4)
    # 2^17 rays on some 800 pixels: 160 on each; Poisson's error is an upper bound for evenly spread points.
    assert np.abs(density / expected - 1).max() < 5 / math.sqrt(160)
    assert np.all(spread.image[radius > DIAMETER / 2 + DIAMETER / 32] == 0)
    # Errors are right on average: mean squared deviation in units of the mean squared error, over 700 pixels.
    ratio = np.mean((density - expected) ** 2) / np.mean(spread.standard_error[inside] ** 2)
    assert 0.7 < ratio < 1.4
    spot = spot_diagram(GAUSS, field=(0.05, 0.1), rays=1 << 14)
    corner = spot.centroid + np.array([0.05, -0.02])
    spread = point_spread(GAUSS, field=(0.05, 0.1), rays=1 << 14, centre=corner, pixel_size=0.005, shape=(100, 120))
    assert spread.outside == 0.0
    x = spread.centre[0] + (np.arange(120) - 59.5) * 0.005
    y = spread.centre[1] - (np.arange(100) - 49.5) * 0.005
    found = [spread.image.sum(axis=0) @ x, spread.image.sum(axis=1) @ y]
    # A pixel moves each ray by at most half its width, and their mean by far less.
    assert found == pytest.approx(spot.centroid, abs=0.0025 / 5)


def test_what_cannot_be_computed():
    for call, message in (
        (lambda: mtf(GAUSS, [-1.0]), "frequencies holds a number that is below 0"),
        (lambda: mtf(GAUSS, [math.nan]), "frequencies holds a number"),
        (lambda: mtf(GAUSS, ["x"]), "frequencies is not an array of numbers"),
        (lambda: mtf(GAUSS, [1.0], field=(0, 1.3)), "no ray from the field .* passes the lens"),
        (lambda: point_spread(GAUSS, field=(0, 1.3)), "no ray from the field .* passes the lens"),
        (lambda: point_spread(GAUSS, shape=(0, 3)), "rows is 0; it must be at least 1"),
        (lambda: point_spread(GAUSS, shape=5), r"shape is 5; it must be \(rows, columns\)"),
        (lambda: point_spread(GAUSS, pixel_size=0.0), "pixel_size is 0 mm"),
        (lambda: point_spread(GAUSS, centre=(0.0,)), "centre has shape"),
        (lambda: diffraction_mtf([1.0], f_number=0.0), "f_number is 0; it must be above 0"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            call()
