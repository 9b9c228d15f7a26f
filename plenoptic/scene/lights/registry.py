"""What lights a scene besides emissive meshes and the background: the closed set of lights."""

from __future__ import annotations

from typing import TypeAlias

from plenoptic.scene.lights.point import PointLight as PointLight
from plenoptic.scene.lights.quad import QuadLight as QuadLight
from plenoptic.scene.lights.sphere import SphereLight as SphereLight
from plenoptic.scene.lights.spot import SpotLight as SpotLight
from plenoptic.scene.lights.sun import SunLight as SunLight

Light: TypeAlias = QuadLight | SphereLight | PointLight | SpotLight | SunLight

LIGHTS = (QuadLight, SphereLight, PointLight, SpotLight, SunLight)
