"""Reading and writing images: the only module that knows OpenImageIO, which it loads on first use.

Images are `(rows, columns, channels)` float32 arrays, linear, row 0 at the top. What a file holds is
converted on the way in: integers of 8 or 16 bits are taken as sRGB-encoded unless the file says that
they are linear; floating-point files (EXR, HDR) are taken as they are.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic._values import file_path
from plenoptic.errors import FileError, InvalidValueError

__all__ = ["linear_to_srgb", "read_channels", "read_linear", "srgb_to_linear", "write_16bit", "write_channels"]

COLOR_SPACE = "oiio:ColorSpace"  # the metadata key under which OpenImageIO keeps the encoding
LINEAR = "Linear"
SRGB = "sRGB"

# IEC 61966-2-1: a straight piece near black, a power elsewhere; the two meet at these values.
_SRGB_KNEE = 0.04045
_LINEAR_KNEE = 0.0031308

_LONGEST_DESCRIPTION = 65535  # OpenImageIO cuts a TIFF text off beyond this many characters


def srgb_to_linear(encoded: ArrayLike) -> NDArray[np.floating[Any]]:
    """Decode sRGB values in 0..1 to linear values in 0..1.

    The curve is continued above 1 and, as an odd function, below 0.

    Parameters
    ----------
    encoded : array_like
        Values of any shape; integers are not rescaled.

    Returns
    -------
    ndarray
        Of the same shape, in the floating-point type of the input (float64 for integers).

    References
    ----------
    IEC 61966-2-1:1999, section 5.2.

    Examples
    --------
    >>> import plenoptic as pl
    >>> float(pl.images.srgb_to_linear(0.5).round(4))
    0.214
    """
    given = _floating(encoded)
    size = np.abs(given)
    decoded = np.where(size <= _SRGB_KNEE, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)
    signed: NDArray[np.floating[Any]] = np.copysign(decoded, given)
    return signed


def linear_to_srgb(linear: ArrayLike) -> NDArray[np.floating[Any]]:
    """Encode linear values in 0..1 as sRGB values in 0..1, the inverse of `srgb_to_linear`.

    Parameters
    ----------
    linear : array_like
        Values of any shape; integers are not rescaled.

    Returns
    -------
    ndarray
        Of the same shape, in the floating-point type of the input (float64 for integers).

    References
    ----------
    IEC 61966-2-1:1999, section 5.2.

    Examples
    --------
    >>> import plenoptic as pl
    >>> float(pl.images.linear_to_srgb(0.214).round(3))
    0.5
    """
    given = _floating(linear)
    size = np.abs(given)
    encoded = np.where(size <= _LINEAR_KNEE, size * 12.92, 1.055 * size ** (1 / 2.4) - 0.055)
    signed: NDArray[np.floating[Any]] = np.copysign(encoded, given)
    return signed


def read_linear(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """Read an image file as linear values.

    Parameters
    ----------
    path : path-like
        PNG, JPEG, TIFF, EXR, HDR, or anything else that OpenImageIO reads.

    Returns
    -------
    (H, W, C) float32 ndarray
        C is 1 or 3. Alpha is dropped; colours are not multiplied by it. Integers are scaled to
        0..1 and decoded from sRGB unless the file's metadata says that they are linear. A gamma
        other than these two is decoded as sRGB.

    Raises
    ------
    FileError
        Where the file is missing, damaged, no image, or holds neither grey nor RGB.

    Examples
    --------
    >>> import plenoptic as pl
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "grey.png"
    ...     pl.images.write_16bit(path, np.full((2, 3, 1), 32768, dtype=np.uint16))
    ...     pl.images.read_linear(path)[0, 0].round(3)
    array([0.214], dtype=float32)
    """
    channels, metadata, is_integer = _read(path)
    image = _picture(channels, path)
    if is_integer and "lin" not in str(metadata.get(COLOR_SPACE, SRGB)).lower():
        image = srgb_to_linear(image).astype(np.float32)
    return image


def read_channels(path: str | os.PathLike[str]) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
    """Read every channel of an image file by name, with its metadata.

    Parameters
    ----------
    path : path-like
        An image file.

    Returns
    -------
    channels : dict
        Name to `(H, W)` float32 array, as stored: integers are scaled to 0..1 but not decoded. The
        order is the library's: by name for EXR files, with R, G, B in this order.
    metadata : dict
        What the file says about itself.

    Raises
    ------
    FileError
        Where the file is missing, damaged or no image.

    Examples
    --------
    >>> import plenoptic as pl
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "depth.exr"
    ...     pl.images.write_channels(path, {"Z": np.ones((2, 3))}, {"unit": "mm"})
    ...     channels, metadata = pl.images.read_channels(path)
    >>> list(channels), metadata["unit"]
    (['Z'], 'mm')
    """
    channels, metadata, _ = _read(path)
    return channels, metadata


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
        Where the file cannot be written.
    InvalidValueError
        Where there are no channels, or their shapes differ.

    Examples
    --------
    See `read_channels`.
    """
    target = _writable(path, (".exr",))
    planes = {name: np.asarray(plane, dtype=np.float32) for name, plane in channels.items()}
    shapes = {plane.shape for plane in planes.values()}
    if len(shapes) != 1 or len(shape := shapes.pop()) != 2 or 0 in shape:
        found = {name: plane.shape for name, plane in planes.items()}
        raise InvalidValueError(f"the channels have shapes {found}; give at least one, all of one shape (H, W)")
    _write(target, np.stack(list(planes.values()), axis=-1), tuple(planes), {"compression": "zip", **(metadata or {})})


