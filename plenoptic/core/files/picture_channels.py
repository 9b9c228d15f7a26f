"""The channels of an image file: which of them are its picture, each by itself, linear."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.srgb import srgb_to_linear
from plenoptic.errors import FileError


class ImageHead(NamedTuple):
    """Header of an image file, known before its pixels are read."""

    shape: tuple[int, int]
    """Rows and columns."""
    names: list[str]
    """Of all channels."""
    picture: list[str]
    """Those of them that are the picture: one or three."""
    metadata: dict[str, Any]


def picture_names(names: list[str], path: str | os.PathLike[str]) -> list[str]:
    """Names of a file's channels that are its picture: R, G, B, or Y, or the only one."""
    wanted = next((found for found in (["R", "G", "B"], ["Y"]) if set(found) <= set(names)), None)
    if wanted is None:
        wanted = [name for name in names if name != "A"]
        if len(wanted) != 1:
            raise FileError(
                f"{os.fspath(path)!r} holds the channels {', '.join(names)}; a picture needs R, G, B, or Y, "
                "or a single channel"
            )
    return wanted


def picture_of(pixels: NDArray[np.float32], names: list[str], path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """The (H, W, 3) or (H, W, 1) picture among the channels of a file.

    The pixels themselves where they are nothing else.
    """
    wanted = picture_names(names, path)
    return pixels if names == wanted else np.take(pixels, [names.index(name) for name in wanted], axis=2)


def each_channel(pixels: NDArray[np.float32], names: list[str]) -> dict[str, NDArray[np.float32]]:
    """Each channel of an image by itself, so that it outlives the others."""
    return {name: pixels[:, :, i].copy() for i, name in enumerate(names)}


def made_linear(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same image, from sRGB in place."""
    for rows in np.array_split(image, max(1, image.size >> 20)):  # what is made on the way stays small
        rows[...] = srgb_to_linear(rows)
    return image
