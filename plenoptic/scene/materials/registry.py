"""What a surface does with light: the closed set of materials."""

from __future__ import annotations

from typing import TypeAlias

from plenoptic.scene.materials.conductor import Conductor
from plenoptic.scene.materials.dielectric import Dielectric, ThinGlass
from plenoptic.scene.materials.diffuse import Lambertian, RoughDiffuse
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.textures.color import Colour as Colour
from plenoptic.scene.textures.color import as_colour as as_colour
from plenoptic.scene.textures.texture import Texture

Material: TypeAlias = Lambertian | RoughDiffuse | Conductor | Dielectric | ThinGlass | MetallicRoughness | Emissive

MATERIALS = (Lambertian, RoughDiffuse, Conductor, Dielectric, ThinGlass, MetallicRoughness, Emissive)


def textures_of(material: Material) -> tuple[Texture, ...]:
    """The textures that a material is made of."""
    fields = (getattr(material, name) for name in material.__dataclass_fields__)
    return tuple(field for field in fields if isinstance(field, Texture))


def emitted(material: Material) -> Colour | Texture:
    """Radiance that a material emits; 0 where it does not."""
    if isinstance(material, Emissive):
        return material.radiance
    return material.emission if isinstance(material, MetallicRoughness) else 0.0
