"""Light of small lamps that mirrors, glass or gloss cast onto matt surfaces: caustics that paths meet by chance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.rendering.settings import Caustics, RenderSettings
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.lights.environment import EnvironmentMap
from plenoptic.scene.lights.fields import channel_mean
from plenoptic.scene.lights.quad import QuadLight
from plenoptic.scene.lights.registry import AreaLight
from plenoptic.scene.lights.sun import SunLight
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.color import mean_colour

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

_FEWEST_RAYS = 100
"""Diffuse reflections of which one leads to a light: fewer find it often enough for its own standard error."""
_METAL, _LEAST_ALPHA = 0.5, 1e-3
"""Of `MetallicRoughness`: fraction of metal from which gloss casts caustics, and least alpha."""


class RareLight(NamedTuple):
    """Light that reaches matt surfaces by way of a mesh, where paths meet it by chance only."""

    light: str
    mesh: str
    radiance: float
    """Radiance of a path that meets it, mean of the channels; by way of a glossy mesh, that of the highlight."""
    rays: float
    """One of so many diffuse reflections meets it."""


def rare_light(scene: Scene | None, settings: RenderSettings) -> RareLight | None:
    """Brightest light of a scene that paths meet by chance after a matt and a specular or glossy surface, or None.

    A light of solid angle W is met by one diffuse reflection in pi / W, also through a mirror or glass. Gloss of width
    alpha adds its highlight, 4 pi alpha^2, to W (B. Walter et al., EGSR 2007).
    """
    if scene is None or settings.caustics is Caustics.EXCLUDE or settings.max_bounces < 2:
        return None
    parts = [part.mesh if isinstance(part, Instances) else part for part in scene.meshes]
    highlights = {material: _highlight(material) for material in {part.material for part in parts}}
    if not any(angle is None and material.row().takes_light for material, angle in highlights.items()):
        return None
    lamps, rare, names = _lamps(scene), [], scene.object_names
    for name, mesh, part in zip(names, scene.meshes, parts, strict=False):
        if (highlight := highlights[part.material]) is not None:
            for light, irradiance, solid_angle in (lamp.seen_from(mesh.bounds) for lamp in lamps):
                angle = solid_angle + highlight
                if irradiance > 0 < angle <= math.pi / _FEWEST_RAYS:
                    rare.append(RareLight(light, name, irradiance / angle, math.pi / angle))
    return max(rare, key=lambda candidate: candidate.radiance, default=None)


def _highlight(material: Material) -> float | None:
    """Solid angle in sr over which a material scatters a ray: 0 if it is specular, None if it is not glossy."""
    row, alpha = material.row(), getattr(material, "alpha", None)
    if isinstance(material, MetallicRoughness) and isinstance(material.metallic, float) and material.metallic >= _METAL:
        alpha = max(material.roughness**2, _LEAST_ALPHA) if isinstance(material.roughness, float) else None
    if not row.reflects or not (row.specular or (alpha is not None and 4 * alpha**2 <= 1 / _FEWEST_RAYS)):
        return None
    return 0.0 if row.specular or alpha is None else 4 * math.pi * alpha**2


class _Lamp(NamedTuple):
    """A light; without a shape it is infinitely far, and its size the solid angle in sr."""

    name: str
    radiance: float
    """Mean of the channels; of suns and maps irradiance, of points intensity."""
    size: float
    """Area in mm^2 that it shows on average, 0 for points."""
    shape: Floats | None = None
    """(2, 3), mm: box around it."""
    front: tuple[Floats, Floats] | None = None
    """Point of the plane that it shines to one side of, and the unit normal towards that side."""

    def seen_from(self, box: Floats) -> tuple[str, float, float]:
        """Name, irradiance and solid angle in sr, from the middle of a box (2, 3) in mm, or from half its diagonal."""
        if self.shape is None:
            return self.name, self.radiance, self.size
        if self.front is not None:
            point, normal = self.front
            if (np.where(normal > 0, box[1], box[0]) - point) @ normal <= 0:
                return self.name, 0.0, 0.0
        squares = np.sum((self.shape.mean(axis=0) - box.mean(axis=0)) ** 2), np.sum((box[1] - box[0]) ** 2) / 4
        solid_angle = self.size / float(max(squares))
        return self.name, self.radiance * (solid_angle or 1.0 / float(max(squares))), solid_angle


def _lamps(scene: Scene) -> list[_Lamp]:
    """Lights of a scene, emissive meshes and bright maps included."""
    lamps = []
    for name, mesh in zip(scene.object_names, scene.meshes, strict=False):
        emission = (mesh.mesh if isinstance(mesh, Instances) else mesh).material.row().emission
        if np.any(radiance := mean_colour(emission)):
            lamps.append(_Lamp(name, channel_mean(radiance), _mean_area(mesh.bounds), mesh.bounds))
    for k, light in enumerate(scene.lights):
        name = f"{type(light).__name__} {k}"
        if isinstance(light, SunLight):
            lamps.append(_Lamp(name, channel_mean(light.irradiance), math.pi * math.sin(light.angular_radius) ** 2))
        elif isinstance(light, AreaLight):
            front = (light.center, light.normal) if isinstance(light, QuadLight) and not light.two_sided else None
            bounds = light.mesh().bounds
            lamps.append(_Lamp(name, channel_mean(light.radiance), _mean_area(bounds), bounds, front))
        else:
            lamps.append(_Lamp(name, channel_mean(light.intensity), 0.0, np.stack([light.position] * 2)))
    if isinstance(scene.background, EnvironmentMap) and np.any(texels := scene.background.texels):
        irradiance = 4 * math.pi * float(texels.mean())
        lamps.append(_Lamp("EnvironmentMap", irradiance, irradiance / float(texels.max())))
    return lamps


def _mean_area(box: Floats) -> float:
    """Area that a box (2, 3) shows on average: a quarter of its surface (Cauchy)."""
    x, y, z = box[1] - box[0]
    return 0.5 * float(x * y + y * z + z * x)
