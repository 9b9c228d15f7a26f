"""Checks that images over surfaces and images of the world share."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import frozen_array
from plenoptic.errors import InvalidValueError, SceneError


def as_texels(texels: ArrayLike, owner: type, *, most: int, from_codes: str) -> NDArray[np.float32]:
    """(rows, columns, 1 or 3), read-only, finite and 0 or more; `from_codes` is what takes codes of image files."""
    if isinstance(texels, str | PathLike):
        raise InvalidValueError(f"texels are {texels!r}; use {owner.__name__}.load for files")
    if isinstance(texels, np.ndarray):
        if texels.dtype.kind in "iub":
            raise InvalidValueError(f"texels are {texels.dtype}; they must be linear floats, or use {from_codes}")
        check_size(texels.shape, "texels", most)  # before they are copied
    with np.errstate(over="ignore"):
        kept = frozen_array(texels, name="texels", shape=("rows", "columns", "channels"), dtype=np.float32)
    if kept.shape[2] not in (1, 3):
        raise InvalidValueError(f"texels has {kept.shape[2]} channels; it must have 1 or 3 (drop alpha)")
    check_size(kept.shape, "texels", most)
    # min and max hand NaN on, so two passes without temporaries see everything.
    low, high = float(kept.min()), float(kept.max())
    if not (low >= 0 and high < np.inf):
        raise SceneError(f"texels lie between {low:g} and {high:g}; they must be finite and 0 or more, so clip them")
    return kept


def check_size(shape: tuple[int, ...], name: str, most: int) -> None:
    """Refuse an image without texels, and one that is too large."""
    if len(shape) >= 2 and not 0 < shape[0] * shape[1] <= most:
        raise SceneError(
            f"{name} has {shape[0]} x {shape[1]} texels; it must have at least 1 row and 1 column of them, and at most "
            f"{most}, so scale it down"
        )


def equal_channels(texels: NDArray[Any]) -> bool:
    """Whether all channels of an image are equal."""
    first = texels[..., 0]
    return all(np.array_equal(first, texels[..., k]) for k in range(1, texels.shape[2]))
