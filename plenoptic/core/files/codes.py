"""Linear images as whole numbers of 8 or 16 bits."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.percentile import HighPercentile
from plenoptic.core.color.srgb import linear_to_srgb

SHOWN = 99.9
"""Percentile of an image above which pictures to be looked at are cut, so that a highlight does not darken the rest."""
_PART = 1 << 18
"""Numbers at a time: large images take no memory beside."""


def brightest(image: NDArray[np.floating[Any]]) -> float:
    """Value of the largest code where nothing is clipped: the finite maximum, or 1 where it is 0."""
    return float(np.max(image, initial=0.0, where=np.isfinite(image))) or 1.0


def white_point(image: NDArray[np.floating[Any]]) -> float:
    """Value of white in pictures for display: the percentile, the maximum, or 1, whichever is first above 0."""
    level, numbers = HighPercentile(SHOWN, most=image.size), image.reshape(-1)
    for start in range(0, image.size, _PART):
        part = numbers[start : start + _PART]
        level.add(part[np.isfinite(part)])
    return (level.found() if level.added else 0.0) or brightest(image)


def block_means(values: NDArray[Any], block: int) -> NDArray[Any]:
    """Means over blocks of so many pixels along each side, without the rest at the end; nan where one is nan.

    Shape (rows, columns, ...); where a side is shorter than a block, it is one.
    """
    if block == 1:
        return values
    rows, columns = (max(length // block, 1) for length in values.shape[:2])
    high, wide = (min(length, block) for length in values.shape[:2])
    cut = values[: rows * high, : columns * wide].reshape(rows, high, columns, wide, *values.shape[2:])
    return np.asarray(cut.mean(axis=(1, 3), dtype=np.float64))


def codes(image: NDArray[np.floating[Any]], *, scale: float, encoded: bool, bits: int = 16) -> NDArray[Any]:
    """Image over `scale`, encoded as sRGB or linear: nan and negative values become 0, values above 1 are clipped."""
    relative = np.clip(np.nan_to_num(image.astype(np.float64), posinf=np.inf, neginf=0.0) / scale, 0.0, 1.0)
    shown = linear_to_srgb(relative) if encoded else relative
    return np.asarray(np.rint(shown * (2**bits - 1)), dtype=np.uint16 if bits == 16 else np.uint8)
