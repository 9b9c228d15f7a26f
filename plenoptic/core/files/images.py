"""Reading and writing images: the only module that knows OpenImageIO, which it loads on first use.

Images are `(rows, columns, channels)` float32 arrays, linear, row 0 at the top. Files are converted on reading:
integers of 8 or 16 bits are taken as sRGB-encoded unless the caller or the file says that they are linear, with a
warning for 16 bits of which neither says anything.
Floating-point files (EXR, HDR) are taken as linear.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.color.srgb import Encoding
from plenoptic.core.files.atomic_file import check_room, replace_file, translate_errors, utf8_path
from plenoptic.core.files.codes import (
    ALPHA,
    COLOR_SPACE,
    ImageHeader,
    alpha_name,
    arrange_pixels,
    channel_number,
    decode_picture,
    each_channel,
    file_parts,
    picture_names,
    picture_of,
    picture_part,
    picture_shape,
    stored_metadata,
)
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, allowed_memory, check_file, check_memory, check_scans
from plenoptic.core.values import AnyFloats, choice
from plenoptic.errors import FileError, InvalidValueError

LINEAR = "Linear"
SRGB = "sRGB"

_MAX_DESCRIPTION = 65535  # OpenImageIO truncates longer TIFF texts

_ROWS = 64
"""Rows of an image that are compared at a time."""

_Content: TypeAlias = tuple[NDArray[np.float32], list[str], dict[str, Any], str]
"""Channels, their names, metadata, and the type of the file's numbers, such as uint16."""

_LIMIT = "limits:imagesize_MB"
_OPENING = threading.Lock()

_START = 1 << 12
"""Bytes at the start of a file, in which a PNG file states its encoding."""


def read_linear(
    path: str | os.PathLike[str],
    *,
    encoding: Encoding | None = None,
    channel: int | None = None,
    max_pixels: int | None = None,
    limits: FileLimits = DEFAULT,
) -> NDArray[np.float32]:
    """Read an image file as linear values.

    Parameters
    ----------
    path : path-like
        PNG, JPEG, TIFF, EXR, HDR, or anything else that OpenImageIO reads. The picture of an EXR file is its display
        window, and the only layer that has R, G, B where its channels have layers. Of several parts it is the first
        that has R, G, B, or Y, and a FileWarning names them.
    encoding : Encoding, optional
        Encoding of integers, whatever the file states (a PNG's gAMA, an ICC profile), with a FileWarning where SRGB is
        given and the file says that they are linear. None: linear if the file says so, else SRGB, with a FileWarning
        for integers of 16 bits whose file states no encoding, as those of many cameras, which are linear.
    channel : int, optional
        A single channel: 0, 1, 2 for red, green, blue (of a grey image, its grey), 3 for alpha, which is
        never sRGB and 1 if the file has none. By default all but alpha.
    max_pixels : int, optional
        An image of more pixels is refused before they are read.
    limits : FileLimits
        Limits of the size of the file, and of the image.

    Returns
    -------
    (H, W, C) float32 ndarray
        C is 1 or 3. Colours are not multiplied by alpha. Integers are scaled to 0..1.

    Raises
    ------
    FileError
        If the file is missing, damaged, no image, too large, or holds neither grey nor RGB.
    InvalidValueError
        If there is no such encoding or channel.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, plenoptic as pl
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "grey.png"
    ...     pl.images.write_16bit(path, np.full((2, 3, 1), 32768, dtype=np.uint16))
    ...     pl.images.read_linear(path)[0, 0].round(3)
    array([0.214], dtype=float32)
    """
    chosen = None if encoding is None else choice(encoding, Encoding, "encoding")
    channel = channel_number(channel)
    pixels, names, metadata, kind = _read(path, limits, max_pixels)
    if channel == ALPHA:
        alpha = alpha_name(names, path)
        return np.ones_like(pixels[:, :, :1]) if alpha is None else np.take(pixels, [names.index(alpha)], axis=2)
    image = picture_of(pixels, names, path)
    if channel is not None and image.shape[2] > 1:
        image = np.ascontiguousarray(image[:, :, channel : channel + 1])
    return decode_picture(image, metadata, kind, path, chosen)


