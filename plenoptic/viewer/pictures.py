"""Pictures of 8 bits in a page: WebP, which browsers and Pillow decode by the same library to the same pixels."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.srgb import linear_to_srgb
from plenoptic.core.files.codes import white_point

_QUALITIES = (100, 95, 92, 88, 84, 80, 75, 68, 60, 50, 35)
"""Of WebP with losses; 100 stands for none."""
_TRIED = 4
"""Pictures by which a quality is chosen."""
_LONGEST = 8192
"""Pixels along a side of a texture, which all but old graphics cards have."""
_ROOM = 1.06
"""Others may take more than those."""


def block_for(shape: tuple[int, ...], most: float) -> int:
    """Pixels along each side that one of the page stands for, so that there are at most so many, in a texture."""
    rows, columns = shape
    return max(1, math.ceil(math.sqrt(rows * columns / most)), math.ceil(max(shape) / _LONGEST))


def middles(values: NDArray[Any], block: int) -> NDArray[Any]:
    """The pixel in the middle of each block: means of depths, of errors or of numbers of lenses mean nothing."""
    row, column = (min(length, block) // 2 for length in values.shape[:2])
    rows, columns = (max(length // block, 1) for length in values.shape[:2])
    return values[row::block, column::block][:rows, :columns]


def positive_white(image: NDArray[np.floating[Any]]) -> float:
    """The white point, or 1 for images that are nowhere above 0."""
    white = white_point(image)
    return white if white > 0 else 1.0


def rgba(picture: NDArray[np.floating[Any]], top: float) -> NDArray[np.uint8]:
    """A linear picture (rows, columns, C) as sRGB codes and opacity (rows, columns, 4); clear where a channel is nan.

    `top` becomes 255, larger values are clipped. Channels other than three are shown as their mean.
    """
    finite = ~np.isnan(picture).any(axis=2)
    colour = picture if picture.shape[2] == 3 else picture.mean(axis=2, keepdims=True)
    encoded = linear_to_srgb(np.clip(np.nan_to_num(colour.astype(np.float64), posinf=top, neginf=0.0) / top, 0.0, 1.0))
    codes = np.empty((*finite.shape, 4), dtype=np.uint8)
    codes[:, :, :3] = np.rint(255.0 * np.where(finite[..., None], encoded, 0.0))
    codes[:, :, 3] = 255 * finite
    return codes


def webp(codes: NDArray[np.uint8], quality: int) -> bytes:
    """A file; without losses at quality 100."""
    from PIL import Image

    stream = io.BytesIO()
    whole = quality == 100
    opaque = codes[:, :, 3].all()
    picture = Image.fromarray(np.ascontiguousarray(codes[:, :, :3]) if opaque else codes)
    # "exact" keeps the colour 0 of transparent pixels, which filters would otherwise mix in.
    picture.save(stream, "WEBP", lossless=whole, quality=40 if whole else quality, method=2, exact=True)
    return stream.getvalue()


def within(pictures: Sequence[NDArray[np.uint8]], size: float) -> tuple[list[bytes], int]:
    """Files of all pictures that take at most `size` bytes together, at the best quality that fits, and that."""
    tried = [pictures[k] for k in np.unique(np.linspace(0, len(pictures) - 1, _TRIED).round().astype(int))]
    for quality in _QUALITIES[:-1]:
        each = np.mean([len(webp(picture, quality)) for picture in tried])
        if each * len(pictures) * _ROOM > size:
            continue
        files = [webp(picture, quality) for picture in pictures]
        if sum(map(len, files)) <= size:
            return files, quality
    return [webp(picture, _QUALITIES[-1]) for picture in pictures], _QUALITIES[-1]
