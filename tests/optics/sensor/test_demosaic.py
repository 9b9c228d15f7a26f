"""Demosaicing: constant and linear images stay unchanged, and false colours appear at edges only."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.color_filter import BayerPattern
from plenoptic.optics.sensor.demosaic import DemosaicMethod
from plenoptic.optics.sensor.model import SensorModel, ShotNoise
from plenoptic.readout.develop import develop

EPS = np.finfo(np.float32).eps
REACH = {DemosaicMethod.LINEAR: 1, DemosaicMethod.MHC: 2, DemosaicMethod.WEIGHTED_MEAN: 1}

IDEAL = SensorModel(photon_rate=1.0, shot_noise=ShotNoise.NONE, bits=None, colour_filters=BayerPattern.RGGB)

EVERY = [(pattern, method) for pattern in BayerPattern for method in DemosaicMethod]


def through(image, method, model=IDEAL, region=None, **wishes):
    return develop(pl.Exposure(image, region=region), model).demosaic(method, **wishes)


def with_filters(filters, **changes):
    return dataclasses.replace(IDEAL, colour_filters=filters, **changes)


def test_what_is_even_stays_even_up_to_the_border():
    for pattern, method in EVERY:
        even = np.broadcast_to(np.float32([0.2, 0.7, 0.4]), (8, 11, 3))
        for region in (None, (3, 11, 4, 15), (2, 10, 5, 16), (3, 11, 5, 16)):
            shot = through(even, method, with_filters(pattern), region)
            assert shot.image.shape == even.shape and shot.region == region, (pattern, method)
            # Weights are dyadic, or sums of at most 25 of them.
            np.testing.assert_allclose(shot.image, even, atol=8 * EPS)


def test_what_is_linear_stays_linear():
    for pattern, method in EVERY:
        rows, columns = np.mgrid[:12, :14]
        ramp = np.stack([1 + 0.1 * rows, 3 - 0.2 * columns, 0.05 * rows + 0.1 * columns], axis=-1)
        image = through(ramp, method, with_filters(pattern)).image
        inner = np.s_[2:-2, 2:-2]  # at the border the neighbours are on one side
        np.testing.assert_allclose(image[inner], ramp[inner], atol=16 * EPS)


def test_measured_values_stay():
    for pattern, method in EVERY:
        model = with_filters(pattern)
        raw = develop(pl.Exposure(np.random.default_rng(0).uniform(0, 1, (9, 12, 3))), model)
        measured = np.take_along_axis(raw.demosaic(method).image, raw.channels[:, :, np.newaxis], axis=2)
        np.testing.assert_allclose(measured[:, :, 0], raw.data, atol=4 * EPS)


def test_the_weighted_mean_is_the_bilinear_one_for_bayer_patterns():
    for pattern in list(BayerPattern):
        raw = develop(pl.Exposure(np.random.default_rng(0).uniform(0, 1, (10, 12, 3))), with_filters(pattern))
        one, two = (raw.demosaic(method).image for method in (DemosaicMethod.LINEAR, DemosaicMethod.WEIGHTED_MEAN))
        np.testing.assert_allclose(one[1:-1, 1:-1], two[1:-1, 1:-1], atol=8 * EPS)


def test_a_white_edge_gets_false_colours_there_and_only_there():
    for pattern, method in EVERY:
        for axis in [0, 1]:
            white = np.zeros((16, 20, 3))
            edge = 8
            np.moveaxis(white, axis, 0)[edge:] = 1.0
            colour = np.moveaxis(np.ptp(through(white, method, with_filters(pattern)).image, axis=2), axis, 0)
            near = slice(edge - REACH[method], edge + REACH[method])
            assert colour[near].max() > 0.2, (pattern, method, axis)
            assert np.delete(colour, near, axis=0).max() <= 8 * EPS, (pattern, method, axis)


def test_the_sensor_is_undone_before_interpolation():
    photons = {"photon_rate": (100.0, 200.0, 300.0), "quantum_efficiency": (0.5, 0.6, 0.1), "exposure_time": 3.0}
    model = with_filters(BayerPattern.GRBG, gain=0.25, black_level=50.0, dark_current=9.0, **photons)
    even = np.broadcast_to([0.25, 0.5, 2.0], (6, 6, 3))
    np.testing.assert_allclose(through(even, DemosaicMethod.LINEAR, model).image, even, rtol=16 * EPS)
    balanced = through(even, DemosaicMethod.LINEAR, model, white_balance=(2.0, 1.0, 0.25)).image
    np.testing.assert_allclose(balanced, 0.5, rtol=16 * EPS)


def test_other_patterns_take_weighted_means():
    for filters in [[[0, 1, 2], [1, 2, 0], [2, 0, 1]], np.kron([[0, 1], [1, 2]], np.ones((2, 2), int)), [[0, 1, 1, 2]]]:
        model = with_filters(filters)
        even = np.broadcast_to([0.2, 0.7, 0.4], (9, 13, 3))
        np.testing.assert_allclose(through(even, DemosaicMethod.WEIGHTED_MEAN, model).image, even, atol=8 * EPS)
        for method in (DemosaicMethod.LINEAR, DemosaicMethod.MHC):
            with pytest.raises(InvalidValueError, match="supports Bayer patterns only; use WEIGHTED_MEAN"):
                through(even, method, model)


def test_what_cannot_be_demosaiced_is_refused():
    for rows, method, model, message in (
        (4, DemosaicMethod.WEIGHTED_MEAN, with_filters([[0, 1]]), "none of channel 2 within one period of 1 x 2"),
        (1, DemosaicMethod.WEIGHTED_MEAN, IDEAL, "none of channel 2 within one period"),
        (1, DemosaicMethod.LINEAR, IDEAL, "at least 2 rows and columns"),
        (4, 3, IDEAL, "method is 3; it must be DemosaicMethod.LINEAR"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            through(np.ones((rows, 4, 3)), method, model)
    for factors in (1.0, (1.0, 2.0), (1.0, 0.0, 1.0), (1.0, np.nan, 1.0)):
        with pytest.raises(InvalidValueError, match="it must be three finite factors above 0"):
            through(np.ones((4, 4, 3)), DemosaicMethod.LINEAR, white_balance=factors)


def test_sensors_without_filters_come_back_as_they_are():
    image = np.random.default_rng(0).uniform(0, 1, (4, 5, 3)).astype(np.float32)
    plain = with_filters(None)
    assert np.array_equal(through(image, DemosaicMethod.MHC, plain).image, image)
    assert np.array_equal(through(image[:, :, :1], DemosaicMethod.MHC, plain).image, image[:, :, :1])
    balanced = through(image, DemosaicMethod.MHC, plain, white_balance=(1.0, 2.0, 4.0))
    assert np.array_equal(balanced.image, image * np.float32([1, 2, 4]))