def read_channels(
    path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT
) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
    """Read every channel of an image file by name, with its metadata.

    Parameters
    ----------
    path : path-like
        An image file. Of an EXR file of several parts it is the one that `read_linear` takes.
    limits : FileLimits
        Limits of the size of the file, and of the image.

    Returns
    -------
    channels : dict
        Name to `(H, W)` float32 array, as stored: integers are scaled to 0..1 but not decoded. The
        order is the library's: by name for EXR files, with R, G, B in this order.
    metadata : dict
        Metadata of the file.

    Raises
    ------
    FileError
        If the file is missing, damaged or no image.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, plenoptic as pl
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "depth.exr"
    ...     pl.images.write_channels(path, {"Z": np.ones((2, 3))}, {"unit": "mm"})
    ...     channels, metadata = pl.images.read_channels(path)
    >>> list(channels), metadata["unit"]
    (['Z'], 'mm')
    """
    pixels, names, metadata, _ = _read(path, limits)
    return each_channel(pixels, names), metadata


def read_picture(
    path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT
) -> tuple[NDArray[np.float32], dict[str, NDArray[np.float32]], dict[str, Any]]:
    """Results of `read_linear` and `read_channels` from a single read of the file."""
    pixels, names, metadata, kind = _read(path, limits)
    channels, image = each_channel(pixels, names), picture_of(pixels, names, path)
    return decode_picture(image, metadata, kind, path), channels, metadata


def read_header(path: str | os.PathLike[str]) -> ImageHeader:
    """Shape, channels and metadata of an image file, without its pixels; damage among these goes unnoticed."""
    with _open_image(path, DEFAULT) as (source, spec, metadata):
        names = list(spec.channelnames)
        shape, bits = picture_shape(spec, source.format_name()), {"uint8": 8, "uint16": 16}.get(str(spec.format))
        return ImageHeader(shape, names, picture_names(names, path), metadata, bits)


def write_channels(
    path: str | os.PathLike[str], channels: Mapping[str, ArrayLike], metadata: Mapping[str, str] | None = None
) -> None:
    """Write named channels to an EXR file as float32, compressed without loss (zip).

    The file appears whole or not at all.

    Parameters
    ----------
    path : path-like
        Must end in `.exr`; its folder must exist.
    channels : mapping
        Name to `(H, W)` array, all of one shape. float64 is rounded to float32: the image library
        writes no other floating-point type of more than 16 bits.
    metadata : mapping, optional
        Name to text.

    Raises
    ------
    FileError
        If the file cannot be written.
    InvalidValueError
        If there are no channels, or their shapes differ.

    Examples
    --------
    See `read_channels`.
    """
    target = _image_path(path, (".exr",))
    planes = {name: np.asarray(plane, dtype=np.float32) for name, plane in channels.items()}
    shapes = {plane.shape for plane in planes.values()}
    if len(shapes) != 1 or len(shape := shapes.pop()) != 2 or 0 in shape:
        by_name = {name: plane.shape for name, plane in planes.items()}
        raise InvalidValueError(f"the channels have shapes {by_name}; give at least one, all of one shape (H, W)")
    _write(target, np.stack(list(planes.values()), axis=-1), tuple(planes), {"compression": "zip", **(metadata or {})})


