"""Materials of surfaces, and images laid over them."""

from plenoptic.scene.materials.conductor import Conductor
from plenoptic.scene.materials.dielectric import Dielectric, ThinGlass
from plenoptic.scene.materials.diffuse import Lambertian, RoughDiffuse
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.medium import HenyeyGreenstein, Medium, fog, jerlov_water, milk, pure_water
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.textures.texture import Texture, TextureFilter, Wrap

__all__ = [
    "Conductor",
    "Dielectric",
    "Emissive",
    "HenyeyGreenstein",
    "Lambertian",
    "Medium",
    "MetallicRoughness",
    "RoughDiffuse",
    "Texture",
    "TextureFilter",
    "ThinGlass",
    "Wrap",
    "fog",
    "jerlov_water",
    "milk",
    "pure_water",
]
