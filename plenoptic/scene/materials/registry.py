"""What a surface does with light: the closed set of materials."""

from __future__ import annotations

from typing import TypeAlias

from plenoptic.scene.materials.conductor import Conductor
from plenoptic.scene.materials.dielectric import Dielectric
from plenoptic.scene.materials.diffuse import Lambertian, RoughDiffuse
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.materials.record import (
    CONDUCTOR,
    DIELECTRIC,
    LAMBERTIAN,
    METALLIC_ROUGHNESS,
    OREN_NAYAR,
    THIN_DIELECTRIC,
)
from plenoptic.scene.materials.thin_dielectric import ThinGlass

Material: TypeAlias = Lambertian | RoughDiffuse | Conductor | Dielectric | ThinGlass | MetallicRoughness | Emissive

MATERIALS: dict[type[Material], int] = {
    Lambertian: LAMBERTIAN,
    RoughDiffuse: OREN_NAYAR,
    Conductor: CONDUCTOR,
    Dielectric: DIELECTRIC,
    ThinGlass: THIN_DIELECTRIC,
    MetallicRoughness: METALLIC_ROUGHNESS,
    Emissive: LAMBERTIAN,
}
"""The kind by which each material scatters; what only emits is a black Lambertian."""
