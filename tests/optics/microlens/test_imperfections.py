import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.optics.microlens.imperfections import deviations_of, largest_offset

ALL = {"pitch_jitter": 0.01, "decentre": 0.02, "focal_length_spread": 0.05, "missing": 0.1, "dark": 0.2}


def indices(around):
    """(n, 2): all lenses up to `around` from the centre."""
    i, j = np.mgrid[-around : around + 1, -around : around + 1]
    return np.stack([i.ravel(), j.ravel()], axis=1)


def drawn(around=100, **changes):
    return pl.MicrolensImperfections(**(ALL | changes)).deviations(indices(around))


def normal_columns(found):
    """(5, n) standard normal numbers."""
    factor = (found.focal_length_factor - 1) / ALL["focal_length_spread"]
    return np.vstack([found.shift.T / ALL["pitch_jitter"], found.decentre.T / ALL["decentre"], factor])


def test_deviations_are_normal():
    for seed in (0, 12345):
        z = normal_columns(drawn(seed=seed, missing=0.0))
        n = z.shape[1]
        # Means and variances of n independent normal numbers.
        assert np.all(np.abs(z.mean(axis=1)) < 4 / math.sqrt(n)), seed
        assert np.all(np.abs(z.var(axis=1) - 1) < 4 * math.sqrt(2 / n)), seed
        # Chi-square over 32 equally likely classes: mean 31, variance 62; five numbers each.
        classes = np.array([math.erf(v / math.sqrt(2)) for v in z.ravel()]).reshape(z.shape)
        counts = np.stack([np.bincount(np.minimum((16 * (row + 1)).astype(int), 31), minlength=32) for row in classes])
        chi2 = ((counts - n / 32) ** 2 / (n / 32)).sum(axis=1)
        assert np.all(chi2 < 31 + 5 * math.sqrt(62)), seed


def test_deviations_are_cut_at_four_standard_deviations():
    # Of 2.5 million numbers, 63 per million lie beyond: some 160 are cut.
    z = normal_columns(drawn(around=350, missing=0.0))
    assert np.abs(z).max() == pytest.approx(4.0, rel=1e-12)
    at_limit = (np.abs(z) > 4 - 1e-12).sum()
    expected = z.size * math.erfc(4 / math.sqrt(2))
    assert abs(at_limit - expected) < 4 * math.sqrt(expected)


def test_neither_numbers_nor_neighbours_are_correlated():
    around = 60
    for seed in (0, 7):
        z = normal_columns(drawn(around, seed=seed, missing=0.0)).reshape(5, 2 * around + 1, 2 * around + 1)
        # The circular correlation of n independent pairs has a standard deviation of 1 / sqrt(n); 5 x 5 x 17 x 17
        # of them (7225) exceed 5.5 standard deviations with a probability of 3e-4.
        limit = 5.5 / math.sqrt(z[0].size)
        spectra = np.fft.fft2(z - z.mean(axis=(1, 2), keepdims=True))
        near = np.arange(-8, 9)
        for a in range(5):
            for b in range(a + 1):
                correlation = np.fft.ifft2(spectra[a] * spectra[b].conj()).real / z[0].size
                submatrix = correlation[np.ix_(near, near)]
                if a == b:
                    assert submatrix[8, 8] == pytest.approx(1.0, abs=4 * math.sqrt(2 / z[0].size)), seed
                    submatrix[8, 8] = 0.0
                assert np.abs(submatrix).max() < limit, seed


def test_missing_and_dark_lenses_are_a_fraction_of_all_and_never_both():
    deviations = drawn(seed=3)
    n = len(deviations)
    missing, dark = np.isinf(deviations.focal_length_factor), deviations.transmission == 0
    for lost, fraction in ((missing, ALL["missing"]), (dark, ALL["dark"])):
        assert abs(lost.mean() - fraction) < 4 * math.sqrt(fraction * (1 - fraction) / n)
    assert not (missing & dark).any() and set(deviations.transmission.tolist()) == {0.0, 1.0}
    # Whether a lens is dark says nothing about its neighbours.
    square = dark.reshape(201, 201) - dark.mean()
    for step in ((0, 1), (1, 0), (1, 1), (2, 0), (4, 0)):
        correlation = (square * np.roll(square, step, axis=(0, 1))).mean() / square.var()
        assert abs(correlation) < 4.5 / math.sqrt(n)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**64 - 1), choice=st.integers(0, 10_000))
