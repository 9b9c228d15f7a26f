import math
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.air import AIR_WAVELENGTH_RANGE, Absolute, Air, AirFormula
from plenoptic.optics.glass.media import AIR, VACUUM, ConstantMedium, Medium, Sellmeier

N_BK7 = Sellmeier((1.03961212, 0.231792344, 1.01046945), (0.00600069867, 0.0200179144, 103.560653), "N-BK7")

# Of the NIST Engineering Metrology Toolbox (J. A. Stone and J. H. Zimmerman), 450 ppm of carbon dioxide: deg C, kPa,
# humidity, nm, index by Ciddor, index by the modified Edlen equation. It prints 9 decimals.
NIST = [
    (20, 101.325, 0.00, 633, 1.000271800, 1.000271799),
    (20, 60.0, 0.00, 633, 1.000160924, 1.000160920),
    (20, 120.0, 0.00, 633, 1.000321916, 1.000321918),
    (50, 100.0, 0.00, 633, 1.000243285, 1.000243270),
    (5, 100.0, 0.00, 633, 1.000282756, 1.000282750),
    (-40, 100.0, 0.00, 633, 1.000337580, 1.000337471),
    (50, 120.0, 1.00, 633, 1.000287924, 1.000287864),
    (40, 120.0, 0.75, 633, 1.000299418, 1.000299406),
    (20, 100.0, 1.00, 633, 1.000267394, 1.000267394),
    (40, 110.0, 1.00, 1700, 1.000270247, 1.000270237),
    (20, 101.325, 0.00, 1700, 1.000268479, 1.000268483),
    (40, 110.0, 1.00, 300, 1.000289000, 1.000288922),
    (20, 101.325, 0.00, 300, 1.000286581, 1.000286579),
    (-40, 120.0, 0.00, 300, 1.000427233, 1.000427072),
]


@pytest.mark.parametrize(("celsius", "kilopascal", "humidity", "wavelength", "ciddor", "edlen"), NIST)
def test_both_formulas_give_the_indices_of_the_metrology_toolbox(
    celsius: float, kilopascal: float, humidity: float, wavelength: float, ciddor: float, edlen: float
) -> None:
    # Half a unit of the last decimal, and as much for the toolbox's other formula of the saturation pressure.
    air = Air(celsius, kilopascal, humidity=humidity)
    assert air.index(wavelength) == pytest.approx(ciddor, abs=1e-9, rel=0)
    air = Air(celsius, kilopascal, humidity=humidity, formula=AirFormula.EDLEN)
    assert air.index(wavelength) == pytest.approx(edlen, abs=1e-9, rel=0)


@pytest.mark.parametrize(
    ("celsius", "pascal", "refractivity"),
    [(20, 8e4, 21458.0), (20, 1e5, 26824.4), (20, 1.2e5, 32191.6), (10, 1e5, 27774.7), (30, 1e5, 25937.2)],
)
def test_ciddor_gives_his_own_table(celsius: float, pascal: float, refractivity: float) -> None:
    # Ciddor 1996, table 1: 10^8 (n - 1) of dry air at 633 nm, to a tenth.
    assert (Air(celsius, pascal * 1e-3).index(633.0) - 1) * 1e8 == pytest.approx(refractivity, abs=0.051)


STATES = {
    "temperature": st.floats(0.0, 40.0),
    "pressure": st.floats(60.0, 120.0),
    "wavelength": st.floats(*AIR_WAVELENGTH_RANGE),
    "formula": st.sampled_from(AirFormula),
}


@given(**STATES)
def test_the_refractivity_follows_the_gas_law(
    temperature: float, pressure: float, wavelength: float, formula: AirFormula
) -> None:
    here = Air(temperature, pressure, formula=formula).index(wavelength) - 1
    there = Air(15.0, 101.325, formula=formula).index(wavelength) - 1
    # Compressibility: second virial coefficient p/T * 1.6e-6 K/Pa, below 1e-3 of the density.
    assert here / there == pytest.approx(pressure / 101.325 * 288.15 / (temperature + 273.15), rel=1e-3)


@given(**STATES, other=st.floats(*AIR_WAVELENGTH_RANGE))
def test_dispersion_is_normal(
    temperature: float, pressure: float, wavelength: float, formula: AirFormula, other: float
) -> None:
    air = Air(temperature, pressure, formula=formula)
    # Equal up to rounding of 1 + n for wavelengths that are almost equal.
    assert air.index(min(wavelength, other)) >= air.index(max(wavelength, other)) - 4.5e-16


