"""Internal transmittance of glass: tables, catalogue files, and wrong input."""

import math

import pytest

import plenoptic as pl
from plenoptic.optics.glass.absorption import attenuation
from plenoptic.optics.glass.catalogue import glasses_from_agf

FILE = """NM DENSE 2 517642 1.5168 64.17
CD 1.03961212 6.00069867E-3 0.231792344 2.00179144E-2 1.01046945 103.560653
LD 0.3 2.5
IT 0.400 0.90 10.0
IT 0.400 0.81 20.0
IT 0.500 0.99 10.0
IT 0.450 0.95
IT 0.600 1.5 10.0
NM CLEAR 2 517642 1.5168 64.17
CD 1.03961212 6.00069867E-3 0.231792344 2.00179144E-2 1.01046945 103.560653
LD 0.3 2.5
"""


def test_thicknesses_multiply_and_wavelengths_are_interpolated():
    glass = pl.optics.AbsorbingGlass(pl.glass("SF6"), [400.0, 500.0], [0.5, 0.8], thickness=[5.0, 10.0])
    assert glass.internal_transmittance(400.0, 5.0) == pytest.approx(0.5, rel=1e-15)
    assert glass.internal_transmittance(400.0, 15.0) == pytest.approx(0.125, rel=1e-14)
    between = math.sqrt(0.5**2.0 * 0.8)  # of 10 mm: the mean of the logarithms
    assert glass.internal_transmittance(450.0, 10.0) == pytest.approx(between, rel=1e-14)
    assert glass.internal_transmittance(500.0, 0.0) == 1.0
    assert glass.index(450.0) == pl.glass("SF6").index(450.0) and glass.name == "SF6"
    assert attenuation(pl.optics.Absolute(glass), 400.0) == attenuation(glass, 400.0) == math.log(2.0) / 5.0
    assert attenuation(pl.glass("SF6"), 400.0) == 0.0


def test_lines_of_catalogue_files():
    """The thickest of two rows counts; rows that are no transmittance, and glasses without rows, are as before."""
    catalogue = glasses_from_agf(FILE, "mine.agf")
    dense, clear = catalogue["DENSE"], catalogue["CLEAR"]
    assert not isinstance(clear, pl.optics.AbsorbingGlass) and dense.medium.b == clear.b
    assert dense.internal_transmittance(400.0, 20.0) == pytest.approx(0.81, rel=1e-14)
    assert dense.thickness.tolist() == [20.0, 10.0] and dense.wavelengths.tolist() == [400.0, 500.0]
    assert catalogue.entry("CLEAR").transmission == ()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1.5, [400.0], [0.5]), "medium is 1.5; it must be a medium"),
        ((pl.optics.AIR, [500.0, 400.0], [0.5, 0.5]), "wavelengths must rise"),
        ((pl.optics.AIR, [400.0], [1.5]), "transmittance is from 1.5 to 1.5; it must be in 0 to 1"),
        ((pl.optics.AIR, [400.0], [0.5, 0.6]), r"transmittance has shape \(2,\)"),
        ((pl.optics.AIR, [400.0], [0.5], -1.0), "thickness has -1 mm"),
    ],
)
def test_wrong_tables(arguments, message):
    with pytest.raises(pl.errors.InvalidValueError, match=message):
        pl.optics.AbsorbingGlass(*arguments)


def test_wrong_questions():
    glass = pl.optics.AbsorbingGlass(pl.glass("SF6"), [400.0, 500.0], [0.5, 0.8])
    with pytest.raises(pl.errors.InvalidValueError, match="wavelength 600 nm is outside 400 to 500 nm, where the tran"):
        glass.internal_transmittance(600.0, 1.0)
    with pytest.raises(pl.errors.InvalidValueError, match="thickness is -1 mm; it must be at least 0"):
        glass.internal_transmittance(450.0, -1.0)
