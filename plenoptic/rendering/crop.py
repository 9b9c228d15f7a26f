"""Crops of the sensor: validation of regions, and texts about regions and sample counts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import whole
from plenoptic.errors import InvalidValueError


def samples_text(counts: NDArray[Any]) -> str:
    """Text on the sample counts of a crop: 64 samples in 40 % of the pixels, 8 to 56 in 35 %, none in 25 %."""
    highest, fewer = int(counts.max()), counts[(counts > 0) & (counts < counts.max())]
    parts = [f"{highest or 'no'} samples in {100 * np.mean(counts == highest):.3g} % of the pixels"]
    if fewer.size:
        low, high = int(fewer.min()), int(fewer.max())
        parts.append(f"{low} to {high}" if low < high else f"{low}")
        parts[-1] += f" in {100 * fewer.size / counts.size:.3g} %"
    if highest and not counts.all():
        parts.append(f"none in {100 * np.mean(counts == 0):.3g} %")
    return ", ".join(parts)


def region_text(region: tuple[int, int, int, int]) -> str:
    """Text on a region: rows 0:4, columns 2:6."""
    first_row, end_row, first_column, end_column = region
    return f"rows {first_row}:{end_row}, columns {first_column}:{end_column}"


def checked_region(region: tuple[int, ...], shape: tuple[int, ...]) -> tuple[int, ...]:
    """First row, end row, first column and end column of an image of this shape; raise InvalidValueError otherwise."""
    if not isinstance(region, tuple | list) or len(region) != 4:
        raise InvalidValueError(f"region is {region!r}; it must be (first row, end row, first column, end column)")
    checked = tuple(whole(number, "region", at_least=0) for number in region)
    first_row, end_row, first_column, end_column = checked
    if (end_row - first_row, end_column - first_column) != shape:
        raise InvalidValueError(
            f"region {checked} has {end_row - first_row} x {end_column - first_column} pixels; "
            f"it must have the image's {shape[0]} x {shape[1]}"
        )
    return checked


def counts_in(plane: NDArray[Any] | None, samples: Any) -> NDArray[Any] | None:
    """Sample counts read from a file, which are rounded beyond 2^24, clipped to the number of samples."""
    return plane if plane is None or not isinstance(samples, int) else np.minimum(plane.astype(np.float64), samples)
