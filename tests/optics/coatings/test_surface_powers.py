"""Thin films: Fresnel's formulas, the quarter-wave film, energy, reciprocity, opaque films and total reflection."""

import decimal
import math

import numpy as np
import pytest

import plenoptic as pl

ANGLES = np.radians([0.0, 1.0, 20.0, 45.0, 70.0, 85.0, 89.0, 89.99])
COSINES = np.cos(ANGLES)
MGF2, TITANIA = pl.ConstantMedium(1.38), pl.ConstantMedium(2.35)
CHROMIUM = pl.optics.FilmMaterial(3.18, 3.33)
STACK = pl.optics.Coating([(MGF2, 92.0), (TITANIA, 117.0), (MGF2, 61.0), (TITANIA, 20.0)])
METALLIC = pl.optics.Coating([(MGF2, 92.0), (CHROMIUM, 8.0), (TITANIA, 50.0)])
WAVELENGTHS = (420.0, 550.0, 690.0)
EVERY = [(coating, nm) for coating in (None, pl.optics.SingleLayer(), STACK) for nm in WAVELENGTHS]


def fresnel(n, angle):
    """Reflectances s and p from air to glass, as tangents and sines of angles (Born & Wolf, 1.5.2, eq. 21)."""
    refracted = math.asin(math.sin(angle) / n)
    less, more = angle - refracted, angle + refracted
    return (math.sin(less) / math.sin(more)) ** 2, (math.tan(less) / math.tan(more)) ** 2


def test_bare_glass_reflects_as_fresnel_says():
    powers = pl.optics.surface_powers(None, 1.0, 1.6, COSINES[1:], 550.0)
    expected = np.array([fresnel(1.6, angle) for angle in ANGLES[1:].tolist()]).T
    # The sines of angles of 1 degree lose two digits.
    np.testing.assert_allclose(powers.reflectance_s, expected[0], rtol=1e-12)
    np.testing.assert_allclose(powers.reflectance_p, expected[1], rtol=1e-12)
    normal = pl.optics.surface_powers(None, 1.0, 1.6, 1.0, 550.0)
    assert normal.reflectance == pytest.approx((0.6 / 2.6) ** 2, rel=1e-14)
    no_surface = pl.optics.surface_powers(None, 1.5, 1.5, [*COSINES, 0.0], 550.0)
    np.testing.assert_allclose(no_surface.transmittance, 1.0, rtol=1e-14)


def test_quarter_and_half_wave_films():
    """R = ((n0 ns - n1^2) / (n0 ns + n1^2))^2 for a quarter of a wavelength, and that of bare glass for a half."""
    for n in (1.5, 1.8):
        at_design = pl.optics.surface_powers(pl.optics.SingleLayer(MGF2, 550.0), 1.0, n, 1.0, 550.0)
        assert at_design.reflectance == pytest.approx(((n - 1.38**2) / (n + 1.38**2)) ** 2, rel=1e-12)
        half = pl.optics.surface_powers(pl.optics.SingleLayer(MGF2, 1100.0), 1.0, n, 1.0, 550.0)
        assert half.reflectance == pytest.approx(((n - 1) / (n + 1)) ** 2, rel=1e-12)


def test_films_of_the_glass_or_of_no_phase_change_nothing():
    glass = pl.optics.Coating([(pl.ConstantMedium(1.6), 77.0)])
    for n_from, n_to in ((1.0, 1.6), (1.6, 1.0)):
        bare = pl.optics.surface_powers(None, n_from, n_to, COSINES, 550.0)
        coated = pl.optics.surface_powers(glass, n_from, n_to, COSINES, 550.0)
        np.testing.assert_allclose(coated.reflectance, bare.reflectance, atol=1e-12)
        np.testing.assert_allclose(coated.transmittance, bare.transmittance, atol=1e-12)


@pytest.mark.parametrize(("coating", "nm"), EVERY)
def test_energy_and_both_directions(coating, nm):
    """R + T = 1 without absorption; T is the same backwards, and so is R."""
    ahead = pl.optics.surface_powers(coating, 1.0, 1.7, COSINES, nm)
    inside = np.sqrt(1.0 - (1.0 - COSINES) * (1.0 + COSINES) / 1.7**2)
    back = pl.optics.surface_powers(coating, 1.7, 1.0, inside, nm)
    for powers in (ahead, back):
        assert np.abs(powers.absorptance_s).max() < 1e-12 and np.abs(powers.absorptance_p).max() < 1e-12
    # The cosine outside is the root of a difference: near 90 degrees 1e-16 becomes 1e-16 / cos^2.
    for name in ("transmittance_s", "transmittance_p", "reflectance_s", "reflectance_p"):
        difference = np.abs(getattr(ahead, name) - getattr(back, name))
        assert (difference * COSINES**2 < 1e-14).all()


