"""Pixels; sensor models: derived values and errors; radiometry."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.core.color import sensitivities
from plenoptic.core.color.spectra import Sensitivity
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.color_filter import BayerPattern, bayer_from
from plenoptic.optics.sensor.model import SensorModel
from plenoptic.optics.sensor.radiometry import dark_current_at, photon_rate

EPS = np.finfo(float).eps


@settings(max_examples=40)
@given(rows=st.integers(1, 9), columns=st.integers(1, 9), pitch=st.floats(1e-4, 1.0))
def test_pixels_tile_the_sensor_around_the_axis(rows, columns, pitch):
    sensor = pl.Sensor(shape=(rows, columns), pixel_pitch=pitch)
    row, column = np.mgrid[:rows, :columns]
    centres = sensor.centre_of(row, column)
    assert centres.shape == (rows, columns, 2)
    size = pitch * max(rows, columns)
    # Half-whole numbers are exact: one rounding of each product.
    assert np.abs(centres.mean(axis=(0, 1))).max() <= 8 * EPS * size
    assert np.abs(np.diff(centres[..., 0], axis=1) + pitch).max(initial=0) <= 2 * EPS * size
    assert np.abs(np.diff(centres[..., 1], axis=0) - pitch).max(initial=0) <= 2 * EPS * size
    # Turned by 180 degrees: the upper left pixel of the image lies at +x, -y.
    assert centres[0, 0] == pytest.approx([(columns - 1) / 2 * pitch, -(rows - 1) / 2 * pitch], abs=2 * EPS * size)
    assert sensor.size == (rows * pitch, columns * pitch)
    assert sensor.half_diagonal == pytest.approx(math.hypot(rows, columns) * pitch / 2, rel=4 * EPS)
    assert np.array_equal(sensor.centre_of(rows - 1, np.arange(columns)), centres[-1])


def test_what_no_sensor_has_is_refused():
    for change, sentence in (
        ({"photon_rate": 0.0}, "photon_rate is 0; it must be above 0"),
        ({"photon_rate": (1.0, 2.0)}, "photon_rate has 2 numbers; give one, or one for each of red, green and blue"),
        ({"photon_rate": 1e300, "exposure_time": 1e300}, "overflows"),
        ({"exposure_time": -1.0}, "exposure_time is -1 s; it must be above 0"),
        ({"quantum_efficiency": 1.1}, "quantum_efficiency is 1.1; it must be at most 1"),
        ({"gain": 0.0}, "gain is 0 DN per electron"),
        ({"bits": 7}, "bits is 7; it must be at least 8"),
        ({"bits": 17}, "bits is 17; it must be at most 16"),
        ({"black_level": -1.0}, "black_level is -1 DN; it must be at least 0"),
        ({"black_level": 4095.0}, "black_level is 4095 DN; it must be below 4095, the largest of 12 bits"),
        ({"full_well": 0.0}, "full_well is 0 electrons"),
        ({"read_noise": -1.0}, "read_noise is -1 electrons"),
        ({"prnu": -0.1}, "prnu is -0.1; it must be at least 0"),
        ({"colour_filters": [[0, 3]]}, "its entries must be channels"),
        ({"colour_filters": [[0, 0.5]]}, "its entries must be channels"),
        ({"dead": 1.5}, "dead is 1.5; a fraction of the pixels must be at most 1"),
        ({"dead": [(1, -1)]}, "whole numbers from 0 on"),
        ({"dead": [(1.0, 1.5)]}, "whole numbers from 0 on"),
        ({"hot": 0.1, "bits": None}, "hot_current is inf, but neither full_well nor bits limits"),
    ):
        with pytest.raises(InvalidValueError) as caught:
            SensorModel(**{"photon_rate": 1.0, **change})
        assert sentence in str(caught.value)


def test_saturation_is_that_of_what_comes_first():
    assert SensorModel(1.0).white_level == 4095 and SensorModel(1.0, bits=None).white_level == math.inf
    assert SensorModel(1.0, full_well=1000, gain=0.5, black_level=64).white_level == 564
    assert SensorModel(1.0, full_well=1e9).white_level == 4095
    assert SensorModel(1.0, full_well=1e300, gain=1e300).white_level == 4095
    assert SensorModel(1.0, full_well=1000, gain=0.5, bits=None).white_level == 500


def test_bayer_patterns_are_found_again_wherever_they_begin():
    for pattern in list(BayerPattern):
        assert bayer_from(pattern, (0, 0)) == pattern, pattern
        assert bayer_from(np.tile(pattern.channels, (2, 3)), (4, 6)) == pattern, pattern
        shifted = bayer_from(pattern, (1, 1))
        assert {pattern.name, shifted.name} in ({"RGGB", "BGGR"}, {"GRBG", "GBRG"}), pattern
        assert bayer_from(pattern, (0, 1)).name[0] == pattern.name[1], pattern
    for other in ([[0, 1], [2, 1]], [[0]], [[0, 1, 1], [1, 2, 1]], [[0, 1, 1, 1], [1, 2, 1, 2]]):
        assert bayer_from(np.array(other), (0, 0)) is None, other


def test_photons_carry_the_energy_that_falls():
    # Energy per photon times photons is the power on the pixel, for all wavelengths.
    for wavelength in (400.0, 550.0, 700.0):
        rate = photon_rate(radiance=3.0, pixel_pitch=0.005, wavelength=wavelength)
        joules = 6.62607015e-34 * 299792458.0 / (wavelength * 1e-9)
        assert rate * joules == pytest.approx(3.0 * (5e-6) ** 2, rel=1e-14)
    # EMVA 1288: 50.34 photons per um^2, ms, um and uW/cm^2; a micrometre of wavelength, 1e-2 W/m^2, 1 um^2, 1 ms.
    assert photon_rate(radiance=0.01, pixel_pitch=0.001, wavelength=1000.0) * 1e-3 == pytest.approx(50.34, abs=0.005)


def test_photons_of_a_narrow_band_are_those_of_its_middle():
    band = Sensitivity([549.0, 549.001, 550.999, 551.0], [0.0, 0.3, 0.3, 0.0])  # 1.999 nm wide
    found = photon_rate(spectral_radiance=2.0, pixel_pitch=0.005, sensitivity=band)
    # Energies instead of photons are constant over the band, which moves the mean by half its relative width.
    assert found == pytest.approx(1.999 * photon_rate(radiance=2.0, pixel_pitch=0.005, wavelength=550.0), rel=2e-3)


def test_photons_of_channels_are_those_of_their_quantum_efficiencies():
    # QE of 0.2 and 0.8 over 100 nm each: response is QE times wavelength, of any unit.
    wavelengths = np.array([400.0, 500.0, 500.001, 600.0])
    efficiency = np.array([[0.2, 0.0, 0.2], [0.2, 0.0, 0.2], [0.0, 0.8, 0.2], [0.0, 0.8, 0.2]])
    found = photon_rate(
        spectral_radiance=1.0,
        pixel_pitch=0.005,
        sensitivity=Sensitivity(wavelengths, 7.0 * efficiency * wavelengths[:, None]),
    )
    # p^2 / (h c) integral of QE / 0.8 times the wavelength, in nm^2.
    photons = (5e-6) ** 2 * 1e-9 / (6.62607015e-34 * 299792458.0)
    blue, green = 0.5 * (500**2 - 400**2) / 4, 0.5 * (600**2 - 500**2)
    assert found == pytest.approx([photons * n for n in (blue, green, blue + green / 4)], rel=1e-5)


def test_luminance_is_radiance_times_luminous_efficacy():
    # V at four wavelengths, tables of CIE 18.2 (1983), and its integral, 106.857 nm; the fit is within 0.01.
    for wavelength, v in ((510.0, 0.503), (555.0, 1.0), (600.0, 0.631), (650.0, 0.107)):
        bright = photon_rate(luminance=683.0 * v, pixel_pitch=0.01, wavelength=wavelength)
        radiance = photon_rate(radiance=1.0, pixel_pitch=0.01, wavelength=wavelength)
        assert bright == pytest.approx(radiance, rel=0.01 / v), wavelength
    white = {"pixel_pitch": 0.01, "sensitivity": sensitivities.silicon()}
    dim = photon_rate(luminance=683.0 * 106.857, **white)
    assert dim == pytest.approx(photon_rate(spectral_radiance=1.0, **white), rel=2e-3)


def test_light_and_its_measure_belong_together():
    silicon, pitch = sensitivities.silicon(), {"pixel_pitch": 0.01}
    for wrong, sentence in (
        ({"radiance": 1.0}, "give either the wavelength"),
        ({"radiance": 1.0, "wavelength": 550.0, "sensitivity": silicon}, "give either the wavelength"),
        ({"radiance": 1.0, "sensitivity": silicon}, r"with a sensitivity, light is either spectral_radiance"),
        ({"spectral_radiance": 1.0, "wavelength": 550.0}, "with a wavelength, light is either radiance"),
        ({"radiance": 1.0, "luminance": 1.0, "wavelength": 550.0}, "with a wavelength, light is either radiance"),
        ({"luminance": 1.0, "wavelength": 1500.0}, "light of 1500 nm is invisible"),
        ({"luminance": -1.0, "sensitivity": silicon}, "luminance is -1 cd/m"),
        ({"luminance": 1.0, "sensitivity": sensitivities.linear_srgb()}, "negative responses"),
        ({"luminance": 1.0, "sensitivity": Sensitivity.lines([550.0])}, "lines"),
        ({"luminance": 1.0, "sensitivity": 550.0}, "sensitivity is"),
    ):
        with pytest.raises(InvalidValueError, match=sentence):
            photon_rate(**pitch, **wrong)


def test_dark_current_doubles():
    def at(celsius):
        return dark_current_at(celsius, rate=5.0, reference_temperature=25.0, doubling_temperature=8.0)

    assert at(25.0) == 5.0 and [at(33.0), at(17.0)] == pytest.approx([10.0, 2.5], rel=1e-14)
    with pytest.raises(InvalidValueError, match="rate is -1 electrons/s"):
        dark_current_at(20.0, rate=-1.0, reference_temperature=20.0, doubling_temperature=8.0)
    with pytest.raises(InvalidValueError, match="wavelength is 0.55 nm"):
        photon_rate(radiance=1.0, pixel_pitch=0.01, wavelength=0.55)
