"""Colour filter arrays: the channel that each pixel measures."""

from __future__ import annotations

import enum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import choice, frozen_array
from plenoptic.errors import InvalidValueError

_CHANNELS = {"R": 0, "G": 1, "B": 2}
_LONGEST_PERIOD = 64


class BayerPattern(enum.IntEnum):
    """The four Bayer mosaics, by the first two pixels of row 0, then those of row 1.

    Row 0 and column 0 are those of the image as it is read out, upright, as in all images of this package.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.BayerPattern.RGGB.channels
    array([[0, 1],
           [1, 2]])
    """

    RGGB = 0
    """Red at row 0, column 0."""
    BGGR = 1
    """Blue at row 0, column 0."""
    GRBG = 2
    """Green at row 0, column 0, red beside it."""
    GBRG = 3
    """Green at row 0, column 0, blue beside it."""

    @property
    def channels(self) -> NDArray[np.int64]:
        """(2, 2) channels, 0 red, 1 green, 2 blue."""
        return np.array([_CHANNELS[letter] for letter in self.name]).reshape(2, 2)


Filters: TypeAlias = BayerPattern | NDArray[np.int64]
"""Filters of the pixels: a Bayer pattern, or one period (p, q) of any pattern as channels."""


def as_filters(pattern: Any, name: str) -> Filters:
    """A Bayer pattern, or any periodic pattern as a read-only (p, q) array of channels; otherwise an error."""
    if isinstance(pattern, str | int | np.integer):
        return choice(pattern, BayerPattern, name)
    raw = frozen_array(pattern, name=name, shape=("p", "q"))
    if raw.size == 0 or max(raw.shape) > _LONGEST_PERIOD:
        raise InvalidValueError(
            f"{name} has shape {raw.shape}; it must have from 1 to {_LONGEST_PERIOD} rows and columns"
        )
    if not np.isin(raw, (0, 1, 2)).all():
        raise InvalidValueError(
            f"{name} holds {np.unique(raw).tolist()}; its entries must be channels: 0 red, 1 green, 2 blue"
        )
    return frozen_array(raw, name=name, shape=("p", "q"), dtype=np.int64)


def pattern_of(filters: Filters) -> NDArray[np.int64]:
    """(p, q) channels of one period."""
    return filters.channels if isinstance(filters, BayerPattern) else filters


def channels_of(filters: Filters, shape: tuple[int, int], first: tuple[int, int] = (0, 0)) -> NDArray[np.int64]:
    """Channels of `shape` pixels from the sensor's pixel `first` (row, column) on."""
    pattern = pattern_of(filters)
    rows = (first[0] + np.arange(shape[0])) % pattern.shape[0]
    columns = (first[1] + np.arange(shape[1])) % pattern.shape[1]
    return np.asarray(pattern[np.ix_(rows, columns)])


def bayer_from(filters: Filters, first: tuple[int, int]) -> BayerPattern | None:
    """The Bayer pattern that begins at the pixel `first`; None if the filters are no Bayer pattern."""
    begins = channels_of(filters, (2, 2), first)
    period = pattern_of(filters).shape
    if not np.array_equal(channels_of(filters, (2 * period[0], 2 * period[1]), first), np.tile(begins, period)):
        return None
    return next((pattern for pattern in BayerPattern if np.array_equal(pattern.channels, begins)), None)
