"""Contrast with diffraction: closed forms of perfect lenses, the transform of point spreads, colours."""

import math

import numpy as np
import pytest
from test_wavefront import WAVE, perfect

import plenoptic as pl
from plenoptic.aberrations import wave_mtf, wavefront
from plenoptic.errors import InvalidValueError

GRID = 96
EDGE = 2.0 / GRID**1.5
"""What an edge that is found to a point of the grid leaves of an area."""


def sine_at_rim(lens):
    rim = wavefront(lens, pupil=[[1 - 1e-9, 0.0], [0.0, 1 - 1e-9]])
    return np.hypot(rim.toward[:, 0], rim.toward[:, 1])[0]


def test_a_round_stop_has_the_contrast_of_two_circles():
    lens = perfect(pl.CircularStop(10.0))
    cutoff = 2 * sine_at_rim(lens) / WAVE
    frequencies = np.linspace(0, 1.1, 23) * cutoff
    found = wave_mtf(lens, frequencies, grid=GRID)
    v = np.minimum(frequencies / cutoff, 1.0)
    expected = 2 / math.pi * (np.arccos(v) - v * np.sqrt(1 - v**2))
    # The field on the sphere is not quite even: at f/5 by the square of a tenth.
    np.testing.assert_allclose(found.tangential, expected, atol=EDGE + 2e-3)
    np.testing.assert_allclose(found.sagittal, expected, atol=EDGE + 2e-3)
    assert found.tangential[0] == 1 and (found.tangential[-2:] == 0).all()


def test_defocus_makes_contrast_fall_as_hopkins_has_it():
    """At a low frequency f, 2 J1(a) / a with a = 2 pi f times the radius of the blurred disc (H. H. Hopkins, 1955)."""
    import mpmath

    lens = perfect(pl.CircularStop(10.0))
    shift = 0.4
    plane = pl.paraxial.cardinal_points(lens).rear_focus + shift
    slope = math.tan(math.asin(sine_at_rim(lens)))
    frequencies = np.array([1.0, 3.0, 6.0, 9.0])
    a = 2 * math.pi * frequencies * slope * shift
    expected = [abs(float(2 * mpmath.besselj(1, x) / x)) for x in a]
    found = wave_mtf(lens, frequencies, z_image=plane, grid=GRID)
    cutoff = 2 * sine_at_rim(lens) / WAVE
    np.testing.assert_allclose(found.tangential, expected, atol=0.01 + 2 * 9.0 / cutoff)


def test_it_is_the_transform_of_huygens_point_spread():
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
    wave = wavefront(lens, field=(0.0, 0.15), pupil=pl.aiming.square_grid(56))
    pixel, n = 1.5e-3, 72  # mm; f/10: below half of 5.9 um
    side = pixel * (np.arange(n) - n // 2)
    x, y = np.meshgrid(side, side, indexing="ij")
    spread = wave.point_spread(np.stack([x, y, 0 * x], axis=-1))
    frequencies = np.array([20.0, 60.0, 100.0])
    found = wave_mtf(lens, frequencies, field=(0.0, 0.15))
    across, along = (np.exp(-2j * math.pi * frequencies[:, None] * side) @ spread.sum(axis=k) for k in (1, 0))
    # Beyond the picture, of 9 Airy radii, there are 1.5 % of the light.
    np.testing.assert_allclose(found.sagittal, abs(across) / spread.sum(), atol=0.03)
    np.testing.assert_allclose(found.tangential, abs(along) / spread.sum(), atol=0.03)


def test_colours_add_up_where_each_has_its_image():
    lens = pl.load_lens("singlet-100mm-f4").with_stop(pl.CircularStop(2.0))
    how = {"field": (0.0, 0.1), "z_image": pl.paraxial.cardinal_points(lens).rear_focus, "grid": 64}
    frequencies = [10.0, 30.0]
    one, other = (wave_mtf(lens, frequencies, wavelength=w, **how) for w in (486.1, 656.3))
    both = wave_mtf(lens, frequencies, wavelength=(486.1, 656.3), **how)
    mean = 0.5 * (one.sagittal + other.sagittal)
    assert (both.sagittal <= mean + 1e-9).all()
    # Lateral colour shifts the two images along the field: contrast depends on the phase between them.
    where = {"field": how["field"], "z_image": how["z_image"]}
    shift = np.diff([wavefront(lens, wavelength=w, **where).image[1] for w in (486.1, 656.3)])[0]
    assert abs(shift) > 1e-3
    least, most = 0.5 * abs(one.tangential - other.tangential), 0.5 * (one.tangential + other.tangential)
    assert ((both.tangential >= least - 1e-9) & (both.tangential <= most + 1e-9)).all()
    alone = wave_mtf(lens, frequencies, wavelength=(486.1, 656.3), weights=(1.0, 0.0), **how)
    np.testing.assert_array_equal(alone.tangential, one.tangential)


def test_contrast_turns_with_the_field():

    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
    along_y, along_x = (wave_mtf(lens, [50.0], field=f, grid=GRID) for f in ((0.0, 0.15), (0.15, 0.0)))
    assert along_x.tangential[0] == pytest.approx(along_y.tangential[0], abs=5 * EDGE)
    assert along_x.sagittal[0] == pytest.approx(along_y.sagittal[0], abs=5 * EDGE)


def test_what_is_impossible_says_so():
    lens = pl.load_lens("double-gauss-100mm-f2")
    for traced, frequencies, how, text in (
        (lens, [-1.0], {}, "frequencies holds a number that is below 0"),
        (lens, [1.0], {"wavelength": (500, 600), "weights": [1.0]}, "weights must be 2 numbers"),
        (lens.with_model(pl.LensModel.THIN), [1.0], {}, "has no aberrations; use LensModel.EXACT"),
    ):
        with pytest.raises(InvalidValueError, match=text):
            wave_mtf(traced, frequencies, **how)
