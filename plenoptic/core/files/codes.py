"""Pictures in files: their channels, linear values of codes, and codes of 8 or 16 bits of linear values."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.percentile import HighPercentile
from plenoptic.core.color.srgb import Encoding, linear_to_srgb, srgb_to_linear
from plenoptic.core.values import whole
from plenoptic.core.warn import warn
from plenoptic.errors import FileError, FileWarning, InvalidValueError

COLOR_SPACE = "oiio:ColorSpace"
"""Key under which OpenImageIO keeps the encoding of a file."""
_PNG, _PNG_ENCODINGS = b"\x89PNG", (b"sRGB", b"gAMA", b"iCCP", b"cICP")
"""First bytes of a PNG file, and its chunks that state an encoding; they stand before the pixels."""
ALPHA = 3
"""Number of the opacity channel."""
DISPLAY_PERCENTILE = 99.9
"""Percentile of an image that is white on displays, so that a highlight does not darken the rest of the image."""
_PART = 1 << 18
"""Numbers that are processed at a time, to bound the memory."""


class ImageHeader(NamedTuple):
    """Header of an image file, read without its pixels."""

    shape: tuple[int, int]
    """Rows and columns."""
    names: list[str]
    """Names of all channels."""
    picture: list[str]
    """Names of the one or three channels of the picture."""
    metadata: dict[str, Any]


def channel_number(channel: int | None) -> int | None:
    """`channel`, or an error if it is not None and no channel of an image."""
    if channel is None or whole(channel, "channel", at_least=0) <= ALPHA:
        return channel
    raise InvalidValueError(f"channel is {channel}; it must be 0, 1, 2 (red, green, blue), 3 (alpha) or None")


def stored_metadata(spec: Any, start: bytes) -> dict[str, Any]:
    """Metadata of OpenImageIO's specification of a file with given first bytes, and of a description in JSON."""
    attributes: dict[str, Any] = {item.name: item.value for item in spec.extra_attribs}
    if start.startswith(_PNG) and not any(name in start for name in _PNG_ENCODINGS):
        attributes.pop(COLOR_SPACE, None)  # the library's assumption
    with suppress(ValueError, RecursionError):  # any other description stays a plain text
        description = json.loads(attributes.get("ImageDescription", ""))
        attributes |= description if isinstance(description, dict) else {}
    return attributes


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


def decode_picture(
    image: NDArray[np.float32],
    metadata: Mapping[str, Any],
    kind: str,
    path: str | os.PathLike[str],
    encoding: Encoding | None = None,
) -> NDArray[np.float32]:
    """Decode a file's picture in place unless it is linear; warn of 16 bits without encoding. `kind`: its numbers."""
    is_linear = kind in ("half", "float", "double") or "lin" in str(metadata.get(COLOR_SPACE)).lower()
    if is_linear or encoding is Encoding.LINEAR:
        return image
    if encoding is None and kind == "uint16" and not {COLOR_SPACE, "ICCProfile"} & metadata.keys():
        warn(
            f"{os.fspath(path)!r} does not state whether its 16 bits are sRGB or linear, and they are decoded as sRGB; "
            "read_linear and the readers of views take encoding=pl.images.Encoding.LINEAR, or SRGB",
            FileWarning,
        )
    for rows in np.array_split(image, max(1, image.size >> 20)):  # bounds the memory of intermediate results
        rows[...] = srgb_to_linear(rows)
    return image


def brightest(image: NDArray[np.floating[Any]]) -> float:
    """Value of the largest code if nothing is clipped: the finite maximum, or 1 if that is 0."""
    return float(np.max(image, initial=0.0, where=np.isfinite(image))) or 1.0


def white_point(image: NDArray[np.floating[Any]]) -> float:
    """Value that is white on displays: the percentile, the maximum, or 1, whichever is first above 0."""
    percentile, numbers = HighPercentile(DISPLAY_PERCENTILE, max_count=image.size), image.reshape(-1)
    for start in range(0, image.size, _PART):
        part = numbers[start : start + _PART]
        percentile.add(part[np.isfinite(part)])
    return (percentile.value() if percentile.count else 0.0) or brightest(image)


def block_means(values: NDArray[Any], block: int) -> NDArray[Any]:
    """Means over blocks of `block` x `block` pixels; incomplete blocks at the end are dropped, nan propagates.

    Shape (rows, columns, ...); a side shorter than a block is one block.
    """
    if block == 1:
        return values
    rows, columns = (max(length // block, 1) for length in values.shape[:2])
    high, wide = (min(length, block) for length in values.shape[:2])
    cut = values[: rows * high, : columns * wide].reshape(rows, high, columns, wide, *values.shape[2:])
    return np.asarray(cut.mean(axis=(1, 3), dtype=np.float64))


def codes(image: NDArray[np.floating[Any]], *, scale: float, encoded: bool, bits: int = 16) -> NDArray[Any]:
    """Codes of image / scale, encoded as sRGB or linear: nan and negative values give 0, values above 1 are clipped."""
    relative = np.clip(np.nan_to_num(image.astype(np.float64), posinf=np.inf, neginf=0.0) / scale, 0.0, 1.0)
    values = linear_to_srgb(relative) if encoded else relative
    return np.asarray(np.rint(values * (2**bits - 1)), dtype=np.uint16 if bits == 16 else np.uint8)
