"""Tiles: all of a region once, in an order that covers it early."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.tiling import _cuts, cut_into_tiles

ONE = Budget(1, None, None, 1)


@given(first=st.integers(0, 100), length=st.integers(1, 300), side=st.integers(2, 64), least=st.integers(1, 2))
def test_tiles_cover_all_once_and_none_is_a_single_pixel(first: int, length: int, side: int, least: int):
    cuts = _cuts(first, first + length, side, least)
    steps = np.diff(cuts)
    assert cuts[0] == first and cuts[-1] == first + length
    assert steps.min() >= min(least, length) and steps.max() <= side + least - 1


@settings(max_examples=40)
@given(
    row=st.integers(0, 50),
    column=st.integers(0, 50),
    shape=st.tuples(*2 * [st.integers(1, 70)]),
    side=st.integers(1, 9),
)
def test_tiles_in_their_order_are_all_of_a_region(row: int, column: int, shape: tuple[int, int], side: int):
    rows, columns = shape
    _, tiles = cut_into_tiles((row, row + rows, column, column + columns), ONE, side, 1.0)
    times = np.zeros((row + rows, column + columns), dtype=int)
    for tile in tiles:
        times[tile.row : tile.row + tile.rows, tile.column : tile.column + tile.columns] += 1
    assert times.sum() == rows * columns and np.all(times[row:, column:] == 1)


@settings(max_examples=40)
@given(rows=st.integers(1, 24), columns=st.integers(1, 24), side=st.integers(1, 3))
def test_the_first_tiles_of_any_number_cover_the_region(rows: int, columns: int, side: int):
    # Tiles whose row and column are multiples of s, a power of 2, come before all others: ceil(R / s) ceil(C / s) of
    # them. So the first k have all of these for the smallest s where that is k or less, and no tile is further than
    # s - 1 from one of them. With s / 2 they are more than k, and ceil(2 R / s) <= 4 R / s where s / 2 <= R: k is
    # below 16 R C / s^2, or, where s / 2 is larger than the shorter side, below 4 / s times the longer one.
    _, tiles = cut_into_tiles((0, rows * side, 0, columns * side), ONE, side, 1.0)
    assert len(tiles) == rows * columns
    down, across = np.indices((rows, columns))
    distance = np.full((rows, columns), 1000)
    for k, tile in enumerate(tiles, 1):
        there = np.maximum(abs(down - tile.row // side), abs(across - tile.column // side))
        distance = np.minimum(distance, there)
        assert distance.max() < max(4 * np.sqrt(rows * columns / k), 4 * max(rows, columns) / k)


def test_the_first_tiles_of_a_square_are_a_coarser_square():
    _, tiles = cut_into_tiles((0, 64, 0, 64), ONE, 4, 1.0)
    for level in range(5):
        apart = 64 >> level
        assert {(tile.row, tile.column) for tile in tiles[: 4**level]} == {
            (row, column) for row in range(0, 64, apart) for column in range(0, 64, apart)
        }
