"""Regions of a sensor: their union, overlaps and gaps."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from plenoptic.errors import InvalidValueError
from plenoptic.rendering.crop import region_text

Region = tuple[int, int, int, int]
"""First row, end row, first column, end column on the sensor."""
_NAMED = 8
"""Missing regions listed in an error."""


def bounds(parts: Mapping[Region, str]) -> Region:
    """Rectangle that regions of named parts fill; raises InvalidValueError if they overlap or leave pixels out."""
    low, high = np.min([*parts], axis=0), np.max([*parts], axis=0)
    whole = int(low[0]), int(high[1]), int(low[2]), int(high[3])
    rows, columns, covered = _coverage(parts)
    if (covered > 1).any():
        i, j = np.argwhere(covered > 1)[0]
        row, column = rows[i], columns[j]
        both = [
            f"{name} ({region_text(region)})"
            for region, name in parts.items()
            if region[0] <= row < region[1] and region[2] <= column < region[3]
        ]
        raise InvalidValueError(
            f"{both[0]} and {both[1]} overlap; regions of parts must be the same or lie beside each other"
        )
    if missing := missing_regions(whole, parts):
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        listed = "; ".join(region_text(region) for region in missing[:_NAMED])
        raise InvalidValueError(f"parts of {region_text(whole)} leave {listed}{more} out; give the missing ones")
    return whole


def missing_regions(whole: Region, regions: Collection[Region]) -> list[Region]:
    """Rectangles of a whole that regions do not cover."""
    rows, columns, covered = _coverage([whole, *regions])
    missing: list[Region] = []
    for i, (row, end_row) in enumerate(pairwise(rows.tolist())):
        inside = (columns[:-1] >= whole[2]) & (columns[1:] <= whole[3]) & (whole[0] <= row < whole[1])
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside & (covered[i] == 1), [False]])))
        for first, end in edges.reshape(-1, 2):
            columns_of_gap = int(columns[first]), int(columns[end])
            above = next((region for region in missing if region[1] == row and region[2:] == columns_of_gap), None)
            if above is not None:
                missing.remove(above)
            missing.append((row if above is None else above[0], end_row, *columns_of_gap))
    return missing


def _coverage(regions: Collection[Region]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the region boundaries, and the number of regions that cover each cell between them."""
    cuts = np.array(list(regions))
    rows, columns = np.unique(cuts[:, :2]), np.unique(cuts[:, 2:])
    counts = np.zeros((rows.size - 1, columns.size - 1), dtype=np.int64)
    at_rows, at_columns = np.searchsorted(rows, cuts[:, :2]), np.searchsorted(columns, cuts[:, 2:])
    for (first_row, end_row), (first_column, end_column) in zip(at_rows, at_columns, strict=True):
        counts[first_row:end_row, first_column:end_column] += 1
    return rows, columns, counts
