import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plenoptic.errors import InvalidValueError
from plenoptic.optics import abbe_number
from plenoptic.optics.glass.dispersion import COEFFICIENT_COUNTS, DispersionFormula, Formula
from plenoptic.optics.glass.media import C_LINE, D_LINE, F_LINE, ConstantMedium, ModelGlass, Schott, Sellmeier

N_BK7 = Sellmeier((1.03961212, 0.231792344, 1.01046945), (0.00600069867, 0.0200179144, 103.560653), "N-BK7")
BK7 = Schott((2.2718929, -1.0108077e-2, 1.0592509e-2, 2.0816965e-4, -7.6472538e-6, 4.9240991e-7), "BK7")
REAL_GLASSES = {"nd": st.floats(1.43, 2.05), "vd": st.floats(17.0, 95.0)}


@given(**REAL_GLASSES)
def test_model_glass_has_the_index_and_the_dispersion_it_was_made_from(nd, vd):
    glass = ModelGlass(nd, vd)
    f, c = glass.index(F_LINE), glass.index(C_LINE)
    assert glass.index(D_LINE) == nd
    # Differences of numbers below 4, each good to 4 eps, that are themselves above 0.43 / 95 / 3:
    # 16 * 2.2e-16 * 2 / 1.5e-3 = 5e-12.
    assert (nd - 1) / (f - c) == pytest.approx(vd, rel=5e-12)


def test_sellmeier_gives_the_indices_of_the_data_sheet():
    # Schott's data sheet of N-BK7, given to five decimals.
    for line, index in {435.8343: 1.52668, F_LINE: 1.52238, D_LINE: 1.51680, C_LINE: 1.51432, 1014.0: 1.50731}.items():
        assert N_BK7.index(line) == pytest.approx(index, abs=0.5e-5)
    assert abbe_number(N_BK7) == pytest.approx(64.17, abs=0.01) and abbe_number(ConstantMedium(1.5)) == math.inf


def test_a_wavelength_outside_the_range_names_the_range():
    model = ModelGlass(1.5, 60)
    for medium, wavelength in ((model, 359.9), (model, 1100.1), (N_BK7, 364.0), (BK7, 1100), (STATED[1], 333.9)):
        with pytest.raises(InvalidValueError, match=r"wavelength .* nm is outside .* to .* nm"):
            medium.index(wavelength)
    with pytest.raises(InvalidValueError, match="wavelength is nan"):
        N_BK7.index(math.nan)


def test_impossible_media_are_refused():
    for make, text in (
        (lambda: ConstantMedium(0.999), "refractive_index is"),
        (lambda: ModelGlass(1.0, 50), "^nd is"),
        (lambda: ModelGlass(1.5, -30), "^vd is"),
        (lambda: ModelGlass(1.5, 4.9), "vd is 4.9; it must be at least 5"),
        (lambda: Sellmeier((1.0, 0.2), (0.006,)), "c has 1 numbers"),
        (lambda: Sellmeier((1.0, math.nan), (0.006, 0.02)), "b"),
        (lambda: Sellmeier((-5.0,), (0.006,)), "at least 1"),
        (lambda: Sellmeier((1.0,), (0.25,), wavelength_range=(500.0, 2000.0)).index(500.0), "at 500 nm"),  # a resonance
        (lambda: Schott(BK7.coefficients, wavelength_range=(700.0, 400.0)), "wavelength_range"),
        (lambda: Schott(BK7.coefficients, wavelength_range=(400.0,)), "wavelength_range"),
        (lambda: Schott(BK7.coefficients, wavelength_range=(0.0, 700.0)), "wavelength_range"),
        (lambda: DispersionFormula(14, (1.5, 0.0, 0.0)), r"formula is .*; it must be Formula\.SCHOTT"),
        *(
            (lambda f=f, n=n: DispersionFormula(f, (0.5,) * n), f"coefficients has {n} numbers")
            for f, count in COEFFICIENT_COUNTS.items()
            for n in (count - 1, count + 1)
        ),
    ):
        with pytest.raises(InvalidValueError, match=text):
            make()
    assert Sellmeier((1.0,), (0.25,), wavelength_range=(510.0, 2000.0)).index(1000.0) > 1


EXTREME = st.sampled_from(
    [0.0, -0.0, 1e-320, 1e-160, 1e-12, 1.0, 500.0, 1e154, 1e200, 1.7e308, -1e200, math.nan, math.inf]
)


@given(data=st.data(), wavelength=EXTREME)
def test_extreme_coefficients_never_give_an_impossible_index(data, wavelength):
    def drawn(count, numbers=EXTREME):
        return data.draw(st.lists(numbers, min_size=count, max_size=count))

    n, formula = data.draw(st.integers(1, 3)), data.draw(st.sampled_from(Formula))
    b, c, limits, any_numbers = drawn(n), drawn(n), drawn(2), drawn(COEFFICIENT_COUNTS[formula], st.floats())
    for make in (
        lambda: Sellmeier(b, c, "", limits),
        lambda: Schott(drawn(6), "", limits),
        lambda: DispersionFormula(formula, any_numbers, "", limits),
        lambda: ModelGlass(*drawn(2, st.floats())),
    ):
        try:
            index = make().index(wavelength)
        except InvalidValueError:
            continue
        assert 1.0 <= index < math.inf


