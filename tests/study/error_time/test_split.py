"""Splitting a squared error: what is added is found again, and what belongs to the reference is taken away."""

import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.study.error_time.error_split import reference_of, split_error

SHAPE = (48, 40, 3)


def shot(truth, error, rng, *, reported=1.0):
    image = truth + error * rng.standard_normal(SHAPE)
    return pl.Exposure(image, standard_error=np.broadcast_to(reported * error, SHAPE))


def scene(rng):
    """Bright, dark and in between: what is dark must not count."""
    truth = rng.uniform(0.5, 2.0, SHAPE)
    truth[:8] = 1e-3
    return truth


def relative(squares, truth):
    """The mean squared relative error over what is lit here."""
    return float(np.mean(np.mean(squares[8:], axis=2) / np.mean(truth[8:], axis=2) ** 2))


def test_variance_and_squared_bias_add_up_to_the_squared_error_without_that_of_the_reference():
    """An identity, not a law of large numbers: it holds to rounding for any images."""
    rng = np.random.default_rng(1)
    truth = scene(rng)
    shots = [shot(1.1 * truth, 0.2 * truth, rng) for _ in range(5)]
    reference = reference_of(shot(truth, 0.05 * truth, rng))
    split = split_error(shots, reference)
    squares = [np.mean(reference.relative_squares((x.image[reference.lit] - reference.image) ** 2)) for x in shots]
    assert split.variance + split.bias_squared == pytest.approx(np.mean(squares) - reference.squared_error, rel=1e-9)


def test_known_parts_are_found():
    for bias in [0.0, 0.02, 0.1]:
        rng = np.random.default_rng(2)
        truth = scene(rng)
        # A bias of changing sign, and noise that differs from pixel to pixel.
        off = bias * truth * np.where(rng.random(SHAPE[:2])[:, :, None] < 0.5, -1.0, 1.0)
        noise = 0.1 * np.broadcast_to(rng.uniform(0.5, 1.5, SHAPE[:2])[:, :, None], SHAPE)
        shots = [shot(truth + off, noise, rng, reported=1.25) for _ in range(6)]
        split = split_error(shots, reference_of(shot(truth, 0.01 * truth, rng)))
        # 4 standard errors; one in 16 000 tries fails, and this one is seeded.
        assert abs(split.variance - relative(noise**2, truth)) < 4 * split.variance_error, bias
        assert abs(split.bias_squared - relative(off**2, truth)) < 4 * split.bias_squared_error, bias
        # The spread of 1600 pixels' means is told to some per cent.
        assert split.variance_error < 0.05 * split.variance, bias
        assert split.bias_squared_error < 0.15 * max(split.bias_squared, relative(noise**2, truth) / 6), bias
        # To the float32 of images and errors.
        assert split.reported_variance == pytest.approx(relative((1.25 * noise) ** 2, truth), rel=0.01), bias


def test_no_bias_is_found_where_there_is_none():
    """The squared bias over its standard error has mean 0 and spread 1."""
    rng = np.random.default_rng(4)
    truth = np.ones(SHAPE)
    scores = []
    for _ in range(60):
        split = split_error([shot(truth, 0.1, rng) for _ in range(4)], reference_of(shot(truth, 0.03, rng)))
        scores.append(split.bias_squared / split.bias_squared_error)
    # 4 standard errors of a mean, and of a standard deviation, of 60 normal numbers.
    assert abs(np.mean(scores)) < 4 / math.sqrt(60) and abs(np.std(scores, ddof=1) - 1) < 4 / math.sqrt(2 * 59)
    assert max(scores) < 4


def test_what_cannot_be_split_is_refused():
    rng = np.random.default_rng(6)
    reference, ones, one = reference_of(shot(1.0, 0.1, rng)), np.ones(SHAPE), np.ones((*SHAPE[:2], 1))
    grey = pl.Exposure(one, standard_error=one)
    for split, text in (
        (lambda: split_error([shot(1.0, 0.1, rng)], reference), "1 renders; a split needs at least 2"),
        (lambda: reference_of(pl.Exposure(ones)), "no standard errors"),
        (lambda: reference_of(pl.Exposure(0 * ones, standard_error=0 * ones)), "black"),
        (lambda: reference_of(pl.Exposure(ones, standard_error=np.inf * ones)), "infinite standard errors"),
        (lambda: split_error([grey, grey], reference), "1 and 3 channels"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=text):
            split()
    assert split_error([pl.Exposure(rng.uniform(1, 2, SHAPE)) for _ in range(2)], reference).reported_variance is None