def test_films_that_absorb():
    """Transmittances agree in both directions, reflectances do not, and what is missing is above 0."""
    ahead = pl.optics.surface_powers(METALLIC, 1.0, 1.7, COSINES[:-1], 550.0)
    inside = np.sqrt(1.0 - (1.0 - COSINES[:-1]) * (1.0 + COSINES[:-1]) / 1.7**2)
    back = pl.optics.surface_powers(METALLIC, 1.7, 1.0, inside, 550.0)
    np.testing.assert_allclose(ahead.transmittance, back.transmittance, rtol=1e-11)
    assert np.abs(ahead.reflectance - back.reflectance).max() > 0.1
    assert ahead.absorptance.min() > 0.001 and ahead.absorptance[0] > 0.1


def test_thick_metal_is_opaque_and_reflects_as_its_surface():
    """A millimetre of chromium at any angle: no overflow; R of normal incidence is |(1 - n) / (1 + n)|^2."""
    thick = pl.optics.Coating([(CHROMIUM, 1e5)])
    powers = pl.optics.surface_powers(thick, 1.0, 1.5, COSINES, 550.0)
    n = complex(3.18, 3.33)
    assert powers.reflectance[0] == pytest.approx(abs((1 - n) / (1 + n)) ** 2, rel=1e-13)
    assert powers.transmittance.max() == 0.0 and np.isfinite(powers.reflectance).all()
    # A film of k absorbs exp(-4 pi k d / lambda) once light is inside it.
    thin, thicker = (
        pl.optics.surface_powers(pl.optics.Coating([(CHROMIUM, d)]), 1.0, 1.5, 1.0, 550.0).transmittance.item()
        for d in (400.0, 500.0)
    )
    assert thicker / thin == pytest.approx(math.exp(-4 * math.pi * 3.33 * 100.0 / 550.0), rel=1e-10)


def test_total_reflection():
    cosines = np.cos(np.radians([42.0, 60.0, 89.0]))  # the critical angle of 1.5 is 41.8 degrees
    for coating in (None, STACK, pl.optics.Reflectance(0.005)):
        powers = pl.optics.surface_powers(coating, 1.5, 1.0, cosines, 550.0)
        np.testing.assert_allclose(powers.reflectance, 1.0, rtol=1e-13)
        assert (powers.transmittance == 0.0).all()


def test_grazing_light_and_critical_angles_are_limits():
    """R = x / (1 + x) for a film between media of one index (Born & Wolf, 1.6.4), at its critical angle and beyond."""
    phase = 2.0 * math.pi * 200.0 / 550.0
    film = pl.optics.Coating([(pl.optics.FilmMaterial(1.0), 200.0)])
    powers = pl.optics.surface_powers(film, 1.25, [1.25, 1.5], 0.6, 550.0)  # sin = 0.8, the critical angle of 1.25
    for polarisation, first, last in (("s", 0.75, math.sqrt(1.25)), ("p", 0.48, math.sqrt(1.25) / 2.25)):
        # The matrix is ((1, -i phase), (0, 1)) at the critical angle of a film of index 1.
        for i, behind in enumerate((first, last)):
            field = complex(first, -phase * first * behind)
            expected = abs((field - behind) / (field + behind)) ** 2
            assert getattr(powers, f"reflectance_{polarisation}")[i] == pytest.approx(expected, rel=1e-12)
            assert getattr(powers, f"transmittance_{polarisation}")[i] == pytest.approx(1.0 - expected, rel=1e-12)
    thin = pl.optics.Coating([(pl.optics.FilmMaterial(0.52), 1e-9)])
    decay, first = math.sqrt(1.5**2 - 0.52**2), 1.5e-9
    x = ((first**2 + decay**2) / (2 * first * decay) * math.sinh(2 * math.pi * 1e-9 / 550.0 * decay)) ** 2
    assert pl.optics.surface_powers(thin, 1.5, 1.5, 1e-9, 550.0).reflectance_s == pytest.approx(x / (1 + x), rel=1e-12)


def test_indices_that_agree_to_rounding():
    """R = ((n cos - q) / (n cos + q))^2 of s by decimal numbers; no light is reflected where the index is the same."""
    none = pl.optics.surface_powers(None, 1.5, 1.5, [0.0, 1e-150, 1e-9, 1e-3], 550.0)
    assert none.reflectance_p.tolist() == none.reflectance_s.tolist() == [0.0] * 4
    np.testing.assert_allclose(none.transmittance, 1.0, rtol=1e-15)
    with decimal.localcontext(prec=50):
        cos, n, more = (decimal.Decimal(number) for number in (1e-9, 1.5, 1.5 + 1e-14))
        q = (more**2 - n**2 + (n * cos) ** 2).sqrt()
        expected = float(((n * cos - q) / (n * cos + q)) ** 2)
    powers = pl.optics.surface_powers(None, 1.5, 1.5 + 1e-14, 1e-9, 550.0)
    assert powers.reflectance_s == pytest.approx(expected, rel=1e-12)


def test_a_thousand_pairs_of_films_reflect_all_light():
    """Fields of 2^1000 overflow unless they are scaled."""
    stack = pl.optics.Coating([(pl.ConstantMedium(4.0), 550.0 / 16.0), (pl.ConstantMedium(2.0), 550.0 / 8.0)] * 1500)
    powers = pl.optics.surface_powers(stack, 1.0, 1.5, [0.5, 1.0], 550.0)
    np.testing.assert_allclose(powers.reflectance, 1.0, rtol=1e-12)
    assert powers.transmittance.max() == 0.0


