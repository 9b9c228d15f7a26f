"""Closed set of materials."""

from __future__ import annotations

from typing import TypeAlias

from plenoptic.scene.materials.conductor import Conductor
from plenoptic.scene.materials.dielectric import Dielectric, ThinGlass
from plenoptic.scene.materials.diffuse import Lambertian, RoughDiffuse
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness

Material: TypeAlias = Lambertian | RoughDiffuse | Conductor | Dielectric | ThinGlass | MetallicRoughness | Emissive

KIND_NAMES = ("Lambertian", "rough diffuse", "metal", "glass", "panes", "metallic-roughness")
"""What a plan calls the kinds by which kernels scatter."""
LAMBERTIAN, OREN_NAYAR, CONDUCTOR, DIELECTRIC, THIN_DIELECTRIC, METALLIC_ROUGHNESS = range(6)

MATERIALS: dict[type[Material], int] = {
    Lambertian: LAMBERTIAN,
    RoughDiffuse: OREN_NAYAR,
    Conductor: CONDUCTOR,
    Dielectric: DIELECTRIC,
    ThinGlass: THIN_DIELECTRIC,
    MetallicRoughness: METALLIC_ROUGHNESS,
    Emissive: LAMBERTIAN,
}
"""Kind by which each material scatters; a material that only emits is a black Lambertian."""
