"""Cutting a region of the sensor into tiles."""

from __future__ import annotations

import math
from itertools import pairwise

from plenoptic.core.values import whole
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.tile import Tile

PATHS_PER_TILE = 1 << 17
_SMALLEST_SIDE, _LARGEST_SIDE = 16, 256
_SHARING = 4
"""Times as many paths, and pixels at least, where pixels share light with those beside them, which a tile renders too.
"""
_SHARED = 1 << 16
"""Replicates of all pixels of such a tile: some 40 MB of sums of three channels."""
_GROWING_SIDE, _DECIDING_SIDE, _FEWEST = 32, 64, 2
"""Side of tiles that grow until time is over, of those that end by themselves (the more pixels decide, the better they
agree), and the least that these may have."""
_FIRST_PATHS = 1 << 15
"""Paths of a tile with one sample of each replicate, where tiles grow step by step."""
_MOST_BITS = 20
"""Of the number of tiles along a side."""
_CELLS_PER_TILE = 1 << 18
"""Microlenses that feed the pixels of a tile, all pixels together: some 70 MB of triangles."""


def cut_into_tiles(
    region: tuple[int, int, int, int], budget: Budget, side: int | None, cells: float, *, shared: bool = False
) -> tuple[int, list[Tile]]:
    """The side of tiles, and those of a region of rows and columns in their order; see `render` for `side`.

    Tiles have no more pixels than `cells`, the microlenses that feed a pixel, leave room for. `shared`: whether pixels
    share light.
    """
    least = 1 if budget.target_error is None else _FEWEST
    wanted = _chosen_side(budget, shared=shared) if side is None else whole(side, "tile_side", at_least=1)
    if wanted < least:
        raise InvalidValueError(
            f"tile_side is {wanted}; with a target_error it must be at least {least}, since pixels decide for each "
            "other"
        )
    first_row, end_row, first_column, end_column = region
    if budget.target_error is not None and (end_row - first_row) * (end_column - first_column) == 1:
        raise InvalidValueError(
            "the region is a single pixel, and with a target_error pixels decide for each other; take two, or give "
            "samples"
        )
    fitting = max(least, min(wanted, int(math.sqrt(_CELLS_PER_TILE / cells))))
    rows, columns = _cuts(first_row, end_row, fitting, least), _cuts(first_column, end_column, fitting, least)
    tiles = {
        (i, j): Tile(row, column, next_row - row, next_column - column)
        for i, (row, next_row) in enumerate(pairwise(rows))
        for j, (column, next_column) in enumerate(pairwise(columns))
    }
    return fitting, [tiles[place] for place in sorted(tiles, key=_turn)]


def _turn(place: tuple[int, int]) -> int:
    """Rank of a tile, such that the first n tiles are spread over the whole region for every n.

    The bits of its row and column among the tiles, alternately, the lowest first: the radical inverse of both.
    """
    turn = 0
    for bit in range(_MOST_BITS):
        for number in place:
            turn = turn << 1 | number >> bit & 1
    return turn


def _chosen_side(budget: Budget, *, shared: bool) -> int:
    if budget.steps:
        side = int(math.sqrt(_FIRST_PATHS / budget.replicates))
        least, most = (1, _GROWING_SIDE) if budget.target_error is None else (_FEWEST, _DECIDING_SIDE)
        return max(least, min(most if budget.time_limit is None else _GROWING_SIDE, side))
    samples = budget.following(0)
    if shared:
        pixels = min(_SHARING * PATHS_PER_TILE / samples, _SHARED / min(samples, budget.replicates))
        return min(max(int(math.sqrt(pixels)), 2 * _SMALLEST_SIDE), _LARGEST_SIDE)
    return min(max(int(math.sqrt(PATHS_PER_TILE / samples)), _SMALLEST_SIDE), _LARGEST_SIDE)


def _cuts(first: int, end: int, side: int, least: int) -> list[int]:
    """Borders of tiles along one axis; a remainder below `least` belongs to the tile before it."""
    cuts = [*range(first, end, side), end]
    if len(cuts) > 2 and end - cuts[-2] < least:
        del cuts[-2]
    return cuts
