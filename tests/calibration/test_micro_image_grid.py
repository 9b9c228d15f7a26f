"""Grids of micro images: positions and indices are inverse to each other."""

import math
import pickle

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError


def grid_of(lattice=pl.Lattice.HEXAGONAL, basis=((0.3, -20.0), (17.2, -9.8)), **fields):
    return pl.calibration.MicroImageGrid(lattice, origin=(80.2, 101.3), basis=basis, shape=(160, 200), **fields)


def bent():
    series = np.zeros((4, 4, 2))
    series[2, 0], series[1, 2], series[0, 3] = (0.8, -0.5), (0.3, 0.6), (-0.4, 0.2)
    return grid_of(deviation=series)


def test_indices_are_those_of_the_nearest_centres():
    points = np.random.default_rng(2).uniform((-5, -5), (165, 205), (300, 2))
    for grid in (grid_of(), bent(), grid_of(pl.Lattice.RECTANGULAR, ((1.0, -20.0), (24.0, 1.2)))):
        index = grid.on_sensor
        np.testing.assert_array_equal(grid.indices_of(grid.centres_of(index)), index)
        around = np.stack(np.meshgrid(*[np.arange(-20, 21)] * 2), axis=-1).reshape(-1, 2)
        distance = np.linalg.norm(points[:, None] - grid.centres_of(around), axis=-1)
        nearest = np.sort(distance, axis=1)
        # Where two are as near, to the change of the deviation over a cell, either may be the answer.
        is_clear = nearest[:, 1] - nearest[:, 0] > 1.0
        assert is_clear.mean() > 0.8
        np.testing.assert_array_equal(grid.indices_of(points)[is_clear], around[distance.argmin(axis=1)][is_clear])


def test_all_micro_images_on_the_sensor_are_listed():
    for grid in (grid_of(), bent()):
        around = np.stack(np.meshgrid(*[np.arange(-30, 31)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
        row, column = grid.centres_of(around).T
        expected = around[(row >= -0.5) & (row <= 159.5) & (column >= -0.5) & (column <= 199.5)]
        np.testing.assert_array_equal(grid.on_sensor, expected)


def test_rotation_is_the_least_angle_from_rows_or_columns():
    for lattice, rows, columns in (
        (pl.Lattice.HEXAGONAL, [(0.0, -1.0), (math.sqrt(0.75), -0.5)], [(0.5, -math.sqrt(0.75)), (1.0, 0.0)]),
        (pl.Lattice.RECTANGULAR, [(0.0, -1.0), (1.3, 0.0)], None),
    ):
        for angle in (-0.2, 0.0, 0.07, 0.25):
            turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
            for basis, along_rows in ((rows, True), (columns, False)):
                if basis is not None:
                    grid = grid_of(lattice, 20.0 * np.array(basis) @ turn)
                    assert grid.rotation == pytest.approx(angle, abs=1e-12) and grid.is_along_rows is along_rows


def test_types_repeat():
    grid = grid_of(type_pattern=[[0, 1, 2], [2, 0, 1], [1, 2, 0]])
    index = np.array([(0, 0), (1, 0), (-1, 0), (4, 3), (0, -1)])
    np.testing.assert_array_equal(grid.types_of(index), (index[:, 1] - index[:, 0]) % 3)


def test_grids_are_values():
    grid = bent()
    assert pickle.loads(pickle.dumps(grid)) == grid == bent() != grid_of()


def test_impossible_grids_are_refused():
    steep = np.zeros((2, 3, 2))
    steep[0, 2] = 30.0
    for fields, reason in (
        ({"lattice": pl.Lattice.FREE}, "FREE"),
        ({"basis": ((0.0, -20.0), (0.1, -40.0))}, "different directions"),
        ({"basis": ((17.2, -9.8), (0.3, -20.0))}, "mirrored"),
        ({"basis": ((0.3, -20.0), (17.2, 10.2))}, "60 degrees"),
        ({"centre": [(1.0, 2.0)]}, "without index"),
        ({"index": [(0, 0)], "radius": [1.0, 2.0]}, "radius has shape"),
        ({"deviation": steep}, "half a pixel"),
    ):
        with pytest.raises(InvalidValueError, match=reason):
            grid_of(**fields)