def test_a_lens_s_numbers_depend_on_the_seed_and_its_index_alone(seed, choice):
    spoiled = pl.MicrolensImperfections(**ALL, seed=seed)
    index = np.random.default_rng(choice).permutation(indices(6))[:20]
    together = spoiled.deviations(index)
    for k in range(20):
        single = spoiled.deviations(index[k : k + 1])
        for name in ("shift", "decentre", "focal_length_factor", "transmission"):
            assert np.array_equal(getattr(single, name)[0], getattr(together, name)[k])


def test_effects_are_switched_on_and_off_alone():
    index = indices(5)
    whole = pl.MicrolensImperfections(**ALL, seed=4).deviations(index)
    jitter = pl.MicrolensImperfections(pitch_jitter=ALL["pitch_jitter"], seed=4).deviations(index)
    assert np.array_equal(jitter.shift, whole.shift)
    dark = pl.MicrolensImperfections(dark=ALL["dark"], seed=4).deviations(index)
    assert np.array_equal(dark.transmission, whole.transmission)
    # What is not there takes no memory, and all lenses can be lost.
    none = pl.MicrolensImperfections(seed=1).deviations(index)
    assert none.shift is none.decentre is none.focal_length_factor is none.transmission is dark.shift is None
    for missing, black in ((1.0, 0.0), (0.0, 1.0), (0.3, 0.7)):
        deviations = drawn(20, missing=missing, dark=black)
        lost = False if deviations.transmission is None else deviations.transmission == 0
        assert (np.isinf(deviations.focal_length_factor) | lost).all(), (missing, black)
    # Another seed is another array, and lenses far away have numbers too.
    a, b = normal_columns(drawn(seed=1, missing=0.0)), normal_columns(drawn(seed=2, missing=0.0))
    assert np.all(np.abs((a * b).mean(axis=1)) < 4 / math.sqrt(a.shape[1]))
    far = [(-(2**62), 2**62), (2**62, -(2**62)), (0, -1), (-1, 0)]
    deviations = pl.MicrolensImperfections(**ALL).deviations(far)
    assert np.isfinite(deviations.shift).all() and len(np.unique(deviations.shift)) == 8


def test_drawn_deviations_can_be_listed():
    # What is drawn, written down and read again is the same, lens for lens.
    spoiled, index = pl.MicrolensImperfections(**ALL, seed=9), indices(7)
    assert deviations_of(spoiled.deviations(index), index[::-1]) == spoiled.deviations(index[::-1])
    empty = pl.optics.MicrolensDeviations(np.zeros((0, 2)), shift=np.zeros((0, 2)), transmission=[])
    deviations = deviations_of(empty, indices(2))
    assert len(empty) == 0 and len(deviations) == 25 and largest_offset(empty) == 0.0
    assert deviations.shift is deviations.transmission is None


def test_no_axis_lies_farther_off_than_the_largest_offset():
    deviations = drawn(around=350)
    off = np.hypot(*(deviations.shift + deviations.decentre).T)
    limit = largest_offset(pl.MicrolensImperfections(**ALL))
    assert limit == pytest.approx(4 * math.sqrt(2) * 0.03, rel=1e-15)
    assert off.max() <= largest_offset(deviations) <= limit


def test_impossible_imperfections():
    for changes, message in (
        ({"pitch_jitter": -0.1}, "pitch_jitter is -0.1; it must be from 0 to"),
        ({"decentre": math.inf}, "decentre is inf; it must be finite"),
        ({"focal_length_spread": 0.3}, "focal_length_spread is 0.3; it must be from 0 to 0.2"),
        ({"missing": 1.1}, "missing is 1.1; it must be from 0 to 1"),
        ({"dark": math.nan}, "dark is nan; it must be finite"),
        ({"missing": 0.6, "dark": 0.6}, "missing and dark add up to 1.2; at most 1 is possible"),
        ({"seed": -1}, "seed is -1; it must be at least 0"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.MicrolensImperfections(**changes)


def test_impossible_deviations():
    for changes, message in (
        ({"index": [(0, 0), (0, 0)]}, "index lists a microlens twice"),
        ({"index": [0, 1]}, r"index has shape \(2,\); it must have shape \(n, 2\)"),
        ({"shift": [(0, 0)]}, r"shift has shape \(1, 2\); it must have shape \(2, 2\)"),
        ({"decentre": [(0, math.inf), (0, 0)]}, "decentre holds a number that is not finite"),
        ({"focal_length_factor": [1.0, math.nan]}, "focal_length_factor holds a number that is not finite"),
        ({"focal_length_factor": [1.0, -2.0]}, "focal_length_factor is -2; it must be above 0"),
        ({"transmission": [1.0, 1.1]}, "transmission holds a number outside 0 to 1"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.optics.MicrolensDeviations(**({"index": [(0, 0), (1, 0)]} | changes))