def write_16bit(
    path: str | os.PathLike[str], image: NDArray[np.uint16], metadata: Mapping[str, str] | None = None
) -> None:
    """Write a 16-bit grey or RGB image to a TIFF or PNG file, its values as they are.

    The file appears whole or not at all.

    Parameters
    ----------
    path : path-like
        Must end in `.png`, `.tif` or `.tiff`; its folder must exist.
    image : (H, W, C) uint16 ndarray
        C is 1 or 3.
    metadata : mapping, optional
        Name to text; kept as JSON in the image description, the one text that both formats hold.
        The name `oiio:ColorSpace` says how values are encoded: `"Linear"` or, by default, `"sRGB"`.

    Raises
    ------
    FileError
        Where the file cannot be written.
    InvalidValueError
        Where the image has another shape or type, or the metadata exceed 65535 characters.

    Examples
    --------
    See `read_linear`.
    """
    target = _writable(path, (".png", ".tif", ".tiff"))
    pixels = np.asarray(image)
    if pixels.dtype != np.uint16 or pixels.ndim != 3 or pixels.shape[2] not in (1, 3) or 0 in pixels.shape:
        raise InvalidValueError(
            f"the image has shape {pixels.shape} and type {pixels.dtype}; it must be (H, W, 1) or (H, W, 3) uint16"
        )
    said = {COLOR_SPACE: SRGB, **(metadata or {})}
    description = json.dumps(said)
    if len(description) > _LONGEST_DESCRIPTION:
        raise InvalidValueError(
            f"the metadata take {len(description)} characters; a description holds at most {_LONGEST_DESCRIPTION}; "
            "write an EXR file instead"
        )
    names = ("Y",) if pixels.shape[2] == 1 else ("R", "G", "B")
    _write(target, pixels, names, {COLOR_SPACE: said[COLOR_SPACE], "ImageDescription": description})


def bayer_to_rgb(mosaic: NDArray[np.floating[Any]], *, layout: str, algorithm: str) -> NDArray[np.float32]:
    """All channels of a Bayer mosaic at all pixels, through OpenImageIO.

    Parameters
    ----------
    mosaic : (H, W) ndarray
        At least 2 x 2, linear.
    layout : str
        The first two pixels of row 0, then those of row 1: RGGB, BGGR, GRBG or GBRG.
    algorithm : str
        As OpenImageIO calls it: linear or MHC.

    Returns
    -------
    (H, W, 3) float32 ndarray
    """
    import OpenImageIO as oiio

    source = oiio.ImageBuf(np.ascontiguousarray(mosaic, dtype=np.float32)[:, :, np.newaxis])
    made = oiio.ImageBufAlgo.demosaic(source, pattern="bayer", algorithm=algorithm, layout=layout)
    if made.has_error:
        raise InvalidValueError(
            f"the mosaic cannot be demosaiced: {_said(made)}; check layout {layout} and {algorithm}"
        )
    return np.asarray(made.get_pixels(oiio.FLOAT), dtype=np.float32)


def _floating(values: ArrayLike) -> NDArray[np.floating[Any]]:
    array = np.asarray(values)
    return array if array.dtype.kind == "f" else array.astype(np.float64)


