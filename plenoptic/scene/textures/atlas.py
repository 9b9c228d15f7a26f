"""Textures as numbers: all texels of a scene in one flat array, and a row for each texture that says where."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.textures.record import TEXTURE
from plenoptic.scene.textures.texture import Texture


def atlas(textures: Sequence[Texture]) -> tuple[NDArray[np.float32] | None, NDArray[Any] | None]:
    """Lay textures into one array, one behind the other.

    Parameters
    ----------
    textures : sequence of Texture
        May be empty.

    Returns
    -------
    texels : (n,) float32 ndarray or None
        Row by row from the top, the channels of a texel side by side. Read-only.
    rows : (textures,) ndarray of TEXTURE, or None
        Where each one lies; 1 channel where all are equal, otherwise 3. Read-only.

    Both are None where there are no textures.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> texels, rows = atlas([pl.Texture(np.full((2, 2, 1), 0.5)), pl.Texture(np.eye(3)[None])])
    >>> texels.shape, rows.tolist()
    ((13,), [(0, 2, 2, 1, 0, 0, 1), (4, 1, 3, 3, 0, 0, 1)])
    """
    if not textures:
        return None, None
    planes = [texture.texels[..., :1] if texture.is_grey else texture.texels for texture in textures]
    ends = np.cumsum([plane.size for plane in planes], dtype=np.int64)
    texels = np.empty(ends[-1], dtype=np.float32)
    rows = np.empty(len(textures), dtype=TEXTURE)
    for k, (texture, plane, end) in enumerate(zip(textures, planes, ends, strict=True)):
        start = end - plane.size
        texels[start:end].reshape(plane.shape)[...] = plane
        rows[k] = (start, *plane.shape, *texture.wraps, texture.filter)
    texels.flags.writeable = rows.flags.writeable = False
    return texels, rows
