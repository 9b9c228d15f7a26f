"""What lights a scene besides emissive meshes and the background: the closed set of lights."""

from __future__ import annotations

from typing import TypeAlias

from plenoptic.scene.point_light import PointLight as PointLight
from plenoptic.scene.quad_light import QuadLight as QuadLight
from plenoptic.scene.sphere_light import SphereLight as SphereLight
from plenoptic.scene.spot_light import SpotLight as SpotLight
from plenoptic.scene.sun_light import SunLight as SunLight

Light: TypeAlias = QuadLight | SphereLight | PointLight | SpotLight | SunLight

LIGHTS = (QuadLight, SphereLight, PointLight, SpotLight, SunLight)
