"""Textures as numbers: all texels of a scene in one flat array, and a row for each texture that says where."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.textures.record import TEXTURE
from plenoptic.scene.textures.texture import Texture


def atlas(textures: Sequence[Texture]) -> tuple[NDArray[np.float32] | None, NDArray[Any] | None]:
    """Lay textures into one array, one behind the other, and the rows that say where; both None without textures.

    Channels lie side by side; there is 1 where all are equal, otherwise 3. Both arrays are read-only.
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
