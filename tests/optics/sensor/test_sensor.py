import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl

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


def test_impossible_sensors():
    for shape, pitch, message in (
        ((0, 4), 0.01, "rows of the sensor is 0; it must be at least 1"),
        ((4, -2), 0.01, "columns of the sensor is -2; it must be at least 1"),
        ((4, 2.5), 0.01, "columns of the sensor is 2.5; it must be a whole number"),
        ((4, 4), 0.0, "pixel_pitch is 0 mm; it must be above 0"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.Sensor(shape=shape, pixel_pitch=pitch)
