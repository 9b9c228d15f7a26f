"""Division of a region of the sensor into tiles."""

from __future__ import annotations

import math
from itertools import pairwise

from plenoptic.core.values import whole
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.tile import Tile

PATHS_PER_TILE = 1 << 17
_SMALLEST_SIDE, _LARGEST_SIDE = 16, 256
_DIFFRACTION_FACTOR = 4
"""Factor for the paths of a tile, and minimum pixels, with diffraction: a tile also renders the pixels around it."""
_MAX_REPLICATES = 1 << 16
"""Replicates times pixels of a tile with diffraction: about 40 MB of sums for three channels."""
_TIMED_SIDE, _DECIDING_SIDE, _MIN_DECIDING_SIDE = 32, 64, 2
"""Side of tiles under a time limit, side of tiles with a target error (more pixels give a more reliable decision), and
the minimum side of the latter.
"""
_FIRST_PATHS = 1 << 15
"""Paths of a tile with one sample of each replicate, if samples are added step by step."""
_MAX_BITS = 20
"""Bits of the number of tiles along a side."""
_CELLS_PER_TILE = 1 << 18
"""Microlenses that illuminate the pixels of a tile, summed over pixels: about 70 MB of triangles."""


def cut_into_tiles(
    region: tuple[int, int, int, int], budget: Budget, side: int | None, cells: float, *, shared: bool = False
) -> tuple[int, list[Tile]]:
    """Side of the tiles, and the tiles of a region in rendering order; see `render` for `side`.

    `cells`, the microlenses that illuminate a pixel, limit the size of a tile. `shared` is True with diffraction.
    """
    min_side = 1 if budget.target_error is None else _MIN_DECIDING_SIDE
    requested_side = _chosen_side(budget, shared=shared) if side is None else whole(side, "tile_side", at_least=1)
    if requested_side < min_side:
        raise InvalidValueError(
            f"tile_side is {requested_side}; with a target_error it must be at least {min_side}, since pixels decide "
            "for each other"
        )
    first_row, end_row, first_column, end_column = region
    if budget.target_error is not None and (end_row - first_row) * (end_column - first_column) == 1:
        raise InvalidValueError(
            "the region is a single pixel, and with a target_error pixels decide for each other; take two, or give "
            "samples"
        )
    actual_side = max(min_side, min(requested_side, int(math.sqrt(_CELLS_PER_TILE / cells))))
    rows, columns = (
        _cuts(first_row, end_row, actual_side, min_side),
        _cuts(first_column, end_column, actual_side, min_side),
    )
    tiles = {
        (i, j): Tile(row, column, next_row - row, next_column - column)
        for i, (row, next_row) in enumerate(pairwise(rows))
        for j, (column, next_column) in enumerate(pairwise(columns))
    }
    return actual_side, [tiles[index] for index in sorted(tiles, key=_rendering_order)]


def _rendering_order(index: tuple[int, int]) -> int:
    """Position of a tile in the rendering order, in which any first tiles are spread over the whole region.

    It interleaves the bits of the tile's row and column, lowest first: the radical inverse of both.
    """
    position = 0
    for bit in range(_MAX_BITS):
        for number in index:
            position = position << 1 | number >> bit & 1
    return position


def _chosen_side(budget: Budget, *, shared: bool) -> int:
    if budget.steps:
        side = int(math.sqrt(_FIRST_PATHS / budget.replicates))
        smallest, largest = (1, _TIMED_SIDE) if budget.target_error is None else (_MIN_DECIDING_SIDE, _DECIDING_SIDE)
        return max(smallest, min(largest if budget.time_limit is None else _TIMED_SIDE, side))
    samples = budget.following(0)
    if shared:
        pixels = min(_DIFFRACTION_FACTOR * PATHS_PER_TILE / samples, _MAX_REPLICATES / min(samples, budget.replicates))
        return min(max(int(math.sqrt(pixels)), 2 * _SMALLEST_SIDE), _LARGEST_SIDE)
    return min(max(int(math.sqrt(PATHS_PER_TILE / samples)), _SMALLEST_SIDE), _LARGEST_SIDE)


def _cuts(first: int, end: int, side: int, min_side: int) -> list[int]:
    """Tile boundaries; a remainder below `min_side` is added to the last tile."""
    cuts = [*range(first, end, side), end]
    if len(cuts) > 2 and end - cuts[-2] < min_side:
        del cuts[-2]
    return cuts
