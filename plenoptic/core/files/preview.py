"""Small pictures of images for notebooks."""

from __future__ import annotations

import base64
import io

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.codes import codes, white_point

_PIXELS = 1024


def html_figure(image: NDArray[np.float32], caption: str) -> str:
    """The picture (H, W, C), its brightest 0.1 % cut, above a line of text."""
    png = base64.b64encode(_png(image)).decode()
    return f'<figure><img src="data:image/png;base64,{png}"/><figcaption>{caption}</figcaption></figure>'


def _png(image: NDArray[np.float32]) -> bytes:
    """An 8-bit sRGB PNG of at most 1024 pixels along a side, averaged linearly over whole blocks."""
    from PIL import Image

    block = -(-max(image.shape[:2]) // _PIXELS)
    top = float(np.max(image, initial=0, where=np.isfinite(image)))
    shown = np.clip(np.nan_to_num(image, posinf=top), 0, top).astype(np.float64)
    rows, columns = (max(length // block, 1) for length in image.shape[:2])
    shown = shown[: rows * block, : columns * block]
    rows_per, columns_per = shown.shape[0] // rows, shown.shape[1] // columns
    shown = shown.reshape(rows, rows_per, columns, columns_per, -1).mean(axis=(1, 3))
    pixels = codes(shown, scale=white_point(shown), encoded=True, bits=8)
    stream = io.BytesIO()
    Image.fromarray(pixels[:, :, 0] if pixels.shape[2] == 1 else pixels).save(stream, format="PNG")
    return stream.getvalue()
