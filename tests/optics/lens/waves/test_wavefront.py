"""Wavefronts: closed forms of perfect lenses, Seidel's limit, Zernike's polynomials, diffraction patterns."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.aberrations import ZernikeOrder, seidel_sums, wavefront, zernike
from plenoptic.errors import InvalidValueError

WAVE = 587.6e-6  # mm


def perfect(stop, *, n=1.6, focal=100.0):
    """A convex-plane lens the other way round: a plane, then a hyperboloid that images infinity without aberrations."""
    front = pl.Surface(math.inf, 20.0, pl.ConstantMedium(n), semi_diameter=40.0)
    back = pl.Surface(-focal * (n - 1), semi_diameter=40.0, conic=-n * n)
    return pl.LensStack([dataclasses.replace(stop, thickness=1.0), front, back])


def test_a_hyperboloid_has_no_aberrations_but_defocus_as_geometry_has_it():
    """From the focus on, rays at an angle t go shift cos t to the foot below the new image, h = shift sin t from it."""
    lens = perfect(pl.CircularStop(20.0))
    found = wavefront(lens)
    assert found.peak_to_valley < 1e-8 and found.strehl == pytest.approx(1, abs=1e-12)
    assert len(found.opd) == len(found.amplitude) > 3000 and found.amplitude.sum() == pytest.approx(1)
    for shift in (0.01, -0.3, 5.0):
        found = wavefront(lens, z_image=pl.paraxial.cardinal_points(lens).rear_focus + shift)
        from_focus = found.radius * found.toward - [0, 0, -shift]
        cosine = -from_focus[:, 2] / np.linalg.norm(from_focus, axis=1)
        h2 = shift**2 * (1 - cosine**2)
        more = h2 / (found.radius + np.sqrt(found.radius**2 - h2))
        expected = (shift * (1 - cosine) - more) / WAVE
        np.testing.assert_allclose(found.opd, expected, rtol=0, atol=1e-6 + 1e-9 * abs(shift) / WAVE)
        assert np.sign(found.zernike(4)["defocus"]) == np.sign(shift), shift


def test_seidel_is_the_limit_of_small_openings_and_fields():
    """W040 is 6 sqrt 5, W131 3 sqrt 8 and W222 -2 sqrt 6 times Noll's terms 11, 7 and 6, less higher orders."""
    lens = pl.load_lens("singlet-100mm-f4").with_stop(pl.CircularStop(1.0))
    angle = 0.01
    sums = seidel_sums(lens, field=angle).wavefront / WAVE
    fit = wavefront(lens, field=(0.0, angle)).zernike(15)
    assert 6 * math.sqrt(5) * fit[11] == pytest.approx(sums[0], rel=0.005)
    assert 3 * math.sqrt(8) * fit[7] == pytest.approx(sums[1], rel=0.005)
    assert -2 * math.sqrt(6) * fit[6] == pytest.approx(sums[2], rel=0.005)


def test_slopes_are_ray_aberrations():
    """By Malus and Dupin dW = -d . dP along the sphere; the ray goes from P = R t to where it misses the image by m.

    So dW = -R m . dt / |R t - m|, since t . dt = 0: exact, and for small m the ray aberration -m = R dW / (R dt).
    """
    for field in ((0.0, 0.0), (0.0, 0.15), (0.1, -0.1)):
        lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(8.0))
        pupil = np.random.default_rng(1).uniform(-0.6, 0.6, (40, 2))
        h = 1e-3
        one = wavefront(lens, field=field, pupil=pupil)
        missed = lens.trace(pl.aiming.aimed_rays(lens, field=field, pupil=pupil)).at_z(one.z_image) - one.image
        away = np.linalg.norm(one.radius * one.toward - missed, axis=1)
        for step in ((h, 0), (0, h)):
            low, high = (wavefront(lens, field=field, pupil=pupil + sign * np.array(step)) for sign in (-0.5, 0.5))
            assert len(low.opd) == len(high.opd) == len(pupil), field
            change = WAVE * (high.opd - low.opd)
            expected = -one.radius * (missed * (high.toward - low.toward)).sum(axis=1) / away
            # Central differences leave h^2 of the largest, and rounding of paths of 1000 mm.
            np.testing.assert_allclose(change, expected, rtol=0, atol=30 * h**2 * np.abs(expected).max() + 1e-12)
            assert np.abs(expected).max() > 1e-7, field