def test_tables_of_reflectance():
    table = pl.optics.Reflectance(
        [[0.01, 0.03], [0.02, 0.06]], wavelengths=[500.0, 600.0], angles=[0.0, math.radians(60.0)]
    )
    powers = pl.optics.surface_powers(table, 1.0, 1.5, np.cos(np.radians([0.0, 30.0, 80.0])), 550.0)
    np.testing.assert_allclose(powers.reflectance, [0.015, 0.015 + 0.06 * (1.0 - math.cos(math.radians(30.0))), 0.045])
    inside = math.sqrt(1.0 - (0.5 / 1.5) ** 2)
    assert pl.optics.surface_powers(table, 1.5, 1.0, inside, 550.0).reflectance == pytest.approx(powers.reflectance[1])
    assert pl.optics.Reflectance(0.01) == pl.optics.Reflectance([[0.01]])
    by_angle = pl.optics.Reflectance([0.01, 0.05], angles=[0.0, 1.0])
    assert pl.optics.surface_powers(by_angle, 1.0, 1.5, (1 + math.cos(1)) / 2, 400.0).reflectance == pytest.approx(0.03)
    by_wave = pl.optics.Reflectance([0.01, 0.05], [400.0, 600.0])
    assert pl.optics.surface_powers(by_wave, 1.0, 1.5, 1.0, 500.0).reflectance == pytest.approx(0.03)


def test_materials_of_films_disperse():
    material = pl.optics.FilmMaterial([1.4, 1.5], [0.0, 0.2], [500.0, 600.0])
    assert material.complex_index(575.0) == pytest.approx(1.475 + 0.15j)
    wavelengths = np.array([[500.0], [600.0]])
    powers = pl.optics.surface_powers(pl.optics.Coating([(material, 80.0)]), 1.0, 1.5, [0.5, 1.0], wavelengths)
    for i, index in enumerate((1.4, 1.5 + 0.2j)):
        film = pl.optics.FilmMaterial(index.real, index.imag)
        alone = pl.optics.surface_powers(pl.optics.Coating([(film, 80.0)]), 1.0, 1.5, [0.5, 1.0], wavelengths[i, 0])
        assert powers.transmittance[i].tolist() == alone.transmittance.tolist()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pl.optics.Coating([(MGF2, -10.0)]), "thickness of layer 0 is -10 nm; it must be above 0"),
        (lambda: pl.optics.Coating([(MGF2, 1e6)]), "at most 100000"),
        (lambda: pl.optics.Coating([MGF2]), r"layer 0 is .*; it must be \(medium, thickness in nm\)"),
        (lambda: pl.optics.Coating([(1.38, 99.6)]), "the material of layer 0 is 1.38; it must be a medium"),
        (lambda: pl.optics.Coating(MGF2), "layers is a ConstantMedium; give a sequence"),
        (lambda: pl.optics.SingleLayer(1.38), "medium is 1.38; it must be a medium"),
        (lambda: pl.optics.SingleLayer(wavelength=0.55), "wavelengths are in nanometres"),
        (lambda: pl.optics.FilmMaterial(1.5, -0.1), "extinction has -0.1; it must be finite and at least 0"),
        (lambda: pl.optics.FilmMaterial(0.0), "index has 0; it must be finite"),
        (lambda: pl.optics.FilmMaterial([1.5, 1.6], 0.0, [600.0, 500.0]), "wavelengths must rise"),
        (lambda: pl.optics.FilmMaterial([1.5], 0.0, [600.0]).complex_index(550.0), "wavelength 550 nm is outside 600"),
        (lambda: pl.optics.Reflectance(1.5), "reflectance is from 1.5 to 1.5; it must be from 0 to 1"),
        (lambda: pl.optics.Reflectance([0.1, 0.2]), r"reflectance has shape \(2,.*; it must have shape \(1, 1\)"),
        (lambda: pl.optics.Reflectance([0.1, 0.2], angles=[0.0, 45.0]), "give radians"),
        (
            lambda: pl.optics.surface_powers(pl.optics.Reflectance([0.1, 0.2], [500.0, 600.0]), 1.0, 1.5, 1.0, 700.0),
            "wavelength 700 nm is outside 500 to 600 nm, where the reflectance is defined",
        ),
        (lambda: pl.optics.surface_powers(None, 1.0, 1.5, 1.5, 550.0), "cosine must be from 0 to 1"),
        (lambda: pl.optics.surface_powers(None, 1.0, 0.2, 1.0, 550.0), "metals are films only"),
        (lambda: pl.optics.surface_powers("MgF2", 1.0, 1.5, 1.0, 550.0), "coating is 'MgF2'; it must be"),
    ],
)
def test_wrong_input_is_answered_with_a_sentence(call, message):
    with pytest.raises(pl.errors.InvalidValueError, match=message):
        call()
