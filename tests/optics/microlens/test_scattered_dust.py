import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.microlens.dust import Blemishes, BlemishSite

EPS = np.finfo(float).eps


def scattered(**changes):
    fields = {"half_size": (10.0, 5.0), "dust_per_mm2": 20.0, "scratches": 300, "seed": 3} | changes
    return Blemishes.scattered(BlemishSite.SENSOR, **fields)


def test_a_seed_gives_the_same_blemishes():
    assert scattered() == scattered()
    assert scattered(seed=4) != scattered()
    # Scratches do not move the dust.
    dust = len(scattered(scratches=0))
    assert np.array_equal(scattered(scratches=0).start, scattered().start[:dust])
    assert len(scattered()) == dust + 300


def test_dust_is_poisson_in_number_and_log_normal_in_size():
    counts = np.array([len(scattered(scratches=0, dust_per_mm2=0.5, seed=seed)) for seed in range(300)])
    mean = 0.5 * 200.0
    # Poisson: variance = mean; the variance's own standard deviation over its value is sqrt(2/300 + 1/(300 mean)).
    assert abs(counts.mean() - mean) < 4 * math.sqrt(mean / 300)
    assert abs(counts.var(ddof=1) / mean - 1) < 4 * math.sqrt(2 / 300 + 1 / (300 * mean))
    dust = scattered(scratches=0, dust_radius=0.02, dust_spread=0.7)
    n, logs = len(dust), np.log(dust.radius / 0.02)
    assert abs(logs.mean()) < 4 * 0.7 / math.sqrt(n)
    assert abs(logs.std() / 0.7 - 1) < 4 / math.sqrt(2 * n)
    # Uniform: variance side^2 / 12 over a side.
    assert np.all(np.abs(dust.start) <= [10.0, 5.0])
    assert np.all(np.abs(dust.start.mean(axis=0)) < 4 * np.array([20.0, 10.0]) / math.sqrt(12 * n))
    assert np.array_equal(dust.start, dust.end)
    assert np.all(scattered(scratches=0, dust_spread=0.0).radius == 0.005)


def test_scratches_have_their_length_width_and_any_direction():
    lines = scattered(dust_per_mm2=0.0, scratches=2000, scratch_length=0.8, scratch_width=0.03)
    along = lines.end - lines.start
    # Ends are good to an eps of up to 10.4 mm each.
    assert np.linalg.norm(along, axis=1) == pytest.approx(0.8, abs=32 * EPS * 10.4)
    assert np.all(lines.radius == 0.015) and np.all(lines.transmission == 0.0)
    assert np.all(np.abs(0.5 * (lines.start + lines.end)) <= [10.0 + 1e-12, 5.0 + 1e-12])
    # Directions without a sign: the mean of exp(2 i angle) has real and imaginary parts of variance 1 / (2 n).
    doubled = np.exp(2j * np.arctan2(along[:, 1], along[:, 0])).mean()
    assert max(abs(doubled.real), abs(doubled.imag)) < 4 / math.sqrt(2 * 2000)


def test_the_area_that_dust_covers():
    # Grains of one radius placed at random: the share of the plane they leave open is exp(-density pi r^2).
    radius, density = 0.05, 30.0
    dust = scattered(scratches=0, dust_per_mm2=density, dust_radius=radius, dust_spread=0.0)
    points = np.random.default_rng(9).uniform(-1, 1, (20_000, 2)) * [9.9, 4.9]
    open_share = math.exp(-density * math.pi * radius**2)
    # Points closer than 2 r share grains: some 200 / (pi (2 r)^2) independent places.
    places = 4 * 9.9 * 4.9 / (math.pi * (2 * radius) ** 2)
    sigma = math.sqrt(open_share * (1 - open_share) * (1 / places + 1 / 20_000))
    assert abs(dust.at(points).mean() - open_share) < 4 * sigma


def test_impossible_scatterings():
    for changes, message in [
        ({"half_size": (0.0, 1.0)}, "half_size is 0 mm; it must be above 0"),
        ({"half_size": (1.0,)}, "half_size has shape"),
        ({"dust_per_mm2": -1.0}, "dust_per_mm2 is -1; it must be at least 0"),
        ({"dust_per_mm2": 1e9}, "some 2e[+]11 blemishes are asked for, and the limit is 5000000"),
        ({"dust_radius": 0.0}, "dust_radius is 0 mm"),
        ({"dust_spread": -0.1}, "dust_spread is -0.1; it must be at least 0"),
        ({"scratches": 1.5}, "scratches is 1.5; it must be a whole number"),
        ({"scratch_length": 0.0}, "scratch_length is 0 mm"),
        ({"scratch_width": math.nan}, "scratch_width is nan"),
        ({"transmission": 2.0}, "transmission of the blemishes holds a number outside 0 to 1"),
        ({"seed": -1}, "seed is -1; it must be at least 0"),
    ]:
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            scattered(**changes)
