"""Tiles of the sensor for jobs on several machines, such as the third of 16."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Collection
from typing import TYPE_CHECKING, NamedTuple

from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.core.files.zarr_files import Region

_MORE = 8
"""Numbers of tiles are tried up to this times the number of regions."""


class SensorPart(NamedTuple):
    """The k-th of n tiles of the sensor, counted from 1."""

    k: int
    n: int


def parse_tile(text: str) -> SensorPart:
    """Part of the sensor from a text such as 3/16, for argparse."""
    numbers = re.fullmatch(r"(\d+)/(\d+)", text)
    if numbers is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no part of the sensor; give one such as 3/16, the third of 16")
    tile = SensorPart(*map(int, numbers.groups()))
    if not 1 <= tile.k <= tile.n:
        raise argparse.ArgumentTypeError(f"{text!r} is no part of {tile.n}; they are counted from 1/{tile.n}")
    return tile


def tile_region(shape: tuple[int, int], tile: SensorPart) -> tuple[slice, slice]:
    """Rows and columns of a tile."""
    from plenoptic.camera.checks import BLOCK, sensor_tiles

    grid = tile_grid(shape, tile.n)
    if grid is None:
        raise InvalidValueError(
            f"--tile is {tile.k}/{tile.n}, and a sensor of {shape[0]} x {shape[1]} pixels cannot be cut into {tile.n} "
            f"equal rows and columns of whole {BLOCK} x {BLOCK} blocks; give another number, such as 16, 60 or 64"
        )
    return sensor_tiles(shape, *grid)[tile.k - 1]


def tile_grid(shape: tuple[int, int], n: int) -> tuple[int, int] | None:
    """Numbers of rows and columns of n tiles, as square as can be; None if there are too few pixels for n."""
    from plenoptic.camera.checks import BLOCK

    high, wide = (-(-length // BLOCK) for length in shape)
    pairs = [(rows, n // rows) for rows in range(1, min(n, high) + 1) if n % rows == 0 and n // rows <= wide]
    return min(pairs, key=lambda pair: abs(math.log(shape[0] * pair[1] / (shape[1] * pair[0]))), default=None)


def missing_tiles(shape: tuple[int, int], regions: Collection[Region]) -> list[SensorPart]:
    """Tiles that complete the regions, if the regions are tiles of a common number; otherwise none."""
    from plenoptic.camera.checks import sensor_tiles

    rendered = set(regions)
    for n in range(len(rendered) + 1, _MORE * len(rendered) + 2):
        if (grid := tile_grid(shape, n)) is not None:
            tiles = [(row.start, row.stop, column.start, column.stop) for row, column in sensor_tiles(shape, *grid)]
            if rendered <= set(tiles):
                return [SensorPart(k, n) for k, tile in enumerate(tiles, start=1) if tile not in rendered]
    return []
