import itertools
import math

import pytest

from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.air import Absolute, Air, AirFormula
from plenoptic.optics.glass.media import AIR, Sellmeier

N_BK7 = Sellmeier((1.03961212, 0.231792344, 1.01046945), (0.00600069867, 0.0200179144, 103.560653), "N-BK7")

# Of the NIST Engineering Metrology Toolbox (J. A. Stone and J. H. Zimmerman), 450 ppm of carbon dioxide: deg C, kPa,
# humidity, nm, index by Ciddor, index by the modified Edlen equation. It prints 9 decimals.
NIST = [
    (20, 101.325, 0.00, 633, 1.000271800, 1.000271799), (20, 60.0, 0.00, 633, 1.000160924, 1.000160920),
    (20, 120.0, 0.00, 633, 1.000321916, 1.000321918), (50, 100.0, 0.00, 633, 1.000243285, 1.000243270),
    (5, 100.0, 0.00, 633, 1.000282756, 1.000282750), (-40, 100.0, 0.00, 633, 1.000337580, 1.000337471),
    (50, 120.0, 1.00, 633, 1.000287924, 1.000287864), (40, 120.0, 0.75, 633, 1.000299418, 1.000299406),
    (20, 100.0, 1.00, 633, 1.000267394, 1.000267394), (40, 110.0, 1.00, 1700, 1.000270247, 1.000270237),
    (20, 101.325, 0.00, 1700, 1.000268479, 1.000268483), (40, 110.0, 1.00, 300, 1.000289000, 1.000288922),
    (20, 101.325, 0.00, 300, 1.000286581, 1.000286579), (-40, 120.0, 0.00, 300, 1.000427233, 1.000427072),
]  # fmt: skip


def test_both_formulas_give_the_indices_of_the_metrology_toolbox():
    # Half a unit of the last decimal, and as much for the toolbox's other formula of the saturation pressure.
    for celsius, kilopascal, humidity, wavelength, *indices in NIST:
        for formula, index in zip((AirFormula.CIDDOR, AirFormula.EDLEN), indices, strict=True):
            air = Air(celsius, kilopascal, humidity=humidity, formula=formula)
            assert air.index(wavelength) == pytest.approx(index, abs=1e-9, rel=0), air
    # Ciddor 1996, table 1: 10^8 (n - 1) of dry air at 633 nm, to a tenth.
    table = [(20, 80, 21458.0), (20, 100, 26824.4), (20, 120, 32191.6), (10, 100, 27774.7), (30, 100, 25937.2)]
    for celsius, kilopascal, refractivity in table:
        computed = (Air(celsius, kilopascal).index(633.0) - 1) * 1e8
        assert computed == pytest.approx(refractivity, abs=0.051), (celsius, kilopascal)


def test_humid_air_is_thinner_and_carbon_dioxide_thickens_it():
    dry = Air(20.0).index(550.0)
    assert Air(20.0, humidity=1.0).index(550.0) < dry
    assert Air(20.0, co2=2000.0).index(550.0) > dry > Air(20.0, co2=0.0).index(550.0)


def test_what_the_formulas_do_not_say_is_refused():
    for formula, wavelength in itertools.product(AirFormula, (299.9, 1700.1, math.nan)):
        with pytest.raises(InvalidValueError, match="wavelength"):
            Air(formula=formula).index(wavelength)
    wrong = {"temperature": (-40.1, 100.1), "pressure": (9.9, 140.1), "humidity": (-0.01, 1.01), "co2": (-1.0, 2000.1)}
    for name, number in ((name, number) for name, numbers in wrong.items() for number in numbers):
        with pytest.raises(InvalidValueError, match=rf"^{name} is"):
            Air(**{name: number})
    with pytest.raises(InvalidValueError, match="co2 is 400 ppm"):
        Air(co2=400.0, formula=AirFormula.EDLEN)
    with pytest.raises(InvalidValueError, match="vapour pressure"):
        Air(100.0, 50.0, humidity=1.0)


def test_an_absolute_index_is_relative_to_vacuum():
    # Snell's law sees the ratio only: in that air the glass refracts as the catalogue says.
    for wavelength, air in itertools.product((365.0, 587.6, 1700.0), (Air(-40.0), Air(20.0), Air(100.0))):
        absolute = Absolute(N_BK7, air).index(wavelength)
        assert absolute / air.index(wavelength) == pytest.approx(N_BK7.index(wavelength), rel=3e-16), (wavelength, air)
        assert Absolute(AIR, air).index(wavelength) == air.index(wavelength) > 1, (wavelength, air)
    # Schott, TIE-29: n_abs = n_rel n_air, and the air at 20 deg C and 0.101325 MPa has 1.00027 in the yellow.
    assert Absolute(N_BK7).index(587.5618) - N_BK7.index(587.5618) == pytest.approx(1.5168 * 2.72e-4, rel=2e-3)


def test_an_absolute_medium_is_a_relative_one_in_real_air():
    for wavelength, name in ((330.0, "N-BK7"), (2000.0, "air")):
        with pytest.raises(InvalidValueError, match=name):
            Absolute(N_BK7).index(wavelength)
    for medium in (Air(), Absolute(N_BK7), 1.5):
        with pytest.raises(InvalidValueError, match="medium"):
            Absolute(medium)
    with pytest.raises(InvalidValueError, match="air is"):
        Absolute(N_BK7, AIR)
