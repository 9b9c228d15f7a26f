import math
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plenoptic.errors import InvalidValueError
from plenoptic.optics.media import (
    AIR,
    C_LINE,
    D_LINE,
    F_LINE,
    G_LINE,
    MODEL_GLASS_RANGE,
    ConstantMedium,
    Medium,
    ModelGlass,
    Schott,
    Sellmeier,
)

N_BK7 = Sellmeier((1.03961212, 0.231792344, 1.01046945), (0.00600069867, 0.0200179144, 103.560653), "N-BK7")
BK7 = Schott((2.2718929, -1.0108077e-2, 1.0592509e-2, 2.0816965e-4, -7.6472538e-6, 4.9240991e-7), "BK7")
REAL_GLASSES = {"nd": st.floats(1.43, 2.05), "vd": st.floats(17.0, 95.0)}


@given(**REAL_GLASSES)
def test_model_glass_has_the_index_and_the_dispersion_it_was_made_from(nd: float, vd: float) -> None:
    glass = ModelGlass(nd, vd)
    f, c, g = glass.index(F_LINE), glass.index(C_LINE), glass.index(G_LINE)
    assert glass.index(D_LINE) == nd
    # Differences of numbers below 4, each good to 4 eps, that are themselves above 0.43 / 95 / 3:
    # 16 * 2.2e-16 * 2 / 1.5e-3 = 5e-12.
    assert (nd - 1) / (f - c) == pytest.approx(vd, rel=5e-12)
    assert (g - f) / (f - c) == pytest.approx(0.6438 - 0.001682 * vd, rel=5e-12)


@given(**REAL_GLASSES, pair=st.tuples(st.floats(*MODEL_GLASS_RANGE), st.floats(*MODEL_GLASS_RANGE)))
def test_the_index_of_a_model_glass_falls_with_the_wavelength(nd: float, vd: float, pair: tuple[float, float]) -> None:
    glass = ModelGlass(nd, vd)
    # Equal up to rounding for wavelengths that are almost equal.
    assert glass.index(min(pair)) >= glass.index(max(pair)) - 1e-14


def test_sellmeier_gives_the_indices_of_the_data_sheet() -> None:
    # Schott's data sheet of N-BK7, given to five decimals.
    for line, index in {G_LINE: 1.52668, F_LINE: 1.52238, D_LINE: 1.51680, C_LINE: 1.51432, 1014.0: 1.50731}.items():
        assert N_BK7.index(line) == pytest.approx(index, abs=0.5e-5)


@pytest.mark.parametrize("wavelength", [G_LINE, F_LINE, D_LINE, C_LINE, 852.1])
def test_two_formulas_of_one_glass_agree(wavelength: float) -> None:
    # Fits to different melts; the catalogues state both to 1e-5.
    assert BK7.index(wavelength) == pytest.approx(N_BK7.index(wavelength), abs=2e-5)


@pytest.mark.parametrize("wavelength", range(400, 801, 50))
def test_a_model_glass_follows_the_real_one(wavelength: int) -> None:
    # BK7 lies close to the normal line: within a unit of the fourth decimal in the visible.
    assert ModelGlass(1.51680, 64.17).index(wavelength) == pytest.approx(N_BK7.index(wavelength), abs=3e-4)


def test_a_constant_medium_is_constant() -> None:
    assert ConstantMedium(1.67).index(300.0) == ConstantMedium(1.67).index(1e6) == 1.67
    assert ConstantMedium(1) == AIR
    assert AIR.index(587.6) == 1.0


@pytest.mark.parametrize("medium", [AIR, ModelGlass(1.67, 47.1, "BAF10"), N_BK7, BK7])
def test_media_are_values(medium: Medium) -> None:
    assert isinstance(medium, Medium)
    assert pickle.loads(pickle.dumps(medium)) == medium
    assert hash(pickle.loads(pickle.dumps(medium))) == hash(medium)


def test_lists_of_coefficients_make_the_same_glass() -> None:
    assert Sellmeier(list(N_BK7.b), list(N_BK7.c), "N-BK7", [365, 2325]) == N_BK7  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("medium", "wavelength"), [(ModelGlass(1.5, 60), 359.9), (ModelGlass(1.5, 60), 1100.1), (N_BK7, 364.0), (BK7, 1100)]
)
def test_a_wavelength_outside_the_range_names_the_range(medium: Medium, wavelength: float) -> None:
    with pytest.raises(InvalidValueError, match=r"wavelength .* nm is outside .* to .* nm"):
        medium.index(wavelength)


@pytest.mark.parametrize("wavelength", [math.nan, math.inf, -587.6, 0.0])
def test_a_wavelength_that_is_none_is_refused(wavelength: float) -> None:
    with pytest.raises(InvalidValueError, match="wavelength"):
        N_BK7.index(wavelength)


@pytest.mark.parametrize("index", [0.999, 0.0, -1.5, math.nan, math.inf, "glass", None])
def test_an_impossible_index_is_refused(index: float) -> None:
    with pytest.raises(InvalidValueError, match="refractive_index is"):
        ConstantMedium(index)


@pytest.mark.parametrize(("nd", "vd"), [(1.0, 50), (0.9, 50), (math.nan, 50), (1.5, 0), (1.5, -30), (1.5, math.inf)])
def test_an_impossible_model_glass_is_refused(nd: float, vd: float) -> None:
    with pytest.raises(InvalidValueError, match=r"^(nd|vd) is"):
        ModelGlass(nd, vd)


def test_index_and_abbe_number_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"nd is 64\.17; .*give the index first"):
        ModelGlass(64.17, 1.5168)
    with pytest.raises(InvalidValueError, match="vd is 4.9; it must be at least 5"):
        ModelGlass(1.5, 4.9)


@given(nd=st.floats(), vd=st.floats(), wavelength=st.floats())
def test_a_model_glass_never_answers_with_an_impossible_index(nd: float, vd: float, wavelength: float) -> None:
    try:
        index = ModelGlass(nd, vd).index(wavelength)
    except InvalidValueError:
        return
    assert 1.0 <= index < math.inf


@pytest.mark.parametrize(
    ("b", "c"),
    [((), ()), ((1.0, 0.2), (0.006,)), ((1.0, math.nan), (0.006, 0.02)), ((-5.0,), (0.006,)), (1.0, 0.006)],
)
def test_impossible_sellmeier_coefficients_are_refused(b: tuple[float, ...], c: tuple[float, ...]) -> None:
    with pytest.raises(InvalidValueError):
        Sellmeier(b, c)


def test_a_resonance_inside_the_range_is_an_error_and_not_a_number() -> None:
    glass = Sellmeier((1.0,), (0.25,), wavelength_range=(510.0, 2000.0))
    assert glass.index(1000.0) > 1
    with pytest.raises(InvalidValueError, match="at 500 nm"):
        Sellmeier((1.0,), (0.25,), wavelength_range=(500.0, 2000.0))


@pytest.mark.parametrize("limits", [(700.0, 400.0), (400.0,), (0.0, 700.0), 500.0])
def test_an_impossible_range_is_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(InvalidValueError, match="wavelength_range"):
        Schott(BK7.coefficients, wavelength_range=limits)