FRINGE = {1: lambda r, t: 1.0 + 0 * r, 2: lambda r, t: r * np.cos(t), 3: lambda r, t: r * np.sin(t)}
FRINGE |= {4: lambda r, t: 2 * r**2 - 1, 5: lambda r, t: r**2 * np.cos(2 * t)}
FRINGE |= {7: lambda r, t: (3 * r**2 - 2) * r * np.cos(t), 8: lambda r, t: (3 * r**2 - 2) * r * np.sin(t)}
FRINGE |= {9: lambda r, t: 6 * r**4 - 6 * r**2 + 1, 10: lambda r, t: r**3 * np.cos(3 * t)}
FRINGE |= {16: lambda r, t: 20 * r**6 - 30 * r**4 + 12 * r**2 - 1, 17: lambda r, t: r**4 * np.cos(4 * t)}
FRINGE |= {25: lambda r, t: 70 * r**8 - 140 * r**6 + 90 * r**4 - 20 * r**2 + 1}
FRINGE |= {36: lambda r, t: 252 * r**10 - 630 * r**8 + 560 * r**6 - 210 * r**4 + 30 * r**2 - 1}


def test_fringe_polynomials_are_those_of_the_table():
    random = np.random.default_rng(0)
    r, t = np.sqrt(random.random(50)), random.uniform(0, 2 * math.pi, 50)
    for term, formula in FRINGE.items():
        found = zernike(term, r * np.cos(t), r * np.sin(t), order=ZernikeOrder.FRINGE)
        np.testing.assert_allclose(found, formula(r, t), atol=1e-12, err_msg=str(term))


def test_polynomials_are_orthogonal_over_the_disc():
    """By Gauss's rule in r^2 and even angles, exact up to degree 26. NOLL: mean square 1, FRINGE: 1 at the rim."""
    for order in ZernikeOrder:
        nodes, weights = np.polynomial.legendre.leggauss(14)
        angle = 2 * math.pi * np.arange(28) / 28
        r = np.repeat(np.sqrt(0.5 * (nodes + 1)), 28)
        t, weight = np.tile(angle, 14), np.repeat(0.5 * weights, 28) / 28
        terms = 91 if order is ZernikeOrder.NOLL else 37
        table = np.array([zernike(j, r * np.cos(t), r * np.sin(t), order=order) for j in range(1, terms + 1)])
        products = (table * weight) @ table.T
        size = np.sqrt(np.diag(products))
        np.testing.assert_allclose(products / np.outer(size, size), np.eye(terms), atol=1e-11)
        if order is ZernikeOrder.NOLL:
            np.testing.assert_allclose(size, 1, rtol=1e-11)
        else:
            # The last term, 37, is of degree twelve: 1 in the middle and at the rim.
            assert zernike(37, [0.0, 1.0], [0.0, 0.0], order=order) == pytest.approx(1)
            rim = [np.abs(zernike(j, np.cos(t[:28]), np.sin(t[:28]), order=order)).max() for j in range(1, 38)]
            assert max(rim) == pytest.approx(1), order


@settings(max_examples=25)
@given(st.lists(st.floats(-2, 2), min_size=15, max_size=15))
def test_a_fit_finds_what_was_put_in(coefficients):
    points = pl.aiming.square_grid(24)
    opd = sum(a * zernike(j, *points.T) for j, a in enumerate(coefficients, start=1))
    made = dataclasses.replace(BASE, pupil=points, opd=opd, amplitude=np.full(len(opd), 1 / len(opd)))
    fit = made.zernike(15)
    np.testing.assert_allclose(fit.coefficients, coefficients, atol=1e-10)
    assert fit.residual < 1e-10
    left = made.without("piston", "tilt", "defocus")
    np.testing.assert_allclose(left.zernike(4).coefficients, 0, atol=1e-10)
    assert left.rms <= made.rms * (1 + 1e-12) + 1e-12
    kept = made.without("tilt").zernike(4).coefficients
    np.testing.assert_allclose(kept[[0, 3]], made.zernike(4).coefficients[[0, 3]], atol=1e-10)


BASE = wavefront(perfect(pl.CircularStop(2.0)), pupil=pl.aiming.square_grid(24))


def test_an_exit_pupil_at_infinity_is_a_limit():
    """With the stop in the front focus chief rays leave along the axis, and the sphere is a plane."""
    lens = perfect(pl.CircularStop(4.0))
    gap = 1.0 - pl.paraxial.cardinal_points(lens).front_focus  # from the stop, where z is 0, to the first surface

    def with_gap(g):
        elements = (dataclasses.replace(lens.elements[0], thickness=g), *lens.elements[1:])
        return dataclasses.replace(lens, elements=elements)

    exact = wavefront(with_gap(gap), field=(0.0, 0.05), pupil=pl.aiming.square_grid(16))
    near = wavefront(with_gap(gap + 1e-4), field=(0.0, 0.05), pupil=pl.aiming.square_grid(16))
    assert abs(exact.radius) > 1e5 and abs(near.radius) > 1e5
    np.testing.assert_allclose(exact.opd, near.opd, atol=1e-3)


