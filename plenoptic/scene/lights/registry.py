"""Closed set of the lights of a scene, besides emissive meshes and the background."""

from __future__ import annotations

from typing import TypeAlias

from plenoptic.scene.lights.point import PointLight
from plenoptic.scene.lights.quad import QuadLight
from plenoptic.scene.lights.sheet import Sheet
from plenoptic.scene.lights.sphere import SphereLight
from plenoptic.scene.lights.spot import SpotLight
from plenoptic.scene.lights.sun import SunLight

AreaLight: TypeAlias = QuadLight | SphereLight
"""Lights with an emitting mesh."""
PositionalLight: TypeAlias = PointLight | SpotLight
"""Lights at a point; no ray hits them."""
DistantLight: TypeAlias = SunLight
"""Lights at infinity."""

Light: TypeAlias = AreaLight | PositionalLight | DistantLight | Sheet

LIGHTS = (QuadLight, SphereLight, PointLight, SpotLight, SunLight, Sheet)
