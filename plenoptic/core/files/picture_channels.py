"""Channels of an image file: selection of the picture among them, and linearisation."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.srgb import srgb_to_linear
from plenoptic.errors import FileError


class ImageHeader(NamedTuple):
    """Header of an image file, read without its pixels."""

    shape: tuple[int, int]
    """Rows and columns."""
    names: list[str]
    """Names of all channels."""
    picture: list[str]
    """Names of the one or three channels of the picture."""
    metadata: dict[str, Any]


def picture_names(names: list[str], path: str | os.PathLike[str]) -> list[str]:
    """Names of the channels of a file that are its picture: R, G, B, or Y, or the only one."""
    picture = next((channels for channels in (["R", "G", "B"], ["Y"]) if set(channels) <= set(names)), None)
    if picture is None:
        picture = [name for name in names if name != "A"]
        if len(picture) != 1:
            raise FileError(
                f"{os.fspath(path)!r} holds the channels {', '.join(names)}; a picture needs R, G, B, or Y, "
                "or a single channel"
            )
    return picture


def picture_of(pixels: NDArray[np.float32], names: list[str], path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """The (H, W, 3) or (H, W, 1) picture among the channels of a file.

    The same array if the file has no other channels.
    """
    picture = picture_names(names, path)
    return pixels if names == picture else np.take(pixels, [names.index(name) for name in picture], axis=2)


def each_channel(pixels: NDArray[np.float32], names: list[str]) -> dict[str, NDArray[np.float32]]:
    """Copies of the channels of an image by name, each in memory of its own."""
    return {name: pixels[:, :, i].copy() for i, name in enumerate(names)}


def linearize(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Decode an sRGB image in place."""
    for rows in np.array_split(image, max(1, image.size >> 20)):  # bounds the memory of intermediate results
        rows[...] = srgb_to_linear(rows)
    return image
