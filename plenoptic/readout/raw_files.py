"""Raw images of real cameras, from their files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from plenoptic.core.files import images
from plenoptic.core.files.codes import whole_numbers
from plenoptic.core.files.file_limits import DEFAULT, FileLimits
from plenoptic.core.values import file_path, not_negative, whole
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.optics.sensor.color_filter import BayerPattern
from plenoptic.optics.sensor.model import FEWEST_BITS, MOST_BITS, SensorModel
from plenoptic.readout.lytro_files import read_lytro_image
from plenoptic.readout.raw import RawImage

_LYTRO = (".lfp", ".lfr", ".raw")


def read_raw(
    path: str | os.PathLike[str],
    *,
    bits: int | None = None,
    black_level: float | None = None,
    white_level: float | None = None,
    colour_filters: BayerPattern | ArrayLike | None = None,
    limits: FileLimits = DEFAULT,
) -> RawImage:
    """Read the raw image of a real camera, linear and as stored: nothing is decoded, balanced or interpolated.

    `linear()` of the result is 0 at the black level and 1 at the white level. Noise of the sensor is unknown, and left
    out of the sensor model.

    Parameters
    ----------
    path : path-like
        PNG or TIFF of 8 or 16 bits and one channel (Bayer mosaics too) or three; a Lytro container (.lfp, .lfr) or a
        Lytro white image (.raw with its .txt beside it), which state all that follows; or a file that `RawImage.save`
        wrote, whose sensor model is complete.
    bits : int, optional
        Bits of the converter, 8 to 16. None: those of the file's numbers.
    black_level, white_level : float, optional
        DN without light, and of saturated pixels; None: 0, and the largest number of so many bits.
    colour_filters : BayerPattern or (p, q) array_like of int, optional
        Filter on each pixel, see `SensorModel`; None: no filters.
    limits : FileLimits
        Limits of the size of the file, and of the image.

    Returns
    -------
    RawImage

    Raises
    ------
    FileError
        If the file is missing, damaged, or holds no raw image.
    InvalidValueError
        If a number is out of range, if numbers of the file need more bits, or if they are given for a file that states
        them.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, plenoptic as pl
    >>> numbers = np.array([[64, 4095, 1000, 500]], dtype=np.uint16)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "photo.png"
    ...     pl.images.write_16bit(path, numbers[..., None])
    ...     raw = pl.images.read_raw(path, bits=12, black_level=64)
    >>> raw, raw.linear()[0, :2]
    (RawImage(1 x 4, 12 bits, 25 % saturated), array([0., 1.]))
    """
    file, facts = file_path(path), (bits, black_level, white_level, colour_filters)
    if file.suffix.lower() in _LYTRO:
        _check_no_facts(facts, file)
        return read_lytro(file, limits=limits)[0]
    channels, metadata = images.read_channels(file, limits=limits)
    if "plenoptic:model" in metadata:
        _check_no_facts(facts, file)
        return RawImage.load(file, limits=limits)
    file_bits = images.read_header(file).bits
    if file_bits is None:
        raise FileError(f"{str(file)!r} has no integers of 8 or 16 bits; read it with pl.images.read_channels")
    data = whole_numbers(channels.values(), file_bits)
    if data.shape[2] not in (1, 3):
        raise FileError(f"{str(file)!r} has {data.shape[2]} channels; a raw image has one, or red, green and blue")
    n_bits = file_bits if bits is None else whole(bits, "bits", at_least=FEWEST_BITS)
    if n_bits > MOST_BITS or data.max() > 2**n_bits - 1:
        raise InvalidValueError(
            f"bits is {n_bits}, and {str(file)!r} has numbers up to {data.max():.0f}; give the bits of the converter, "
            f"at most {MOST_BITS}"
        )
    return _raw(
        data[..., 0] if data.shape[2] == 1 else data,
        n_bits,
        0.0 if black_level is None else not_negative(black_level, "black_level"),
        2.0**n_bits - 1.0 if white_level is None else not_negative(white_level, "white_level"),
        colour_filters,
    )


def read_lytro(path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> tuple[RawImage, dict[str, Any]]:
    r"""Read the raw image of a Lytro camera and its description of camera, lens and microlenses.

    Parameters
    ----------
    path : path-like
        A container (.lfp, .lfr), or raw data (.raw) with its text (.txt) beside it.
    limits : FileLimits
        Limits of the size of the file, and of the image.

    Returns
    -------
    raw : RawImage
        See `read_raw`.
    metadata : dict
        Members of the file's texts, lengths in m: `devices.mla.lensPitch`, `devices.sensor.pixelPitch`, ...

    Raises
    ------
    FileError
        If the file is missing, damaged, or holds no raw image.

    Examples
    --------
    >>> import json, pathlib, tempfile, plenoptic as pl
    >>> black, white = (dict.fromkeys(("r", "gr", "gb", "b"), level) for level in (168, 4095))
    >>> text = {"devices": {"mla": {"lensPitch": 1.4e-05}}, "image": {"width": 2, "height": 1, "rawDetails": {
    ...     "pixelFormat": {"black": black, "white": white}, "mosaic": {"upperLeftPixel": "b"},
    ...     "pixelPacking": {"bitsPerPixel": 12, "endianness": "big"}}}}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "white.raw"
    ...     bytes_written = path.write_bytes(b"\xff\xf0\xa8")
    ...     characters = path.with_suffix(".txt").write_text(json.dumps(text))
    ...     raw, metadata = pl.images.read_lytro(path)
    >>> raw.data, metadata["devices"]["mla"]["lensPitch"]
    (array([[4095,  168]], dtype=uint16), 1.4e-05)
    """
    image = read_lytro_image(file_path(path), limits)
    return _raw(image.data, image.bits, image.black, image.white, image.colour_filters), image.metadata


def _check_no_facts(facts: tuple[object, ...], file: Path) -> None:
    if any(number is not None for number in facts):
        raise InvalidValueError(f"{str(file)!r} states bits, levels and filters itself; leave them out")


def _raw(data: Any, bits: int, black: float, white: float, colour_filters: Any) -> RawImage:
    """Raw image whose sensor has one electron per DN, and an image value of 1 at the white level."""
    if not black < white <= 2**bits - 1:
        raise InvalidValueError(
            f"the levels of black and white are {black:g} and {white:g}; white must lie above black, and be at most "
            f"{2**bits - 1}, the largest number of {bits} bits"
        )
    saturated = white < 2**bits - 1
    model = SensorModel(
        photon_rate=white - black,
        black_level=black,
        bits=bits,
        full_well=white - black if saturated else None,
        colour_filters=colour_filters,
    )
    return RawImage(data, model)
