"""The materials of glTF files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from plenoptic.core.warn import warn
from plenoptic.errors import FileWarning
from plenoptic.scene.files.file_materials import colour_of, dark_or_not
from plenoptic.scene.files.gltf.textures import ALPHA, BLUE, GREEN, RED, Info, MaterialTextures
from plenoptic.scene.materials.dielectric import Dielectric, ThinGlass
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.color import Colour, mean_colour
from plenoptic.scene.textures.texture import Texture

WHITE = (1.0, 1.0, 1.0, 1.0)
_DARKEST = 1e-6
"""What a colour of 0 transmits: absorption has to be finite."""


def gltf_material(
    described: Mapping[str, Any], read: MaterialTextures, scale: float, tint: tuple[float, ...] = WHITE
) -> Material:
    """One of the materials of a file.

    `scale` is mm in one unit of the file, for absorption in glass; `tint` the colour and opacity that all vertices
    have, a further factor. A `FileError` for damaged textures, a `SceneError` for numbers out of range.
    """
    extensions = described.get("extensions", {})
    pbr = _metallic_roughness(described)
    factor = np.array(pbr.get("baseColorFactor", WHITE), dtype=np.float64) * tint
    base_info, layer_info = pbr.get("baseColorTexture"), pbr.get("metallicRoughnessTexture")
    base = read.colour(base_info, factor[:3])
    opacity, cutoff = _opacity(described, base_info, float(factor[3]), read)
    two_sided = bool(described.get("doubleSided", False))
    if "KHR_materials_unlit" in extensions:
        if opacity == 1:
            return Emissive(base, two_sided)
        return MetallicRoughness(0.0, 0.0, 1.0, emission=base, two_sided=two_sided, opacity=opacity, cutoff=cutoff)
    metallic = read.share(layer_info, pbr.get("metallicFactor", 1.0), BLUE)
    roughness = read.share(layer_info, pbr.get("roughnessFactor", 1.0), GREEN)
    passed = _transmission(extensions, metallic, read.name)
    if passed == 1:
        return _glass(extensions, base, roughness, scale, read.name)
    coat = extensions.get("KHR_materials_clearcoat", {})
    clearcoat = read.share(coat.get("clearcoatTexture"), coat.get("clearcoatFactor", 0.0), RED)
    coat_factor = coat.get("clearcoatRoughnessFactor", 0.0) if clearcoat != 0 else 0.0
    return MetallicRoughness(
        base,
        metallic,
        roughness,
        normal_map=read.normals(described.get("normalTexture")),
        emission=_emission(described, read),
        two_sided=two_sided,
        opacity=_thin(opacity, passed, read.name),
        cutoff=cutoff,
        clearcoat=clearcoat,
        clearcoat_roughness=read.share(coat.get("clearcoatRoughnessTexture"), coat_factor, GREEN),
    )


def _metallic_roughness(described: Mapping[str, Any]) -> Mapping[str, Any]:
    """The metallic-roughness part; for the older specular-glossiness model, its nearest equivalent."""
    older = described.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    if older is None or "pbrMetallicRoughness" in described:
        part: Mapping[str, Any] = described.get("pbrMetallicRoughness", {})
        return part
    nearest = {"metallicFactor": 0.0, "roughnessFactor": 1 - older.get("glossinessFactor", 1.0)}
    nearest["baseColorFactor"] = older.get("diffuseFactor", WHITE)
    if "diffuseTexture" in older:
        nearest["baseColorTexture"] = older["diffuseTexture"]
    return nearest


def _opacity(
    described: Mapping[str, Any], info: Info | None, factor: float, read: MaterialTextures
) -> tuple[float | Texture, float | None]:
    """Opacity and cutoff of the three modes of transparency."""
    mode = described.get("alphaMode", "OPAQUE")
    if mode == "OPAQUE":
        return 1.0, None
    opacity = read.share(info, factor, ALPHA)
    if mode == "BLEND":
        return opacity, None
    cutoff = float(described.get("alphaCutoff", 0.5))
    if isinstance(opacity, Texture) and cutoff <= 1:
        return opacity, cutoff
    opaque = not isinstance(opacity, Texture) and opacity >= cutoff
    return float(opaque), None


def _emission(described: Mapping[str, Any], read: MaterialTextures) -> Colour | Texture:
    factor = np.array(described.get("emissiveFactor", (0.0, 0.0, 0.0)), dtype=np.float64)
    strength = described.get("extensions", {}).get("KHR_materials_emissive_strength", {})
    strengthened = factor * strength.get("emissiveStrength", 1.0)
    return dark_or_not(read.colour(described.get("emissiveTexture"), strengthened))


def _thin(opacity: float | Texture, passed: float, name: str) -> float | Texture:
    """The opacity of a surface that also lets a share of the light pass."""
    if passed == 0:
        return opacity
    if not isinstance(opacity, Texture):
        return opacity * (1 - passed)
    warn(f"the transmission of material {name!r} is left out beside its opacity", FileWarning)
    return opacity


def _transmission(extensions: Mapping[str, Any], metallic: float | Texture, name: str) -> float:
    """The share of light that a material lets pass instead of scattering it back: 1 is glass.

    Metal lets nothing pass. A texture of transmission is left out, with a warning.
    """
    described = extensions.get("KHR_materials_transmission", {})
    factor = float(described.get("transmissionFactor", 0.0))
    if factor == 0 or metallic == 1:
        return 0.0
    if "transmissionTexture" in described or isinstance(metallic, Texture):
        warn(
            f"material {name!r} transmits light through parts of it, by a texture, which is not rendered: it is "
            "opaque; give these parts a mesh of their own",
            FileWarning,
        )
        return 0.0
    return factor * (1 - metallic)


def _glass(
    extensions: Mapping[str, Any], base: Colour | Texture, roughness: float | Texture, scale: float, name: str
) -> Dielectric | ThinGlass:
    """A body where the file gives it a volume, a pane otherwise, which is smooth at any roughness.

    `base` is the remaining part of transmitted light: in glTF at each surface. A pane has it as its transmittance. In a
    body it becomes absorption, such that it is right where the light passes as much as `thicknessFactor` says. `scale`
    is mm in one unit of the file.
    """
    index = float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5))
    volume = extensions.get("KHR_materials_volume", {})
    thickness = float(volume.get("thicknessFactor", 0.0)) * scale
    if isinstance(base, Texture) or isinstance(roughness, Texture):
        warn(f"the textures of the glass {name!r} are replaced by their means", FileWarning)
    tint = np.broadcast_to(mean_colour(base), 3)
    if thickness == 0:
        return ThinGlass(index, colour_of(tint))
    absorption = -2 * np.log(np.maximum(tint, _DARKEST)) / thickness
    distance = float(volume.get("attenuationDistance", math.inf)) * scale
    left = np.array(volume.get("attenuationColor", (1.0, 1.0, 1.0)), dtype=np.float64)
    absorption -= np.log(np.maximum(left, _DARKEST)) / distance
    return Dielectric(index, float(np.mean(mean_colour(roughness))) ** 2, colour_of(absorption))