# Entries of catalogues that come with Zemax, by their source in these: coefficients, range.
STATED = [
    DispersionFormula(formula, coefficients, wavelength_range=limits)
    for formula, coefficients, limits in (
        (
            Formula.HERZBERGER,  # zinc sulphide, data sheet of Morton
            (2.2596285, 3.11097853e-2, 1.0251756e-3, -5.94355286e-4, 4.49796618e-7, -4.12852834e-9),
            (334.0, 2325.0),
        ),
        (Formula.CONRADY, (1.57410327, 1.39786149e-2, 8.3004511e-4), (334.0, 2325.0)),  # BASF5, Laikin
        (
            Formula.SELLMEIER_3,  # calcite, ordinary ray: Handbook of Optics, vol. II
            (0.8559, 3.45744e-3, 0.8391, 1.9881e-2, 9e-4, 3.8809e-2, 0.6845, 49.070025),
            (200.0, 2200.0),
        ),
        (Formula.HANDBOOK_OF_OPTICS_1, (2.7405, 0.0184, 0.0179, 0.0155), (220.0, 1060.0)),  # BBO
        (Formula.SELLMEIER_4, (3.1399, 1.3786, 2.941e-2, 3.861, 225.9009), (220.0, 5000.0)),  # AlN
    )
]


def test_a_formula_gives_the_n_d_and_v_d_that_a_catalogue_states():
    stated = (2.367678, 15.282309), (1.603233, 42.504788), (1.658643, 48.541403), (1.670737, 52.593907)
    for medium, (nd, vd) in zip(STATED, (*stated, (2.154291, 50.733102)), strict=True):
        # To the last of the six decimals. Catalogues differ in the lines by up to 0.0001 nm: slope 5e-7 per 0.0001 nm.
        assert medium.index(D_LINE) == pytest.approx(nd, abs=1.1e-6), medium
        assert (nd - 1) / (medium.index(F_LINE) - medium.index(C_LINE)) == pytest.approx(vd, rel=1e-5), medium


NUMBER = st.floats(0.01, 1.0)
WAVELENGTHS = st.floats(400.0, 1000.0)


def _same(one, other, wavelength):
    # Ten terms of order 1e10 at most would be 1e-6; these have |w^-12| < 6e4 and coefficients below 1, so 10 * 6e4 eps.
    assert one.index(wavelength) == pytest.approx(other.index(wavelength), rel=2e-10)


@given(k=st.tuples(*[NUMBER] * 8), wavelength=WAVELENGTHS)
def test_the_power_series_are_one_another(k, wavelength):
    k = (1.0 + k[0], *k[1:])
    schott, extended = Schott(k[:6]), DispersionFormula(Formula.EXTENDED, k)
    _same(DispersionFormula(Formula.SCHOTT, k[:6]), schott, wavelength)
    _same(DispersionFormula(Formula.EXTENDED, (*k[:6], 0.0, 0.0)), schott, wavelength)
    _same(DispersionFormula(Formula.EXTENDED_2, (*k[:6], 0.0, 0.0)), schott, wavelength)
    _same(DispersionFormula(Formula.EXTENDED_3, (k[0], k[1], 0.0, *k[2:])), extended, wavelength)
    # The two terms that only EXTENDED_2 has.
    w = wavelength * 1e-3
    added = DispersionFormula(Formula.EXTENDED_2, k).index(wavelength) ** 2 - schott.index(wavelength) ** 2
    # n^2 is below 2e3 here, rounded to eps, twice.
    assert added == pytest.approx(k[6] * w**4 + k[7] * w**6, abs=2e-12, rel=1e-9)
    # The term in w^4 of EXTENDED_3.
    fourth = DispersionFormula(Formula.EXTENDED_3, (*k[:2], k[6], *k[2:6], 0.0, 0.0))
    _same(fourth, DispersionFormula(Formula.EXTENDED_2, (*k[:6], k[6], 0.0)), wavelength)


@given(k=st.tuples(*[NUMBER] * 5), wavelength=WAVELENGTHS)
def test_the_resonance_formulas_are_one_another(k, wavelength):
    a, b, c, d, e = k[0] + 1.0, k[1], k[2] * 0.1, k[3], k[4] * 0.1
    handbook = DispersionFormula(Formula.HANDBOOK_OF_OPTICS_2, (a + 1.0, b, c, d * 0.1))
    # b w^2 / (w^2 - c) = b + b c / (w^2 - c)
    _same(DispersionFormula(Formula.HANDBOOK_OF_OPTICS_1, (a + b + 1.0, b * c, c, d * 0.1)), handbook, wavelength)
    fourth = DispersionFormula(Formula.SELLMEIER_4, (a, b, c, d, e))
    _same(DispersionFormula(Formula.SELLMEIER_1, (b, c, d, e, a - 1.0, 0.0)), fourth, wavelength)
    _same(DispersionFormula(Formula.SELLMEIER_3, (b, c, d, e, a - 1.0, 0.0, 0.0, 0.0)), fourth, wavelength)
    five = (b, c, d, e, 0.0, 0.0, 0.0, 0.0, a - 1.0, 0.0)
    _same(DispersionFormula(Formula.SELLMEIER_5, five), fourth, wavelength)
    _same(Sellmeier((b, d, a - 1.0), (c, e, 0.0)), fourth, wavelength)
    # d e / (w^2 - e) = d w^2 / (w^2 - e) - d
    second = DispersionFormula(Formula.SELLMEIER_2, (a + d - 1.0, b, math.sqrt(c), d * e, math.sqrt(e)))
    _same(second, DispersionFormula(Formula.SELLMEIER_4, (a, b, c, d, e)), wavelength)
