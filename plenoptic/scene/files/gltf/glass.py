"""The transparent materials of glTF files (KHR_materials_transmission, _ior and _volume)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from plenoptic.scene.files.file_materials import colour_of
from plenoptic.scene.materials.dielectric import Dielectric, ThinGlass
from plenoptic.scene.textures.color import Colour, mean_colour
from plenoptic.scene.textures.texture import Texture

_DARKEST = 1e-6
"""What a colour of 0 transmits: absorption has to be finite."""


def transmitted(extensions: Mapping[str, Any], metallic: float | Texture, name: str) -> float:
    """The share of light that a material lets pass instead of scattering it back: 1 is glass.

    Metal lets nothing pass. A texture of transmission is left out, with a warning.
    """
    described = extensions.get("KHR_materials_transmission", {})
    factor = float(described.get("transmissionFactor", 0.0))
    if factor == 0 or metallic == 1:
        return 0.0
    if "transmissionTexture" in described or isinstance(metallic, Texture):
        warnings.warn(
            f"material {name!r} transmits light through parts of it, by a texture, which is not rendered: it is "
            "opaque; give these parts a mesh of their own",
            stacklevel=2,
        )
        return 0.0
    return factor * (1 - metallic)


def glass(
    extensions: Mapping[str, Any], base: Colour | Texture, roughness: float | Texture, scale: float, name: str
) -> Dielectric | ThinGlass:
    """A body where the file gives it a volume, a pane otherwise, which is smooth whatever the roughness.

    `base` is what is left of light that passes: in glTF at each surface. A pane has it as its transmittance. In a body
    it becomes absorption, such that it is right where the light passes as much as `thicknessFactor` says. `scale` is mm
    in one unit of the file.
    """
    index = float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5))
    volume = extensions.get("KHR_materials_volume", {})
    thickness = float(volume.get("thicknessFactor", 0.0)) * scale
    if isinstance(base, Texture) or isinstance(roughness, Texture):
        warnings.warn(f"the textures of the glass {name!r} are replaced by their means", stacklevel=2)
    tint = np.broadcast_to(mean_colour(base), 3)
    if thickness == 0:
        return ThinGlass(index, colour_of(tint))
    absorption = -2 * np.log(np.maximum(tint, _DARKEST)) / thickness
    distance = float(volume.get("attenuationDistance", math.inf)) * scale
    left = np.array(volume.get("attenuationColor", (1.0, 1.0, 1.0)), dtype=np.float64)
    absorption -= np.log(np.maximum(left, _DARKEST)) / distance
    return Dielectric(index, float(np.mean(mean_colour(roughness))) ** 2, colour_of(absorption))