def write_16bit(
    path: str | os.PathLike[str], image: NDArray[np.uint16], metadata: Mapping[str, str] | None = None
) -> None:
    """Write a 16-bit grey or RGB image to a TIFF or PNG file without conversion of its values.

    The file appears whole or not at all.

    Parameters
    ----------
    path : path-like
        Must end in `.png`, `.tif` or `.tiff`; its folder must exist.
    image : (H, W, C) uint16 ndarray
        C is 1 or 3.
    metadata : mapping, optional
        Name to text; kept as JSON in the image description, the one text that both formats hold.
        The name `oiio:ColorSpace` states the encoding of the values: `"Linear"` or, by default, `"sRGB"`.

    Raises
    ------
    FileError
        If the file cannot be written.
    InvalidValueError
        If the image has another shape or type, or the metadata exceed 65535 characters.

    Examples
    --------
    See `read_linear`.
    """
    pixels = np.asarray(image)
    if pixels.dtype != np.uint16 or pixels.ndim != 3 or pixels.shape[2] not in (1, 3) or 0 in pixels.shape:
        raise InvalidValueError(
            f"the image has shape {pixels.shape} and type {pixels.dtype}; it must be (H, W, 1) or (H, W, 3) uint16"
        )
    write_codes(path, pixels, metadata)


def write_codes(path: str | os.PathLike[str], pixels: NDArray[Any], metadata: Mapping[str, str] | None = None) -> None:
    """Write codes (H, W, 1 or 3) of 8 or 16 bits, as `write_16bit` does."""
    target = _image_path(path, (".png", ".tif", ".tiff"))
    attributes = {COLOR_SPACE: SRGB, **(metadata or {})}
    description = json.dumps(attributes)
    if len(description) > _MAX_DESCRIPTION:
        raise InvalidValueError(
            f"the metadata take {len(description)} characters; a description holds at most {_MAX_DESCRIPTION}; "
            "write an EXR file instead"
        )
    names = ("Y",) if pixels.shape[2] == 1 else ("R", "G", "B")
    _write(target, pixels, names, {COLOR_SPACE: attributes[COLOR_SPACE], "ImageDescription": description})


def bayer_to_rgb(mosaic: AnyFloats, *, layout: str, algorithm: str) -> NDArray[np.float32]:
    """(H, W, 3) image from a linear Bayer mosaic (H, W) of at least 2 x 2.

    `layout` is the first two pixels of row 0, then those of row 1: RGGB, BGGR, GRBG or GBRG. `algorithm` is one of
    OpenImageIO's: linear or MHC.
    """
    import OpenImageIO as oiio

    source = oiio.ImageBuf(np.ascontiguousarray(mosaic, dtype=np.float32)[:, :, np.newaxis])
    image = oiio.ImageBufAlgo.demosaic(source, pattern="bayer", algorithm=algorithm, layout=layout)
    if image.has_error:
        raise InvalidValueError(
            f"the mosaic cannot be demosaiced: {_reason(image)}; check layout {layout} and {algorithm}"
        )
    return np.asarray(image.get_pixels(oiio.FLOAT), dtype=np.float32)


def _read(path: str | os.PathLike[str], limits: FileLimits, max_pixels: int | None = None) -> _Content:
    import OpenImageIO as oiio

    with _open_image(path, limits, max_pixels) as (source, spec, metadata):
        pixels = source.read_image(oiio.FLOAT)
        file_format, trouble = source.format_name(), _reason(source)
    if pixels is None:
        raise FileError(f"{os.fspath(path)!r} is damaged: {trouble}; restore it from its origin")
    pixels = arrange_pixels(pixels.reshape(spec.height, spec.width, spec.nchannels), spec, file_format, path)
    return pixels, list(spec.channelnames), metadata, str(spec.format)


