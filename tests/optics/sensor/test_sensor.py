import math
import pickle

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


def test_impossible_sensors():
    for shape, pitch, message in (
        ((0, 4), 0.01, "rows of the sensor is 0; it must be at least 1"),
        ((4, -2), 0.01, "columns of the sensor is -2; it must be at least 1"),
        ((4, 2.5), 0.01, "columns of the sensor is 2.5; it must be a whole number"),
        ((4,), 0.01, r"shape is \(4,\); it must be \(rows, columns\)"),
        (4, 0.01, r"shape is 4; it must be \(rows, columns\)"),
        ((4, 4), 0.0, "pixel_pitch is 0 mm; it must be above 0"),
        ((4, 4), math.nan, "pixel_pitch is nan; it must be finite"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.Sensor(shape=shape, pixel_pitch=pitch)


def test_a_sensor_is_a_value():
    sensor = pl.Sensor(shape=(np.int64(4), 5), pixel_pitch=1)
    assert sensor == pl.Sensor(shape=[4, 5], pixel_pitch=1.0)
    assert hash(sensor) == hash(pl.Sensor(shape=(4, 5), pixel_pitch=1.0))
    assert sensor != pl.Sensor(shape=(5, 4), pixel_pitch=1.0)
    assert pickle.loads(pickle.dumps(sensor)) == sensor
    assert repr(sensor) == "Sensor(shape=(4, 5), pixel_pitch=1.0)"
    centres = pl.Sensor(shape=(4, 6), pixel_pitch=2.0).centre_of(3, np.arange(2))
    assert centres.tolist() == [[5.0, 3.0], [3.0, 3.0]]
