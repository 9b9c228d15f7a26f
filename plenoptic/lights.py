"""Lights of a scene, and the background of rays that hit nothing."""

from plenoptic.scene.lights.environment import ConstantBackground, EnvironmentMap
from plenoptic.scene.lights.point import PointLight
from plenoptic.scene.lights.quad import QuadLight
from plenoptic.scene.lights.sheet import Sheet
from plenoptic.scene.lights.sphere import SphereLight
from plenoptic.scene.lights.spot import SpotLight
from plenoptic.scene.lights.sun import SunLight

__all__ = [
    "ConstantBackground",
    "EnvironmentMap",
    "PointLight",
    "QuadLight",
    "Sheet",
    "SphereLight",
    "SpotLight",
    "SunLight",
]
