"""Light of small lamps that mirrors, glass or gloss cast onto matt surfaces: caustics that paths meet by chance."""

from __future__ import annotations

import math
from collections.abc import Iterator
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
from plenoptic.scene.textures.color import Colour, mean_colour

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

_FEWEST_RAYS = 100
"""Diffuse reflections of which one leads to a light: fewer find it often enough for its own standard error."""
_METAL = 0.5
"""Metallic fraction from which gloss reflects enough light to cast caustics."""


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
    rare = []
    for name, mesh, part in zip(scene.object_names, scene.meshes, parts, strict=False):
        if (highlight := highlights[part.material]) is not None:
            for light, irradiance, solid_angle in _lights(scene, mesh.bounds):
                angle = solid_angle + highlight
                if irradiance > 0 < angle <= math.pi / _FEWEST_RAYS:
                    rare.append(RareLight(light, name, irradiance / angle, math.pi / angle))
    return max(rare, key=lambda candidate: candidate.radiance, default=None)


def _highlight(material: Material) -> float | None:
    """Solid angle in sr over which a material scatters a ray: 0 if it is specular, None if it is not glossy."""
    row, alpha = material.row(), getattr(material, "alpha", None)
    if isinstance(material, MetallicRoughness) and isinstance(material.metallic, float) and material.metallic >= _METAL:
        alpha = material.roughness**2 if isinstance(material.roughness, float) else None
    if not row.reflects or not (row.specular or (alpha is not None and 4 * alpha**2 <= 1 / _FEWEST_RAYS)):
        return None
    return 0.0 if row.specular or alpha is None else 4 * math.pi * alpha**2


def _lights(scene: Scene, box: Floats) -> Iterator[tuple[str, float, float]]:
    """Name, irradiance (mean of the channels) and solid angle in sr of each light, from a box (2, 3) in mm."""
    for name, mesh in zip(scene.object_names, scene.meshes, strict=False):
        emission = (mesh.mesh if isinstance(mesh, Instances) else mesh).material.row().emission
        yield name, *_seen_from(box, mesh.bounds, mean_colour(emission))
    for k, light in enumerate(scene.lights):
        name = f"{type(light).__name__} {k}"
        if isinstance(light, SunLight):
            yield name, channel_mean(light.irradiance), math.pi * math.sin(light.angular_radius) ** 2
        elif not isinstance(light, AreaLight):
            yield name, channel_mean(light.intensity) / _squared_distance(light.position, box), 0.0
        elif not (isinstance(light, QuadLight) and _faces_away(light, box)):
            yield name, *_seen_from(box, light.mesh().bounds, light.radiance)
    if isinstance(scene.background, EnvironmentMap) and np.any(texels := scene.background.texels):
        irradiance = 4 * math.pi * float(texels.mean())
        yield "EnvironmentMap", irradiance, irradiance / float(texels.max())


def _seen_from(box: Floats, lamp: Floats, radiance: Colour) -> tuple[float, float]:
    """Irradiance and solid angle of a lamp in a box (2, 3); a convex body shows a quarter of its surface (Cauchy)."""
    x, y, z = lamp[1] - lamp[0]
    solid_angle = 0.5 * float(x * y + y * z + z * x) / _squared_distance(lamp.mean(axis=0), box)
    return channel_mean(radiance) * solid_angle, solid_angle


def _faces_away(light: QuadLight, box: Floats) -> bool:
    """True if a lamp of one side has the whole box behind it."""
    corner = np.where(light.normal > 0, box[1], box[0])
    return not light.two_sided and bool((corner - light.center) @ light.normal <= 0)


def _squared_distance(point: Floats, box: Floats) -> float:
    """Square of the distance from the middle of a box, at least of half the box's diagonal, mm^2."""
    return max(float(np.sum((point - box.mean(axis=0)) ** 2)), float(np.sum((box[1] - box[0]) ** 2)) / 4)