@contextmanager
def _open_image(
    path: str | os.PathLike[str], limits: FileLimits, max_pixels: int | None = None
) -> Iterator[tuple[Any, Any, dict[str, Any]]]:
    """Context manager of an open image file: its reader, its specification, and its metadata."""
    import OpenImageIO as oiio

    name = str(utf8_path(path))
    size = check_file(Path(name), limits)
    with translate_errors(Path(name), "read"), open(name, "rb") as file:
        start = file.read(_START)
        check_scans(start + file.read() if start.startswith(b"\xff\xd8") else start, repr(name))
    options = oiio.ImageSpec()
    options.attribute("oiio:UnassociatedAlpha", 1)  # otherwise colours come multiplied by alpha
    # Some formats are decoded on opening, so that the library itself needs the limit, which is global.
    with _OPENING:
        previous = oiio.get_int_attribute(_LIMIT)
        oiio.attribute(_LIMIT, max(1, allowed_memory(size, limits) >> 21))
        try:
            source = oiio.ImageInput.open(name, options)
        finally:
            oiio.attribute(_LIMIT, previous)
    if source is None:
        reason = _reason(oiio) or "no reason given"
        if _LIMIT in reason:
            reason = f"{reason.partition('. Image')[0]}; if you trust it, give limits=pl.images.FileLimits(memory=...)"
        raise FileError(f"{name!r} cannot be read as an image: {reason}; give an image file")
    try:
        if source.format_name() == "openexr":
            source.seek_subimage(picture_part(list(file_parts(source)), name), 0)
        spec = source.spec()
        rows, columns = picture_shape(spec, source.format_name())
        if max_pixels is not None and rows * columns > max_pixels:
            raise FileError(
                f"{name!r} has {rows} x {columns} pixels; it must have at most {max_pixels} here, so scale it down"
            )
        # It is read as float32, and each channel is copied.
        pixels = max(spec.image_pixels(), spec.tile_pixels(), rows * columns)
        check_memory(8 * pixels * spec.nchannels, repr(name), size, limits)
        yield source, spec, stored_metadata(spec, start)
    except UnicodeDecodeError as error:
        raise FileError(f"{name!r} is damaged: it holds an invalid text; restore it from its origin") from error
    finally:
        source.close()


def _image_path(path: str | os.PathLike[str], endings: tuple[str, ...]) -> Path:
    target = utf8_path(path)
    if target.suffix.lower() not in endings:
        raise FileError(f"{str(target)!r} ends in {target.suffix!r}; it must end in {' or '.join(endings)}")
    return target


def _write(target: Path, pixels: NDArray[Any], names: tuple[str, ...], metadata: Mapping[str, str]) -> None:
    import OpenImageIO as oiio

    height, width, count = pixels.shape
    kind = {"uint8": oiio.UINT8, "uint16": oiio.UINT16}.get(pixels.dtype.name, oiio.FLOAT)
    spec = oiio.ImageSpec(width, height, count, kind)
    spec.channelnames = names
    for name, text in metadata.items():
        spec.attribute(name, text)
    sink = oiio.ImageOutput.create(str(target))
    if sink is None:
        raise FileError(f"{str(target)!r} cannot be written: {_reason(oiio)}; choose another ending")
    with replace_file(target) as file:
        name = str(file.name)
        is_written = sink.open(name, spec) and sink.write_image(np.ascontiguousarray(pixels))
        reason = _reason(sink)
        is_written = sink.close() and is_written
        check_room(file)
        if not is_written or not _is_readable(name, pixels, names):
            reason = "the file does not hold the pixels written" if is_written else reason or _reason(sink)
            raise FileError(f"{str(target)!r} cannot be written: {reason}; check the folder's rights and free space")


def _is_readable(name: str, pixels: NDArray[Any], names: tuple[str, ...]) -> bool:
    """True if a file holds these pixels: writers may silently lose some."""
    import OpenImageIO as oiio

    with _OPENING:
        source = oiio.ImageInput.open(name)
    if source is None:
        return False
    spec = source.spec()
    try:
        if sorted(spec.channelnames) != sorted(names):
            return False
        order = [names.index(channel) for channel in spec.channelnames]
        for row in range(0, len(pixels), _ROWS):
            part = np.ascontiguousarray(pixels[row : row + _ROWS, :, order])
            read = source.read_scanlines(row, row + len(part), 0, 0, len(order), spec.format)
            if read is None or read.tobytes() != part.tobytes():  # nan are to come back too
                return False
    finally:
        source.close()
    return True


def _reason(speaker: Any) -> str:
    """OpenImageIO's message, which may quote undecodable bytes of a damaged file."""
    try:
        return " ".join(str(speaker.geterror()).split())
    except UnicodeDecodeError:
        return "it is damaged"
