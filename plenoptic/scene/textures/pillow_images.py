"""Pillow images, as libraries for meshes hand them over, as linear texels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.srgb import Encoding, srgb_to_linear
from plenoptic.core.files.codes import ALPHA, channel_number
from plenoptic.core.values import choice
from plenoptic.errors import FileError

if TYPE_CHECKING:
    from PIL.Image import Image

_OF_RESULT = {"La": "LA", "RGBa": "RGBA"}
"""Pillow converts colours that are multiplied by alpha to these modes only."""


def linear_texels(image: Image, *, encoding: Encoding, channel: int | None) -> NDArray[np.float32]:
    """The (rows, columns, 1 or 3) linear values of an image of any mode, or of one of its channels.

    `encoding` is that of codes of 8 and 16 bits; floats are linear. `channel` is 0, 1, 2 for red, green, blue, or
    grey, 3 for alpha, which is never sRGB and 1 where there is none; None for all but alpha.
    """
    encoding, channel = choice(encoding, Encoding, "encoding"), channel_number(channel)
    try:
        image = image.convert(_OF_RESULT[image.mode]) if image.mode in _OF_RESULT else image
        codes, white = _opacity(image) if channel == ALPHA else _colours(image)
    except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError, ... for damaged data
        raise FileError(f"the image cannot be decoded ({error}); save it again") from None
    if channel is not None and codes.shape[2] > 1:
        codes = codes[..., channel : channel + 1]
    if white is None:
        return codes
    values: NDArray[np.floating[Any]] = np.arange(white + 1) / white
    if encoding is Encoding.SRGB and channel != ALPHA:
        values = srgb_to_linear(values)
    return np.asarray(values.astype(np.float32)[codes])


def _colours(image: Image) -> tuple[NDArray[Any], int | None]:
    """(rows, columns, 1 or 3) codes and the code of white; None where they are linear floats."""
    if image.mode == "F":
        return np.asarray(image)[..., None], None
    if image.mode.startswith("I"):
        # Pillow keeps 16-bit grey in its integer modes.
        return np.clip(np.asarray(image), 0, 65535).astype(np.uint16)[..., None], 65535
    grey = image.mode in ("1", "L", "LA")
    codes = np.asarray(image.convert("L" if grey else "RGB"))
    return codes[..., None] if grey else codes, 255


def _opacity(image: Image) -> tuple[NDArray[Any], int]:
    """(rows, columns, 1) codes of alpha, and the code of an opaque pixel."""
    image.load()  # what Pillow knows of transparency may stand behind the pixels in the file
    has_alpha = image.mode in ("P", "PA", "LA", "RGBA") or (
        "transparency" in image.info and image.mode in ("1", "L", "RGB")
    )
    if not has_alpha:
        return np.full((image.height, image.width, 1), 255, dtype=np.uint8), 255
    return np.asarray(image.convert("RGBA"))[..., 3:], 255