def test_humid_air_is_thinner_and_carbon_dioxide_thickens_it() -> None:
    dry = Air(20.0).index(550.0)
    assert Air(20.0, humidity=1.0).index(550.0) < dry
    assert Air(20.0, co2=2000.0).index(550.0) > dry > Air(20.0, co2=0.0).index(550.0)


def test_the_formulas_agree_in_a_laboratory() -> None:
    for humidity in (0.0, 0.3, 0.6):
        one, other = (Air(21.0, 100.0, humidity=humidity, formula=formula).index(589.0) for formula in AirFormula)
        assert abs(one - other) < 1e-8


@pytest.mark.parametrize("formula", AirFormula)
@pytest.mark.parametrize("wavelength", [299.9, 1700.1, 0.0, -550.0, math.nan, math.inf])
def test_a_wavelength_outside_the_range_is_refused(formula: AirFormula, wavelength: float) -> None:
    with pytest.raises(InvalidValueError, match="wavelength"):
        Air(formula=formula).index(wavelength)


@pytest.mark.parametrize(
    ("name", "number"),
    [
        *(("temperature", number) for number in (-40.1, 100.1, math.nan, "hot", None)),
        *(("pressure", number) for number in (9.9, 140.1, 101325.0, math.inf)),
        *(("humidity", number) for number in (-0.01, 1.01, 50.0)),
        *(("co2", number) for number in (-1.0, 2000.1)),
        *(("formula", number) for number in (2, "edlen", None)),
    ],
)
def test_air_outside_the_formulas_is_refused(name: str, number: float) -> None:
    with pytest.raises(InvalidValueError, match=rf"^{name} is"):
        Air(**{name: number})  # type: ignore[arg-type]


def test_what_the_formulas_do_not_say_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="co2 is 400 ppm"):
        Air(co2=400.0, formula=AirFormula.EDLEN)
    with pytest.raises(InvalidValueError, match="vapour pressure"):
        Air(100.0, 50.0, humidity=1.0)


@pytest.mark.parametrize(
    "medium",
    [Air(), Air(25.0, 95.0, humidity=0.4, formula=AirFormula.CIDDOR), Absolute(N_BK7), Absolute(N_BK7, Air(22))],
)
def test_they_are_values(medium: Medium) -> None:
    assert isinstance(medium, Medium)
    assert pickle.loads(pickle.dumps(medium)) == medium
    assert hash(pickle.loads(pickle.dumps(medium))) == hash(medium)
    assert eval(repr(medium).replace("<AirFormula.CIDDOR: 0>", "0")) == medium


def test_vacuum_has_the_index_1() -> None:
    assert VACUUM == AIR == ConstantMedium(1.0)
    assert VACUUM.index(550.0) == 1.0


@given(wavelength=st.floats(365.0, 1700.0), temperature=st.floats(-40.0, 100.0))
def test_an_absolute_index_is_relative_to_vacuum(wavelength: float, temperature: float) -> None:
    air = Air(temperature)
    absolute = Absolute(N_BK7, air).index(wavelength)
    # Snell's law sees the ratio only: in that air the glass refracts as the catalogue says.
    assert absolute / air.index(wavelength) == pytest.approx(N_BK7.index(wavelength), rel=3e-16)
    assert absolute > N_BK7.index(wavelength)
    assert Absolute(AIR, air).index(wavelength) == air.index(wavelength)


def test_the_absolute_index_of_glass_is_that_of_the_data_sheet() -> None:
    # Schott, TIE-29: n_abs = n_rel n_air, and the air at 20 deg C and 0.101325 MPa has 1.00027 in the yellow.
    assert Absolute(N_BK7).index(587.5618) - N_BK7.index(587.5618) == pytest.approx(1.5168 * 2.72e-4, rel=2e-3)


def test_a_wavelength_must_suit_both() -> None:
    with pytest.raises(InvalidValueError, match="N-BK7"):
        Absolute(N_BK7).index(330.0)
    with pytest.raises(InvalidValueError, match="air"):
        Absolute(N_BK7).index(2000.0)


@pytest.mark.parametrize("medium", [Air(), Absolute(N_BK7), 1.5, None])
def test_only_relative_media_become_absolute(medium: Medium) -> None:
    with pytest.raises(InvalidValueError, match="medium"):
        Absolute(medium)


def test_the_air_of_an_absolute_medium_is_real_air() -> None:
    with pytest.raises(InvalidValueError, match="air is"):
        Absolute(N_BK7, AIR)  # type: ignore[arg-type]