def _picture(channels: Mapping[str, NDArray[np.float32]], path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """The (H, W, 3) or (H, W, 1) picture among the channels of a file: R, G, B, or Y, or the only one."""
    for names in (("R", "G", "B"), ("Y",)):
        if all(name in channels for name in names):
            return np.stack([channels[name] for name in names], axis=-1)
    others = [plane for name, plane in channels.items() if name != "A"]
    if len(others) != 1:
        raise FileError(
            f"{os.fspath(path)!r} holds the channels {', '.join(channels)}; a picture needs R, G, B, or Y, "
            "or a single channel"
        )
    return others[0][:, :, np.newaxis]


def _read(path: str | os.PathLike[str]) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any], bool]:
    import OpenImageIO as oiio

    name = os.fspath(file_path(path))
    if not os.path.exists(name):
        raise FileError(f"{name!r} does not exist; check the path")
    if os.path.isdir(name):
        raise FileError(f"{name!r} is a folder; give the path of an image file")
    wish = oiio.ImageSpec()
    wish.attribute("oiio:UnassociatedAlpha", 1)  # otherwise colours come multiplied by alpha
    source = oiio.ImageInput.open(name, wish)
    if source is None:
        raise FileError(f"{name!r} cannot be read as an image: {_said(oiio)}; give an image file")
    try:
        spec = source.spec()
        pixels = source.read_image(oiio.FLOAT)
        trouble = _reason(source)
    finally:
        source.close()
    if pixels is None:
        raise FileError(f"{name!r} is damaged: {trouble}; restore it from its origin")
    pixels = pixels.reshape(spec.height, spec.width, spec.nchannels)
    channels = {channel: np.ascontiguousarray(pixels[:, :, i]) for i, channel in enumerate(spec.channelnames)}
    metadata: dict[str, Any] = {item.name: item.value for item in spec.extra_attribs}
    with suppress(ValueError):  # any other description stays a plain text
        described = json.loads(metadata.get("ImageDescription", ""))
        metadata |= described if isinstance(described, dict) else {}
    return channels, metadata, str(spec.format) not in ("half", "float", "double")


def _writable(path: str | os.PathLike[str], endings: tuple[str, ...]) -> Path:
    target = file_path(path)
    if target.suffix.lower() not in endings:
        raise FileError(f"{str(target)!r} ends in {target.suffix!r}; it must end in {' or '.join(endings)}")
    if os.path.isdir(target):  # unlike Path.is_dir, it is silent about names that no file can have
        raise FileError(f"{str(target)!r} is a folder; give the path of a file")
    if not os.path.isdir(target.parent):
        raise FileError(f"the folder {str(target.parent)!r} does not exist; make it first")
    if not os.access(target.parent, os.W_OK):
        raise FileError(f"the folder {str(target.parent)!r} is not writable; choose another one")
    try:
        with suppress(FileNotFoundError):
            os.lstat(target)
    except (OSError, ValueError) as error:  # too long, or with a zero byte
        raise FileError(f"{str(target)!r} cannot be a file: {error}; choose another name") from error
    return target


def _write(target: Path, pixels: NDArray[Any], names: tuple[str, ...], metadata: Mapping[str, str]) -> None:
    import OpenImageIO as oiio

    height, width, count = pixels.shape
    spec = oiio.ImageSpec(width, height, count, oiio.UINT16 if pixels.dtype == np.uint16 else oiio.FLOAT)
    spec.channelnames = names
    for name, text in metadata.items():
        spec.attribute(name, text)
    with _replacing(target) as temporary:
        sink = oiio.ImageOutput.create(str(temporary))
        if sink is None:
            raise FileError(f"{str(target)!r} cannot be written: {_said(oiio)}; choose another ending")
        written = sink.open(str(temporary), spec) and sink.write_image(np.ascontiguousarray(pixels))
        trouble = _reason(sink)
        if not (sink.close() and written):
            reason = trouble or _reason(sink)
            raise FileError(f"{str(target)!r} cannot be written: {reason}; check the folder's rights and free space")


def _said(oiio: Any) -> str:
    return _reason(oiio) or "no reason given"


def _reason(speaker: Any) -> str:
    """What OpenImageIO says went wrong; its text may quote bytes of a damaged file that are no text."""
    try:
        return " ".join(str(speaker.geterror()).split())
    except UnicodeDecodeError:
        return "it is damaged"


@contextmanager
def _replacing(target: Path) -> Iterator[Path]:
    """A temporary path beside the target that takes its place when the block ends well."""
    final = Path(os.path.realpath(target))
    temporary = final.with_name(f".{secrets.token_hex(8)}{target.suffix}")
    try:
        yield temporary
        try:
            os.replace(temporary, final)
        except OSError as error:
            raise FileError(f"{str(target)!r} cannot be replaced: {error.strerror}; remove it first") from error
    finally:
        temporary.unlink(missing_ok=True)
