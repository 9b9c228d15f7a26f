"""What a sensor makes of light: one effect at a time against its closed form, reproducibility, and refusals."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.color_filter import BayerPattern
from plenoptic.optics.sensor.model import SensorModel, ShotNoise
from plenoptic.readout.develop import develop

FIVE_SIGMA = 5.0
SIDE = 300
PIXELS = SIDE * SIDE

NOISELESS = SensorModel(photon_rate=1.0, shot_noise=ShotNoise.NONE, bits=None)
"""Electrons in, the same numbers out: every effect is off."""
LIGHT = {"photon_rate": (3000.0, 5000.0, 4000.0), "exposure_time": 0.5, "quantum_efficiency": (0.4, 0.6, 0.5)}
NOISE = {"read_noise": 4.0, "row_noise": 1.5, "dark_current": 20.0, "prnu": 0.02, "dsnu": 3.0, "column_dsnu": 2.0}
BROKEN = {"dead": 0.01, "hot": 0.01, "hot_current": 3000.0}
NUMBERS = {"gain": 0.7, "black_level": 100, "bits": 12, "full_well": 4000, "colour_filters": BayerPattern.GRBG}
EVERYTHING = SensorModel(**LIGHT, **NOISE, **BROKEN, **NUMBERS, pattern_seed=9)


def even(level, channels=1, shape=(SIDE, SIDE)):
    return pl.Exposure(np.full((*shape, channels), level))


def numbers(model, level=100.0, seed=0):
    return develop(even(level), model, seed=seed).data.astype(np.float64)


def with_(model=NOISELESS, **changes):
    return dataclasses.replace(model, **changes)


def picture(channels=3, shape=(40, 60)):
    return np.random.default_rng(1).uniform(0, 1, (*shape, channels)).astype(np.float32)


def near(found, expected, variance, n=PIXELS):
    """Whether a mean of n numbers of this variance is within five standard errors."""
    return abs(found - expected) < FIVE_SIGMA * math.sqrt(variance / n)


def assert_poisson(found, mean):
    assert near(found.mean(), mean, mean), mean
    # The fourth central moment of Poisson is m + 3 m^2, so the variance of the sample variance is (m + 2 m^2) / n.
    assert near(found.var(), mean, mean + 2 * mean**2), mean


def test_same_seed_same_bits_and_another_seed_others(monkeypatch):
    shot = pl.Exposure(picture())
    one = develop(shot, EVERYTHING, seed=3, threads=1)
    # Half a DN is far below the noise: most pixels change.
    assert np.mean(one.data != develop(shot, EVERYTHING, seed=4).data) > 0.7
    assert np.mean(one.data != develop(shot, with_(EVERYTHING, pattern_seed=10), seed=3).data) > 0.7
    # Bits depend neither on threads nor on bands.
    monkeypatch.setattr("plenoptic.readout.develop._BAND", 500)
    assert develop(shot, EVERYTHING, seed=3, threads=1) == one == develop(shot, EVERYTHING, seed=3, threads=3)


def test_a_region_has_the_bits_of_the_whole():
    image = picture()
    for filters in (None, BayerPattern.RGGB, ((0, 1, 2), (1, 2, 0), (2, 0, 1))):
        model = with_(EVERYTHING, colour_filters=filters, dead=[(9, 15), (30, 2)], hot=0.05)
        whole = develop(pl.Exposure(image), model, seed=3).data
        for row, column in ((7, 12), (8, 13)):
            part = np.s_[row : row + 20, column : column + 31]
            shot = pl.Exposure(image[part], region=(row, row + 20, column, column + 31))
            assert np.array_equal(develop(shot, model, seed=3).data, whole[part]), (filters, row)


def test_without_effects_light_comes_out_as_it_went_in():
    image = picture()
    assert np.array_equal(develop(pl.Exposure(image), NOISELESS).data, image.astype(np.float64))
    # Electrons are photons times efficiency and time.
    model = with_(photon_rate=(10.0, 20.0, 30.0), quantum_efficiency=(0.5, 0.25, 1.0), exposure_time=0.1)
    assert develop(even(2.0, 3), model).data[0, 0].tolist() == pytest.approx([1.0, 1.0, 6.0], rel=1e-14)


def test_shot_noise_has_the_mean_as_variance():
    for electrons in (0.1, 1.0, 10.0, 1000.0):
        found = numbers(with_(shot_noise=ShotNoise.POISSON, photon_rate=electrons), 1.0)
        assert np.array_equal(found, np.rint(found))
        assert_poisson(found, electrons)
        # exp(-m) of the pixels stay empty.
        empty = math.exp(-electrons)
        assert near(np.mean(found == 0), empty, max(empty * (1 - empty), 1 / PIXELS)), electrons


def test_normal_noise_of_pixels_rows_and_columns():
    pixels, lines = (
        (("read_noise", None, False), ("dsnu", None, True)),
        (("row_noise", 1, False), ("column_dsnu", 0, True)),
    )
    for name, axis, stays in pixels + lines:
        found, again = (numbers(with_(**{name: 3.0}), seed=seed) for seed in (0, 1))
        # Along a row or column all pixels are off by the same.
        assert axis is None or np.all(np.ptp(found, axis=axis) == 0), name
        off = (found if axis is None else found.mean(axis=axis)) - 100.0
        assert near(off.mean(), 0, 9, off.size), name
        assert near(off.var(), 9, 2 * 81, off.size), name
        assert near(np.mean(np.abs(off) > 6), 0.0455003, 0.0455, off.size), name
        assert np.all((found == again) == stays), name


def test_prnu_scales_with_the_light_and_leaves_the_dark_alone():
    model = with_(prnu=0.05, dark_current=7.0)
    gains = (numbers(model, 1000.0) - 7.0) / 1000.0
    np.testing.assert_allclose((numbers(model, 10.0) - 7.0) / 10.0, gains, rtol=1e-12)
    assert near(gains.mean(), 1, 0.05**2)
    assert near(gains.var(), 0.05**2, 2 * 0.05**4)
    assert np.all(numbers(model, 0.0) == 7.0)


def test_dark_current_collects_with_time_and_is_one_poisson_variable_with_the_light():
    dark = with_(dark_current=6.0, exposure_time=0.5)
    assert np.all(numbers(dark, 0.0) == 3.0)
    assert_poisson(numbers(with_(dark, shot_noise=ShotNoise.POISSON), 0.0), 3.0)
    assert_poisson(numbers(with_(dark_current=4.0, shot_noise=ShotNoise.POISSON), 5.0), 9.0)


def test_full_well_in_closed_form():
    # Poisson of mean m cut at w: E min(N, w) = sum over k of P(N > k), k = 0 ... w - 1.
    mean, well = 20.0, 22
    probability = np.array([math.exp(-mean + k * math.log(mean) - math.lgamma(k + 1)) for k in range(well)])
    above = 1 - np.cumsum(probability)
    found = numbers(with_(full_well=well, shot_noise=ShotNoise.POISSON), mean)
    assert found.max() == well
    assert near(found.mean(), above.sum(), mean)
    full = above[well - 1]
    assert near(np.mean(found == well), full, full * (1 - full))
    # Read noise comes after the full well, and dark levels may be below 0.
    assert near(numbers(with_(full_well=50.0, read_noise=2.0), 1e6).mean(), 50, 4)
    assert numbers(with_(read_noise=2.0), 0.0).min() < -5


def test_a_ramp_is_quantised_to_half_a_step():
    for bits in range(8, 17):
        largest = 2**bits - 1
        ramp = np.linspace(0, largest, 300 * 301).reshape(300, 301, 1).astype(np.float32)
        data = develop(pl.Exposure(ramp), with_(bits=bits)).data
        assert data.dtype == np.uint16 and (data.min(), data.max()) == (0, largest)
        error = data - ramp[:, :, 0].astype(np.float64)
        assert np.abs(error).max() <= 0.5, bits
        if bits <= 12:  # at least 22 points for each step: a sum in place of the integral errs by their inverse square
            assert np.mean(error**2) == pytest.approx(1 / 12, rel=0.01), bits


def test_gain_and_black_level_and_the_ends_of_the_converter():
    assert np.all(numbers(with_(gain=0.25, black_level=64.0), 100.0) == 89.0)
    model = with_(bits=10, black_level=3, read_noise=5.0)
    assert numbers(model, 1e30).min() == 1023
    dark = numbers(model, 0.0)
    assert dark.min() == 0
    # Below 0.5 DN all is 0: a normal variable below -2.5 / 5.
    assert near(np.mean(dark == 0), 0.3085375, 0.3085 * 0.6915)


def test_each_filter_passes_its_channel():
    shot = pl.Exposure(np.broadcast_to([10.0, 20.0, 30.0], (4, 6, 3)))
    for pattern in BayerPattern:
        levels = np.array([10.0 * (1 + "RGB".index(letter)) for letter in pattern.name]).reshape(2, 2)
        assert np.array_equal(develop(shot, with_(colour_filters=pattern)).data, np.tile(levels, (2, 3))), pattern


def test_any_pattern_repeats():
    pattern = [[0, 1, 1], [2, 1, 0]]
    shot = pl.Exposure(np.broadcast_to([0.0, 1.0, 2.0], (5, 7, 3)))
    data = develop(shot, with_(colour_filters=pattern)).data
    assert all(data[i, j] == pattern[i % 2][j % 3] for i in range(5) for j in range(7))
    # A grey exposure stands for three equal channels.
    assert develop(even(0.5, 1, (8, 8)), EVERYTHING) == develop(even(0.5, 3, (8, 8)), EVERYTHING)
    assert develop(even(0.5, 1, (8, 8)), with_(photon_rate=(1.0, 2.0, 3.0))).data.shape == (8, 8, 3)
    assert develop(even(0.5, 1, (8, 8)), NOISELESS).data.shape == (8, 8)


LEVELS = (("dead", 0.0), ("hot", 250.0))
"""Of pixels that fail, where 250 electrons are a full well."""


def test_listed_pixels_fail_and_no_others():
    for name, level in LEVELS:
        data = numbers(with_(full_well=250.0, **{name: [(0, 0), (5, 7), (299, 299), (1000, 3)]}))
        assert np.argwhere(data != 100.0).tolist() == [[0, 0], [5, 7], [299, 299]]
        assert np.all(data[[0, 5, 299], [0, 7, 299]] == level), name


def test_a_fraction_fails_and_always_the_same():
    for name, level in LEVELS:
        model = with_(full_well=250.0, **{name: 0.02})
        data = numbers(model)
        assert near(np.mean(data == level), 0.02, 0.02 * 0.98), name
        assert np.all((data == level) | (data == 100.0))
        assert np.array_equal(data, numbers(model, seed=5))
        assert not np.array_equal(data, numbers(with_(model, pattern_seed=1)))
        assert np.all(numbers(with_(model, **{name: 1.0})) == level)
    # Hot pixels collect their current, and dead ones win.
    assert np.all(numbers(with_(hot=1.0, hot_current=30.0, exposure_time=2.0)) == 2 * 130.0)
    assert np.all(numbers(with_(hot=1.0, dead=1.0, hot_current=30.0)) == 0.0)


def test_draws_of_one_effect_do_not_move_those_of_another():
    # Shot noise with and without read noise: the difference is the read noise alone.
    quiet = with_(shot_noise=ShotNoise.POISSON)
    difference = numbers(with_(quiet, read_noise=2.0)) - numbers(quiet)
    np.testing.assert_allclose(difference, numbers(with_(read_noise=2.0)) - 100.0, atol=1e-12)
    # Layers have noise of their own.
    data = develop(even(100.0, 3), with_(read_noise=1.0)).data.reshape(-1, 3)
    # Correlation coefficients of independent numbers scatter by 1 / sqrt(n).
    assert np.abs(np.corrcoef(data.T)[np.triu_indices(3, 1)]).max() < FIVE_SIGMA / math.sqrt(PIXELS)


def test_extreme_light():
    largest = float(np.finfo(np.float32).max)
    for rate in (1.0, 1e290):
        data = develop(even(largest, shape=(9, 9)), with_(EVERYTHING, colour_filters=None, photon_rate=rate)).data
        assert data.max() <= 0.7 * 4000 + 100 + 10 * 0.7 * 6
    for light, level in ((largest, 65535), (0.0, 0), (1e-45, 0)):
        assert np.all(numbers(with_(bits=16, shot_noise=ShotNoise.POISSON), light) == level)
    assert develop(even(1.0, shape=(1, 1)), EVERYTHING).data.shape == (1, 1)


def test_impossible_light_and_seeds_are_refused():
    for bad in (np.nan, np.inf, -1e-6):
        image = np.ones((3, 4, 1))
        image[1, 2] = bad
        with pytest.raises(InvalidValueError, match=r"at row 1, column 2, and 1 such values in all; light must be fin"):
            develop(pl.Exposure(image), NOISELESS)
    for seed in (-1, 1 << 64):
        with pytest.raises(InvalidValueError, match="seed is"):
            develop(even(1.0), NOISELESS, seed=seed)
    assert develop(even(1.0), NOISELESS, seed=(1 << 64) - 1).seed == (1 << 64) - 1
