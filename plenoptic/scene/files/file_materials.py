"""Materials of all file formats: their common fields."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from plenoptic.core.files.file_limits import FileReader
from plenoptic.scene.textures.color import Colour
from plenoptic.scene.textures.texture import Texture

REPLACE = "or replace all materials by material="
"""The last remedy of most errors."""


def colour_of(parts: Iterable[float]) -> Colour:
    """Red, green and blue as a colour: one number where they are equal."""
    red, green, blue = (float(part) + 0.0 for part in parts)  # -0 becomes 0
    return red if red == green == blue else (red, green, blue)


def times(texture: Texture, colour: Colour) -> Texture:
    """A texture times a colour; the texture itself where that is 1."""
    if colour == 1:
        return texture
    texels = np.empty((*texture.texels.shape[:2], max(texture.texels.shape[2], np.size(colour))), dtype=np.float32)
    with np.errstate(over="ignore"):  # infinite values are refused by name
        np.multiply(texture.texels, np.asarray(colour, dtype=np.float64), out=texels, casting="same_kind")
    return Texture(texels, wrap=texture.wrap, filter=texture.filter)


def file_texture(reader: FileReader, name: str, **options: Any) -> Texture:
    """The texture that a file names, whose backslashes may stand for slashes."""
    place = reader.resolve(name)
    texture = Texture.load(
        place if place.exists() else reader.resolve(name.replace("\\", "/")), limits=reader.limits, **options
    )
    reader.take(texture.texels.nbytes, f"its image {name!r}")
    return texture


def number_or_texture(texture: Texture) -> float | Texture:
    """A texture of one channel, or its number where it is constant: that costs no path a look-up."""
    low, high = float(texture.texels.min()), float(texture.texels.max())
    return low if low == high else texture


def dark_or_not(emission: Colour | Texture) -> Colour | Texture:
    """Emitted light; 0 for a black image, which must not make a light of the mesh."""
    return 0.0 if isinstance(emission, Texture) and not emission.texels.any() else emission
