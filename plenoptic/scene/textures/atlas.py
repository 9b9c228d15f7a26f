"""Textures as numbers: all texels of a scene in one flat array, and a row for each texture that says where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.textures.texture import Texture

FIELDS = 7
"""Numbers in a row: start, rows, columns, channels, wrap along u, wrap along v, filter."""


def atlas(textures: Sequence[Texture]) -> tuple[NDArray[np.float32] | None, NDArray[np.int64] | None]:
    """Lay textures into one array, one behind the other.

    Parameters
    ----------
    textures : sequence of Texture
        May be empty.

    Returns
    -------
    texels : (n,) float32 ndarray or None
        Row by row from the top, the channels of a texel side by side. Read-only.
    texture_rows : (textures, 7) int64 ndarray or None
        Start in `texels`, rows, columns, channels (1 where all are equal, otherwise 3), wrap along u, wrap along v
        and filter. Read-only.

    Both are None where there are no textures.

    Examples
    --------
    >>> import numpy as np
    >>> import plenoptic as pl
    >>> texels, texture_rows = atlas([pl.Texture(np.full((2, 2, 1), 0.5)), pl.Texture(np.eye(3)[None])])
    >>> texels.shape, texture_rows.tolist()
    ((13,), [[0, 2, 2, 1, 0, 0, 1], [4, 1, 3, 3, 0, 0, 1]])
    """
    if not textures:
        return None, None
    planes = [texture.texels[..., :1] if texture.is_grey else texture.texels for texture in textures]
    ends = np.cumsum([plane.size for plane in planes], dtype=np.int64)
    texels = np.empty(ends[-1], dtype=np.float32)
    texture_rows = np.empty((len(textures), FIELDS), dtype=np.int64)
    for row, texture, plane, end in zip(texture_rows, textures, planes, ends, strict=True):
        start = end - plane.size
        texels[start:end].reshape(plane.shape)[...] = plane
        row[:] = (start, *plane.shape, *texture.wraps, texture.filter)
    texels.flags.writeable = texture_rows.flags.writeable = False
    return texels, texture_rows
