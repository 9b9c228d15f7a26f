"""Pictures of points with diffraction: closed forms of openings, two methods beside each other, energy, sampling."""

import math

import mpmath
import numpy as np
import pytest
from test_wavefront import WAVE, perfect

import plenoptic as pl
from plenoptic.aberrations import SpreadMethod, wave_spread, wavefront
from plenoptic.errors import InvalidValueError

GRID = 96
EDGE = 3.0 / GRID**1.5
"""What an edge that is found to a point of the grid leaves of an area, and so of an amplitude."""


def cosines(lens, *points):
    """Of rays through points of the iris, x and y."""
    return wavefront(lens, pupil=np.array(points) * (1 - 1e-9)).toward[:, :2]


def bessel(v):
    x, place = np.unique(v, return_inverse=True)
    found = np.array([float(2 * mpmath.besselj(1, one) / one) if one else 1.0 for one in x])
    return found[place].reshape(np.shape(v))


def radii(spread):
    rows, columns = spread.image.shape
    y, x = np.mgrid[:rows, :columns]
    return spread.pixel_size * np.hypot(x - columns // 2, y - rows // 2)


def test_a_round_opening_makes_airys_pattern():
    """(2 J1(v) / v)^2, dark at 0.610, 1.117 and 1.619 of the wavelength over the sine, and with Airy's peak."""
    lens = perfect(pl.CircularStop(5.0))
    unit = WAVE / abs(cosines(lens, (1, 0))[0, 0])
    spread = wave_spread(lens, shape=(161, 161), pixel_size=unit / 16, grid=GRID)
    v = 2 * math.pi * radii(spread) / unit
    np.testing.assert_allclose(spread.image / spread.perfect, bessel(v) ** 2, rtol=0, atol=2 * EDGE)
    line = spread.image[80, 80:] / spread.perfect
    dips = [k for k in range(1, 79) if line[k] < line[k - 1] and line[k] < line[k + 1]][:3]
    np.testing.assert_allclose(np.array(dips) / 16, [0.6098, 1.1166, 1.6192], atol=1 / 32)
    # The peak per area: pi (sine / wavelength)^2.
    assert spread.perfect / spread.pixel_size**2 == pytest.approx(math.pi / unit**2, rel=3 * EDGE)
    assert spread.strehl == pytest.approx(1, abs=1e-9)
    # Rayleigh: within the dark rings are 1 - J0^2 - J1^2.
    for ring, part in ((0.6098, 0.8378), (1.1166, 0.9099), (1.6192, 0.9376)):
        # It is dark there, so that pixels, which count by their middles, hardly count on the rim.
        assert float(spread.image[radii(spread) <= ring * unit].sum()) == pytest.approx(part, abs=0.003)
    # Far out 2 / (pi v) are left; the picture is a square.
    v = 2 * math.pi * 5
    assert 2 / math.pi / (math.sqrt(2) * v) < spread.outside < 2 / math.pi / v


def test_an_annulus_makes_the_difference_of_two_airy_patterns():
    inner = 0.5
    lens = perfect(pl.optics.RingStop(semi_diameter=5.0, inner_semi_diameter=5.0 * inner))
    sine = abs(cosines(perfect(pl.CircularStop(5.0)), (1, 0))[0, 0])
    spread = wave_spread(lens, pixel_size=WAVE / sine / 8, grid=GRID)
    v = 2 * math.pi * sine / WAVE * radii(spread)
    expected = ((bessel(v) - inner**2 * bessel(inner * v)) / (1 - inner**2)) ** 2
    np.testing.assert_allclose(spread.image / spread.perfect, expected, rtol=0, atol=4 * EDGE / (1 - inner**2))


def test_defocus_dims_the_middle_as_a_sinc():
    """sin^2(x) / x^2 with x = pi times the waves of defocus at the rim, W020."""
    lens = perfect(pl.CircularStop(5.0))
    sine = abs(cosines(lens, (1, 0))[0, 0])
    waves = 0.5
    shift = waves * WAVE / (1 - math.sqrt(1 - sine**2))
    plane = pl.paraxial.cardinal_points(lens).rear_focus + shift
    spread = wave_spread(lens, z_image=plane, shape=(17, 17), grid=GRID)
    assert spread.image[8, 8] / spread.perfect == pytest.approx(np.sinc(waves) ** 2, abs=3 * EDGE)


def test_both_methods_agree_to_what_the_transform_leaves_out():
    """A phase of 5e-3 radians: intensities to twice that times the root, and its square, of the perfect peak."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.PolygonStop(6, 6.0, 0.2))
    how = {"field": (0.1, 0.1), "shape": (21, 21), "pixel_size": 4e-3, "grid": GRID}
    one, other = (wave_spread(lens, method=method, **how) for method in SpreadMethod)
    assert (one.method, other.method) == tuple(SpreadMethod)
    assert wave_spread(lens, **how).method is SpreadMethod.FOURIER and other.perfect == one.perfect
    bound = one.perfect * (2 * 5e-3 * np.sqrt(other.image / one.perfect) + 5e-3**2)
    assert (np.abs(one.image - other.image) <= bound).all() and (one.image != other.image).any()
    # Huygens' sum is that over points of the iris each with their area, not only over directions evenly spaced.
    x = other.pixel_size * (np.arange(21) - 10)
    places = np.stack([*np.meshgrid(x, -x), np.zeros((21, 21))], axis=-1)
    there = wavefront(lens, field=(0.1, 0.1), pupil=pl.aiming.square_grid(96)).point_spread(places)
    np.testing.assert_allclose(other.image / other.perfect, there, rtol=0, atol=3 * EDGE)


def test_a_tilted_plane_is_out_of_focus_where_it_leaves_the_image():
    """Along the tilt axis as on the plane across; off it as on the plane through that place."""
    lens = perfect(pl.CircularStop(10.0))
    tilted = wave_spread(lens, shape=(41, 3), pixel_size=4e-3, tilt=(0.5, 0.0))
    assert tilted.method is SpreadMethod.HUYGENS
    places = [[0.0, 4e-3 * (20 - k) * math.cos(0.5), 4e-3 * (20 - k) * math.sin(0.5)] for k in range(41)]
    there = wavefront(lens, pupil=pl.aiming.square_grid(96)).point_spread(places)
    np.testing.assert_allclose(tilted.image[:, 1] / tilted.perfect, there, rtol=0, atol=3 * EDGE)
    with pytest.raises(InvalidValueError, match="FOURIER needs an untilted image plane"):
        wave_spread(lens, tilt=(0.5, 0.0), method=SpreadMethod.FOURIER)


def test_colours_add_up_where_each_has_its_image():
    lens = pl.load_lens("singlet-100mm-f4").with_stop(pl.CircularStop(2.0))
    focus = pl.paraxial.cardinal_points(lens).rear_focus
    how = {"field": (0.0, 0.1), "z_image": focus, "pixel_size": 2e-3, "grid": 96}
    lines = (486.1, 656.3)
    both = wave_spread(lens, wavelength=lines, weights=[3.0, 1.0], **how)
    one, other = (wave_spread(lens, wavelength=line, **how) for line in lines)
    pixels = (other.centre - one.centre)[:2] / 2e-3
    assert abs(pixels[1]) > 1
    y, x = np.mgrid[:65, :65]

    def middle(image):
        return np.array([(image * x).sum(), -(image * y).sum()]) / image.sum()

    # Diffraction's tails go beyond the picture, and its middle is that of what is within.
    expected = (middle(one.image) * 3 + middle(other.image) + pixels) / 4
    np.testing.assert_allclose(middle(both.image), expected, atol=0.3)


def test_a_grid_too_coarse_says_so():
    lens = perfect(pl.CircularStop(10.0))
    plane = pl.paraxial.cardinal_points(lens).rear_focus + 20.0
    for how, text in (
        ({"grid": 32, "shape": (65, 65)}, r"paths from neighbouring grid points .* differ by .* or grid=\d+"),
        ({"z_image": plane}, "the limit is a half; give a smaller picture$"),
        ({"tilt": (0.1, 0.2, 0.3)}, "tilt is .*; it must be two angles"),
        ({"weights": [1.0, 2.0]}, "weights must be 1 numbers"),
    ):
        with pytest.raises(InvalidValueError, match=text):
            wave_spread(lens, **how)