def test_what_has_no_wavefront_says_so():
    lens = pl.load_lens("double-gauss-100mm-f2")
    found = wavefront(lens, pupil=pl.aiming.hexapolar(2))
    for call, text in (
        (lambda: wavefront(lens.with_model(pl.LensModel.THIN)), "the model of the lens is THIN, which has no"),
        (lambda: wavefront(lens, field=(0.0, 1.2)), "there is no chief ray from the field"),
        (lambda: found.zernike(), "terms is 37, and"),
        (lambda: found.without("coma"), "they must be among piston, tilt, defocus"),
        (lambda: found.zernike(4)["coma"], "'coma' is no term of the fit"),
    ):
        with pytest.raises(InvalidValueError, match=text):
            call()


def strehl_on_the_axis(wave, area):
    """Integral over weights `area` at points r^2 of polynomials in r^2 through path differences and amplitudes."""
    r2 = (wave.pupil**2).sum(axis=1)
    opd, amplitude = (np.polynomial.Polynomial.fit(r2, values, 9) for values in (wave.opd, wave.amplitude))
    light = amplitude(area[0]) * area[1]
    return float(abs(light @ np.exp(2j * math.pi * opd(area[0]))) ** 2 / light.sum() ** 2)


def test_strehl_ratios_are_integrals_over_the_iris_to_1e_4():
    """On the axis over r^2, of a disc and, by triangles, of a hexagon; off it, where the lens clips, by a fine grid."""
    lens = pl.load_lens("double-gauss-100mm-f2")
    nodes, weights = np.polynomial.legendre.leggauss(40)
    u, v = np.meshgrid(0.5 * (nodes + 1), 0.5 * (nodes + 1), indexing="ij")
    # From the centre to a half side: x up to the inradius, y up to x tan 30 deg.
    side = 0.75 * u**2 * (1 + v**2 / 3), np.outer(weights, weights) * u
    areas = {pl.CircularStop(7.0): (0.5 * (nodes + 1), weights)}
    areas[pl.PolygonStop(6, 7.0)] = tuple(part.ravel() for part in side)
    for stop, area in areas.items():
        wave = wavefront(lens.with_stop(stop))
        spread = pl.aberrations.wave_spread(lens.with_stop(stop), shape=(9, 9))
        expected = strehl_on_the_axis(wavefront(lens.with_stop(pl.CircularStop(7.0))), area)
        assert 0.45 < expected < 0.75
        assert (wave.strehl, spread.strehl) == pytest.approx((expected, expected), abs=5e-5)
        assert abs(wave.strehl - expected) < wave.strehl_error + 1e-6 < 1e-4
        assert spread.strehl_error == pytest.approx(wave.strehl_error, abs=1e-9)
        assert spread.image[4, 4] / spread.perfect == pytest.approx(expected, abs=0.005)  # cells at the edge
    where = {"field": (0.0, 0.24)}
    clipped = lens.with_stop(pl.CircularStop(5.0))
    wave, fine = wavefront(clipped, **where), wavefront(clipped, pupil=pl.aiming.square_grid(400), **where)
    assert wave.strehl == pytest.approx(fine.strehl, abs=3e-4) and wave.strehl_error < 1e-4
    assert math.isnan(fine.strehl_error)
    assert wave.without("tilt").strehl == pytest.approx(fine.without("tilt").strehl, abs=1e-3)


@pytest.mark.parametrize(
    "name, semi_diameter, field, noll, fringe",
    [
        ("double-gauss-100mm-f2", 12, (0.05, 0.15), (-0.583978, 0.778641, -0.060373), (1.907234, -1.430425, -0.056920)),
        ("cooke-triplet-50mm-f5", 3, (0.0, 0.2), (0.0, 0.277593, 0.020409), (0.679961, 0.0, 0.0)),
        ("tessar-102mm-f4.5", 8, (-0.1, 0.1), (0.369490, 0.0, 0.066792), (0.0, 0.905062, -0.188915)),
    ],
)
def test_coefficients_are_those_of_prysm(name, semi_diameter, field, noll, fringe):
    """Terms 5 to 7 by prysm 0.21.1: `zernike_nm` of its terms 1 to 36, fitted to these differences by least squares."""
    lens = pl.load_lens(name).with_stop(pl.CircularStop(semi_diameter))
    wave = wavefront(lens, field=field, pupil=pl.aiming.square_grid(64))
    for order, expected in ((ZernikeOrder.NOLL, noll), (ZernikeOrder.FRINGE, fringe)):
        np.testing.assert_allclose(wave.zernike(36, order=order).coefficients[4:7], expected, rtol=0, atol=1e-6)
