"""The photon transfer curve: measured moments follow the closed form, and its slope is the gain."""

import dataclasses
import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.color_filter import BayerPattern
from plenoptic.optics.sensor.model import SensorModel, ShotNoise
from plenoptic.plots.sensor import plot_photon_transfer
from plenoptic.readout.photon_transfer import photon_transfer

SHAPE = (200, 200)
PIXELS = 200 * 200
FIVE_SIGMA = 5.0

LIGHT = {"photon_rate": (20000.0, 60000.0, 40000.0), "exposure_time": 0.5, "quantum_efficiency": 0.6}
NUMBERS = {"gain": 0.3, "black_level": 200.0, "bits": 14, "colour_filters": BayerPattern.RGGB}
NOISE = {"read_noise": 8.0, "dark_current": 60.0, "prnu": 0.015, "dsnu": 10.0, "dead": 0.1, "hot": 0.1}
SENSOR = SensorModel(**LIGHT, **NUMBERS, **NOISE)

CHANGES = [{}, {"shot_noise": ShotNoise.NONE}, {"read_noise": 0.0}, {"prnu": 0.0}, {"dsnu": 0.0}]
CHANGES += [{"prnu": 0.0, "dsnu": 0.0}, {"dark_current": 0.0, "bits": None, "hot": 0.0}, {"bits": 16, "gain": 1.0}]


def test_moments_follow_the_closed_form():
    for k, change in enumerate(CHANGES):
        model, channel = dataclasses.replace(SENSOR, **change), k % 3
        curve = photon_transfer(model, [0.0, 0.001, 0.01, 0.1, 0.5, 1.0], shape=SHAPE, channel=channel, seed=channel)
        temporal, fixed = curve.expected_variance, curve.expected_pattern_variance
        # Mean of two images: noise halves, the pattern stays.
        error = np.sqrt((temporal / 2 + fixed) / PIXELS)
        assert np.all(np.abs(curve.mean - curve.expected_mean) <= FIVE_SIGMA * error), change
        # A variance of n normal numbers has the relative standard error sqrt(2 / n); Poisson numbers of mean m add
        # 1 / m to the 2, and at the lowest level here m is 30 or read noise rules. With nothing but rounding (no
        # shot and no read noise, which no case has) there would be no law.
        assert np.all(np.abs(curve.variance - temporal) <= FIVE_SIGMA * math.sqrt(2.1 / PIXELS) * temporal), change
        spread = math.sqrt(2 / PIXELS) * (fixed + temporal / 2 + temporal / 2)
        assert np.all(np.abs(curve.pattern_variance - fixed) <= FIVE_SIGMA * spread), change


def test_quantisation_adds_a_twelfth():
    # Read noise of 1.5 DN makes rounding errors uniform to exp(-2 pi^2 1.5^2); the twelfth is 3.7 % of 2.25, four
    # standard errors of the variance of 40000 numbers are 2.8 %.
    curve = photon_transfer(
        SensorModel(1.0, shot_noise=ShotNoise.NONE, read_noise=1.5, black_level=20.0), [0.0, 0.3, 0.7], shape=SHAPE
    )
    assert np.all(np.abs(curve.variance - (2.25 + 1 / 12)) < 4 * math.sqrt(2 / PIXELS) * (2.25 + 1 / 12))
    assert curve.expected_variance == pytest.approx(2.25 + 1 / 12)
    lines = SensorModel(1.0, shot_noise=ShotNoise.NONE, read_noise=1.5, row_noise=2.0, column_dsnu=3.0, bits=None)
    curve = photon_transfer(lines, [0.5], shape=(4, 4))
    assert (*curve.expected_variance, *curve.expected_pattern_variance) == pytest.approx((2.25 + 4.0, 9.0))


def test_the_slope_is_the_gain():
    for gain in (0.1, 1.7):
        model = dataclasses.replace(SENSOR, gain=gain, full_well=4000.0)
        curve = photon_transfer(model, np.linspace(0, 1, 21), shape=SHAPE)
        # Of about 10 levels that count, each knows its variance to sqrt(2 / n); 5 standard errors of one bound the fit.
        assert curve.gain == pytest.approx(gain, rel=FIVE_SIGMA * math.sqrt(2 / PIXELS))


def test_a_full_well_ends_variance_and_mean():
    curve = photon_transfer(dataclasses.replace(SENSOR, full_well=4000.0, read_noise=2.0, dsnu=0.0), [0.2, 5.0])
    noise = 0.3**2 * 2.0**2 + 1 / 12
    assert curve.mean[1] == pytest.approx(curve.white_level, abs=0.5)
    assert curve.variance[1] == pytest.approx(noise, rel=FIVE_SIGMA * math.sqrt(2 / 128**2))
    assert curve.expected_mean[1] > curve.white_level


def test_impossible_requests_are_refused_and_seeds_kept():
    for levels, more, text in (
        ([1.0], {"channel": 3}, "channel is 3"),
        ([1.0], {"shape": (1, 4)}, "rows is 1; it must be at least 2"),
        ([-1.0], {}, "light must be finite and at least 0"),
    ):
        with pytest.raises(InvalidValueError, match=text):
            photon_transfer(SENSOR, levels, **more)
    assert np.isnan(photon_transfer(SENSOR, [0.5]).gain)
    # The same seed gives the same curve.
    one, same, other = (photon_transfer(SENSOR, [0.1, 0.2], seed=seed) for seed in (3, 3, 4))
    assert one == same != other


def test_the_figure_shows_what_there_is():
    levels = np.append(0.0, np.geomspace(1e-3, 1, 7))
    ax = plot_photon_transfer(photon_transfer(SENSOR, levels, shape=(32, 32)), Figure().subplots())
    names = [f"{what}, {how}" for what in ("temporal noise", "fixed pattern") for how in ("measured", "expected")]
    assert [line.get_label() for line in ax.lines] == [*names, "white level"]
    curve = photon_transfer(SensorModel(100.0, bits=None), levels, shape=(32, 32))
    bare = plot_photon_transfer(curve, Figure().subplots())
    # All but the dark one.
    assert len(bare.lines) == 2 and bare.lines[0].get_ydata() == pytest.approx(curve.variance[1:])
