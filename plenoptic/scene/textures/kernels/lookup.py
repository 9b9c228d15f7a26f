"""Texture lookup at a point: device functions.

Textures lie in one flat array of texels; a row of `scene.textures.texture_records.TEXTURE` says where.
"""

from __future__ import annotations

import numpy as np

from plenoptic.core.numba.jit import device
from plenoptic.scene.textures.texture_records import MIRROR, NEAREST, REPEAT


@device
def wrap_coordinate(s, wrap):
    """Texture coordinate s brought into [0, 1]; 0 where it is no number. Off by 2^-54 at most."""
    if wrap == REPEAT:
        s -= np.floor(s)
    elif wrap == MIRROR:
        s -= 2.0 * np.floor(0.5 * s)
        s = min(s, 2.0 - s)
    s = s if s > 0.0 else 0.0  # NaN, too
    return s if s < 1.0 else 1.0


@device
def neighbours(s, n, wrap):
    """Neighbours of coordinate s among n texels along an axis, and its position between them."""
    x = wrap_coordinate(s, wrap) * n + 0.5
    second = int(x)
    f = x - second
    first = second - 1
    if wrap == REPEAT:
        first = first if first >= 0 else n - 1
        second = second if second < n else 0
    else:
        first = max(first, 0)
        second = min(second, n - 1)
    return first, second, f


@device
def fill_texel(value, texels, row, s, t):
    """Fill `value` (1 or 3) with the texture of a row at the coordinates (s, t), of which t points up.

    A texture of one channel fills all of `value`; a `value` of one takes the first channel. Coordinates may be NaN.
    """
    start, rows, columns, channels = row.start, row.rows, row.columns, row.channels
    last = value.shape[0] if channels > 1 else 1
    if row.filter == NEAREST:
        column = min(int(wrap_coordinate(s, row.wrap_u) * columns), columns - 1)
        above = min(int(wrap_coordinate(t, row.wrap_v) * rows), rows - 1)
        at = start + ((rows - 1 - above) * columns + column) * channels
        for k in range(last):
            value[k] = texels[at + k]
    else:
        left, right, fs = neighbours(s, columns, row.wrap_u)
        low, high, ft = neighbours(t, rows, row.wrap_v)
        left, right = start + left * channels, start + right * channels
        low, high = (rows - 1 - low) * columns * channels, (rows - 1 - high) * columns * channels
        for k in range(last):
            # Differences, too, are taken in float64, in which those of float32 lose nothing to speak of.
            a, b = np.float64(texels[low + left + k]), np.float64(texels[low + right + k])
            c, d = np.float64(texels[high + left + k]), np.float64(texels[high + right + k])
            bottom, top = a + fs * (b - a), c + fs * (d - c)
            value[k] = bottom + ft * (top - bottom)
    for k in range(last, value.shape[0]):
        value[k] = value[0]


@device
def opacity_at(number, opacity, cutoff, texture, uv, texels, textures):
    """Fraction of paths for which a surface is opaque; 0 or 1 with a cutoff. `texture` is -1 without texture."""
    number[0] = opacity
    if textures is not None:
        if texture >= 0:
            fill_texel(number, texels, textures[texture], uv[0], uv[1])
    if cutoff >= 0.0:
        return 1.0 if number[0] >= cutoff else 0.0
    return number[0]
