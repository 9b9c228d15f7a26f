"""Pictures in files: their channels, linear values of codes, and codes of 8 or 16 bits of linear values."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
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
    bits: int | None
    """Bits of its integers, 8 or 16; None for other numbers."""


def whole_numbers(channels: Iterable[NDArray[np.float32]], bits: int) -> NDArray[np.uint16]:
    """Numbers (H, W, C) of a file of 8 or 16 bits, from channels that are scaled to 0..1."""
    # float32 holds k / 65535 to 2^-25, so that the rounded product is k again.
    numbers = np.stack(list(channels), axis=-1).astype(np.float64) * (2**bits - 1)
    return np.asarray(np.rint(numbers), dtype=np.uint16)


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
    """Names of the channels of a file that are its picture, in upper or lower case.

    R, G, B, or Y, without a layer; else R, G, B of the only layer that has them ("diffuse.R"); else the only channel.
    """
    layers: dict[str, dict[str, str]] = {}
    for name in sorted(names, reverse=True):  # lower case first: capitals replace it
        layer, _, channel = name.rpartition(".")
        layers.setdefault(layer, {})[channel.upper()] = name
    plain = layers.get("", {})
    pictures = {layer: [of[c] for c in "RGB"] for layer, of in layers.items() if {"R", "G", "B"} <= of.keys()}
    if "" in pictures:
        return pictures[""]
    if "Y" in plain and not {"X", "RY"} & plain.keys():  # XYZ or luminance and chrominance are no grey pictures
        return [plain["Y"]]
    single = [name for name in names if name.upper() != "A"]
    if len(pictures) > 1:
        raise FileError(
            f"{os.fspath(path)!r} holds pictures in the layers {', '.join(sorted(pictures))}; keep one, or take its "
            "channels from read_channels"
        )
    if not pictures and len(single) != 1:
        raise FileError(
            f"{os.fspath(path)!r} holds the channels {', '.join(names)}; a picture needs R, G, B, or Y, "
            "or a single channel"
        )
    return next(iter(pictures.values()), single)


def file_parts(source: Any) -> Iterator[tuple[str, list[str]]]:
    """Names of the parts of a file that OpenImageIO reads, and of their channels; deep parts have none here."""
    number = 0
    while source.seek_subimage(number, 0):
        spec, number = source.spec(), number + 1
        yield str(spec.get_string_attribute("oiio:subimagename")), [] if spec.deep else list(spec.channelnames)
    source.geterror()  # that there is no further part


def picture_part(parts: list[tuple[str, list[str]]], path: str | os.PathLike[str]) -> int:
    """Number of the first part of an EXR file, by names and channels, that has R, G, B in a layer, or Y.

    A warning names the parts of which one is read.
    """
    if len(parts) == 1:
        return 0
    listed = ", ".join(f"{name or number} ({', '.join(names)})" for number, (name, names) in enumerate(parts))
    for number, (name, names) in enumerate(parts):
        layers, channels = ({channel.upper().rpartition(".")[at] for channel in names} for at in (0, 2))
        if {"R", "G", "B"} <= channels or ("" in layers and "Y" in channels and not channels & {"X", "RY"}):
            warn(f"{os.fspath(path)!r} has the parts {listed}; only {name or number} is read", FileWarning)
            return number
    raise FileError(f"{os.fspath(path)!r} has the parts {listed}; one needs R, G, B, or Y: write it to a file alone")


def alpha_name(names: list[str], path: str | os.PathLike[str]) -> str | None:
    """Name of the opacity channel of a file, in the layer of its picture; None if it has none."""
    layer, dot, _ = ("", "", "") if "A" in names else picture_names(names, path)[0].rpartition(".")
    return next((name for name in (f"{layer}{dot}A", f"{layer}{dot}a") if name in names), None)


def picture_shape(spec: Any, file_format: str) -> tuple[int, int]:
    """Rows and columns of the picture of OpenImageIO's specification: of EXR files, those of the display window."""
    return (spec.full_height, spec.full_width) if file_format == "openexr" else (spec.height, spec.width)


def arrange_pixels(
    pixels: NDArray[np.float32], spec: Any, file_format: str, path: str | os.PathLike[str]
) -> NDArray[np.float32]:
    """The picture of all pixels in a file, row 0 at the top.

    An EXR file's display window is its picture; it is 0 where the file has no data, and data beyond it are dropped.
    Rows and columns of a Radiance file (.hdr) may be stored backwards.
    """
    if file_format == "hdr":
        orientation = spec.get_int_attribute("Orientation", 1)
        if orientation > 4:
            raise FileError(f"{os.fspath(path)!r} stores columns in place of rows; save it again")
        return np.ascontiguousarray(
            pixels[:: -1 if orientation in (3, 4) else 1, :: -1 if orientation in (2, 3) else 1]
        )
    rows, columns = picture_shape(spec, file_format)
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    if file_format != "openexr" or (top, left, spec.height, spec.width) == (0, 0, rows, columns):
        return pixels
    picture = np.zeros((rows, columns, spec.nchannels), dtype=np.float32)
    shown = pixels[max(-top, 0) : max(rows - top, 0), max(-left, 0) : max(columns - left, 0)]
    top, left = max(top, 0), max(left, 0)
    picture[top : top + shown.shape[0], left : left + shown.shape[1]] = shown
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
    """Decode a file's picture in place unless it is linear. `kind` is the type of the file's numbers.

    An encoding that is given counts, whatever the file states: a gAMA chunk of 1.0, an ICC profile, or the text of
    `write_16bit`; glTF demands this too. None: linear if the file says so, else sRGB, with a warning for 16 bits
    without a statement.
    """
    states_linear = "lin" in str(metadata.get(COLOR_SPACE)).lower()
    is_linear = states_linear if encoding is None else encoding is Encoding.LINEAR
    if is_linear or kind in ("half", "float", "double"):
        return image
    if states_linear:
        warn(
            f"{os.fspath(path)!r} states that its codes are linear, and they are decoded as sRGB, as asked for; if "
            "they are data, give encoding=pl.images.Encoding.LINEAR",
            FileWarning,
        )
    elif encoding is None and kind == "uint16" and not {COLOR_SPACE, "ICCProfile"} & metadata.keys():
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
