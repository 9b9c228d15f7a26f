"""The materials of glTF files."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from plenoptic.scene.files.file_materials import colour_of, dark_or_not
from plenoptic.scene.files.gltf.textures import (
    ALPHA,
    BLUE,
    GREEN,
    RED,
    GltfTextures,
    Info,
    TexturePlacement,
    placement_of,
)
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
    described: Mapping[str, Any], textures: GltfTextures, scale: float, tint: tuple[float, ...] = WHITE
) -> tuple[Material, TexturePlacement]:
    """One of the materials of a file, and how its textures lie on meshes.

    `scale` is mm in one unit of the file, for absorption in glass; `tint` the colour and opacity that all vertices
    have, a factor beside the material's own. A `FileError` for a texture that is missing or damaged and for textures
    that lie on the mesh in several ways, a `SceneError` for numbers out of range.
    """
    name = str(described.get("name", "without a name"))
    extensions = described.get("extensions", {})
    pbr = _metallic_roughness(described)
    factor = np.array(pbr.get("baseColorFactor", WHITE), dtype=np.float64) * tint
    base_info, layer_info = pbr.get("baseColorTexture"), pbr.get("metallicRoughnessTexture")
    base = textures.colour(base_info, factor[:3], name)
    opacity, cutoff = _opacity(described, base_info, float(factor[3]), textures, name)
    two_sided = bool(described.get("doubleSided", False))
    if "KHR_materials_unlit" in extensions:
        placement = placement_of(_used((base_info, base), (base_info, opacity)), name)
        if opacity == 1:
            return Emissive(base, two_sided), placement
        seen = MetallicRoughness(0.0, 0.0, 1.0, emission=base, two_sided=two_sided, opacity=opacity, cutoff=cutoff)
        return seen, placement
    metallic = textures.share(layer_info, pbr.get("metallicFactor", 1.0), BLUE, name)
    roughness = textures.share(layer_info, pbr.get("roughnessFactor", 1.0), GREEN, name)
    passed = _transmitted(extensions, metallic, name)
    if passed == 1:
        return _glass(extensions, base, roughness, scale, name), TexturePlacement()
    normals = textures.normals(described.get("normalTexture"), name)
    emission = _emission(described, textures, name)
    coat = extensions.get("KHR_materials_clearcoat", {})
    coat_info, coat_roughness_info = coat.get("clearcoatTexture"), coat.get("clearcoatRoughnessTexture")
    clearcoat = textures.share(coat_info, coat.get("clearcoatFactor", 0.0), RED, name)
    coat_factor = coat.get("clearcoatRoughnessFactor", 0.0) if clearcoat != 0 else 0.0
    coat_roughness = textures.share(coat_roughness_info, coat_factor, GREEN, name)
    material = MetallicRoughness(
        base,
        metallic,
        roughness,
        normal_map=normals,
        emission=emission,
        two_sided=two_sided,
        opacity=_thinned(opacity, passed, name),
        cutoff=cutoff,
        clearcoat=clearcoat,
        clearcoat_roughness=coat_roughness,
    )
    infos = _used(
        (base_info, base),
        (base_info, opacity),
        (layer_info, metallic),
        (layer_info, roughness),
        (described.get("normalTexture"), normals),
        (described.get("emissiveTexture"), emission),
        (coat_info, clearcoat),
        (coat_roughness_info, coat_roughness),
    )
    return material, placement_of(infos, name)


def _used(*slots: tuple[Info | None, Any]) -> list[Info]:
    """The textures that a material came to use: some turn out to be a number, or multiplied by 0."""
    return [info for info, filled in slots if info is not None and isinstance(filled, Texture)]


def _metallic_roughness(described: Mapping[str, Any]) -> Mapping[str, Any]:
    """The metallic-roughness part; of the older specular-glossiness model what comes nearest to it."""
    older = described.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    if older is None or "pbrMetallicRoughness" in described:
        found: Mapping[str, Any] = described.get("pbrMetallicRoughness", {})
        return found
    nearest = {"metallicFactor": 0.0, "roughnessFactor": 1 - older.get("glossinessFactor", 1.0)}
    nearest["baseColorFactor"] = older.get("diffuseFactor", WHITE)
    if "diffuseTexture" in older:
        nearest["baseColorTexture"] = older["diffuseTexture"]
    return nearest


def _opacity(
    described: Mapping[str, Any], info: Info | None, factor: float, textures: GltfTextures, name: str
) -> tuple[float | Texture, float | None]:
    """Opacity and cutoff of the three modes of transparency."""
    mode = described.get("alphaMode", "OPAQUE")
    if mode == "OPAQUE":
        return 1.0, None
    opacity = textures.share(info, factor, ALPHA, name)
    if mode == "BLEND":
        return opacity, None
    cutoff = float(described.get("alphaCutoff", 0.5))
    if isinstance(opacity, Texture) and cutoff <= 1:
        return opacity, cutoff
    there = not isinstance(opacity, Texture) and opacity >= cutoff
    return float(there), None


def _emission(described: Mapping[str, Any], textures: GltfTextures, name: str) -> Colour | Texture:
    factor = np.array(described.get("emissiveFactor", (0.0, 0.0, 0.0)), dtype=np.float64)
    strength = described.get("extensions", {}).get("KHR_materials_emissive_strength", {})
    strengthened = factor * strength.get("emissiveStrength", 1.0)
    return dark_or_not(textures.colour(described.get("emissiveTexture"), strengthened, name))


def _thinned(opacity: float | Texture, passed: float, name: str) -> float | Texture:
    """The opacity of a surface that also lets a share of the light pass."""
    if passed == 0:
        return opacity
    if not isinstance(opacity, Texture):
        return opacity * (1 - passed)
    warnings.warn(f"the transmission of material {name!r} is left out beside its opacity", stacklevel=2)
    return opacity


def _transmitted(extensions: Mapping[str, Any], metallic: float | Texture, name: str) -> float:
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


def _glass(
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
