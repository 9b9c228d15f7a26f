"""Textures as kernels read them: all texels of a scene in one flat array, and a row that says where each texture is."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

TEXTURE = np.dtype([(name, "i8") for name in ("start", "rows", "columns", "channels", "wrap_u", "wrap_v", "filter")])
"""Where a texture lies: row by row from the top, the 1 or 3 channels of a texel side by side."""

REPEAT, CLAMP, MIRROR = 0, 1, 2
"""`Wrap` as numbers."""

NEAREST = 0
"""`TextureFilter.NEAREST`; all else is bilinear."""


class TextureColumn(NamedTuple):
    """Textures that give one property of nm materials."""

    row: NDArray[np.int32]
    """(nm,): row of `textures`, -1 for none."""
    textures: NDArray[Any]
    """Rows of TEXTURE: all textures of the scene."""
    texels: NDArray[np.float32]
    """(n,): all texels of the scene."""


class Textures(NamedTuple):
    """Properties of surfaces that textures give, named as in `MaterialRow`; None for properties without textures."""

    base_color: TextureColumn | None
    roughness: TextureColumn | None
    metallic: TextureColumn | None
    extra_shares: TextureColumn | None
    """Its `row` is (nm, EXTRA_SHARES)."""
    normal: TextureColumn | None
