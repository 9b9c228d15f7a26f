"""Raw images of Lytro cameras: containers (.lfp, .lfr), and the raw data (.raw) of white images beside their text."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import translate_errors
from plenoptic.core.files.file_limits import FileLimits, check_file, check_memory
from plenoptic.errors import FileError
from plenoptic.optics.sensor.color_filter import BayerPattern

_MAGIC = b"\x89LFP\r\n\x1a\n"
_SECTIONS = b"\x89LFM\r\n\x1a\n", b"\x89LFC\r\n\x1a\n"
"""Marks of the table of contents, and of all other sections."""
_HEADER, _LENGTH, _ALIGNMENT = 96, slice(12, 16), 16
"""Bytes before the data of a section (mark, version, length, SHA-1 as text); sections begin at multiples of 16."""
_PATTERNS = {"r": BayerPattern.RGGB, "gr": BayerPattern.GRBG, "gb": BayerPattern.GBRG, "b": BayerPattern.BGGR}
_PACKINGS = {(12, "big"): (3, 2), (10, "little"): (5, 4), (16, "little"): (2, 1), (16, "big"): (2, 1)}
"""Bytes and pixels of a group, by bits and byte order."""


class LytroImage(NamedTuple):
    """Raw data of a Lytro file and its description."""

    data: NDArray[np.uint16]
    bits: int
    black: float
    white: float
    colour_filters: BayerPattern
    metadata: dict[str, Any]
    """All members of the file's texts (JSON), of the camera, its lens, its microlenses and its exposure."""


def read_lytro_image(path: Path, limits: FileLimits) -> LytroImage:
    """Read a container, or raw data whose text has the same name and ends in .txt; FileError if it is neither."""
    size = check_file(path, limits)
    with translate_errors(path, "read"):
        content = path.read_bytes()
    if content.startswith(_MAGIC):
        sections = list(_sections(content, path))
    else:
        text_files = [file for ending in (".TXT", ".txt") if (file := path.with_suffix(ending)).exists()]
        if not text_files:
            raise FileError(f"{str(path)!r} is no Lytro container, and has no text of its camera (.TXT) beside it")
        check_file(text_files[0], limits)
        sections = [content, text_files[0].read_bytes()]
    texts = [text for section in sections if (text := _text(section)) is not None]
    for text in texts:
        if (image := _description(text)) is not None:
            metadata = {name: member for each in texts for name, member in each.items()}
            return _image(image, sections, (path, size, limits), metadata)
    raise FileError(f"{str(path)!r} describes no raw image; processed files (-stk.lfp) and previews have none")


def _sections(content: bytes, path: Path) -> Iterator[bytes]:
    """Data of the sections of a container."""
    start = _ALIGNMENT
    while start + _HEADER <= len(content):
        header = content[start : start + _HEADER]
        length = int.from_bytes(header[_LENGTH], "big")
        if not header.startswith(_SECTIONS) or start + _HEADER + length > len(content):
            raise FileError(f"{str(path)!r} is damaged at byte {start}; copy it again from the camera")
        yield content[start + _HEADER : start + _HEADER + length]
        start += -(-(_HEADER + length) // _ALIGNMENT) * _ALIGNMENT


def _text(section: bytes) -> dict[str, Any] | None:
    """The members of a section in JSON; None if it is something else."""
    if not section.lstrip().startswith(b"{"):
        return None
    try:
        text = json.loads(section.rstrip(b"\0"))
    except ValueError:
        return None
    return text if isinstance(text, dict) else None


def _description(text: Any) -> dict[str, Any] | None:
    """The member that describes raw data, with those of `rawDetails` beside width and height."""
    if isinstance(text, dict):
        image = text.get("image")
        if isinstance(image, dict) and {"width", "height"} <= image.keys():
            details: dict[str, Any] = image | image.get("rawDetails", {})
            if {"pixelPacking", "pixelFormat", "mosaic"} <= details.keys():
                return details
    children = text.values() if isinstance(text, dict) else text if isinstance(text, list) else ()
    return next((image for child in children if (image := _description(child)) is not None), None)


def _image(
    image: dict[str, Any], sections: list[bytes], file: tuple[Path, int, FileLimits], metadata: dict[str, Any]
) -> LytroImage:
    """Unpack the section that has the size of the raw data."""
    path, size, limits = file
    try:
        rows, columns = int(image["height"]), int(image["width"])
        bits, order = int(image["pixelPacking"]["bitsPerPixel"]), str(image["pixelPacking"]["endianness"])
        black, white = (np.mean([*map(float, image["pixelFormat"][name].values())]) for name in ("black", "white"))
        colour_filters = _PATTERNS[str(image["mosaic"]["upperLeftPixel"])]
        group_bytes, group_pixels = _PACKINGS[bits, order]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileError(f"{str(path)!r} describes its raw image in an unknown way: {error}") from error
    if rows < 1 or columns < 1 or rows * columns % group_pixels:
        raise FileError(f"{str(path)!r} has {rows} x {columns} pixels of {bits} bits, which do not fill whole bytes")
    check_memory(8 * rows * columns, repr(str(path)), size, limits)
    n_bytes = rows * columns // group_pixels * group_bytes
    packed = next((section for section in sections if len(section) == n_bytes), None)
    if packed is None:
        raise FileError(f"{str(path)!r} has no section of {n_bytes} bytes, the raw data of {rows} x {columns} pixels")
    data = _unpack(np.frombuffer(packed, dtype=np.uint8), bits, order).reshape(rows, columns)
    return LytroImage(data, bits, float(black), float(white), colour_filters, metadata)


def _unpack(packed: NDArray[np.uint8], bits: int, order: str) -> NDArray[np.uint16]:
    """Numbers of 10 (little-endian), 12 (big-endian) or 16 bits."""
    if bits == 16:
        return packed.view("<u2" if order == "little" else ">u2").astype(np.uint16)
    group = packed.reshape(-1, 3 if bits == 12 else 5).astype(np.uint16)
    if bits == 12:
        first, middle, last = group.T
        return np.stack([first << 4 | middle >> 4, (middle & 15) << 8 | last], axis=1).ravel()
    # The fifth byte has the two low bits of each of the four pixels, the first pixel's lowest.
    low = group[:, 4:] >> np.arange(0, 8, 2, dtype=np.uint16) & 3
    return (group[:, :4] << 2 | low).ravel().astype(np.uint16)
