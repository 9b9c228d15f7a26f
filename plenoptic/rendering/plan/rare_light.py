"""Light of small lamps that mirrors, glass or gloss cast onto matt surfaces: caustics that paths meet by chance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.core.values import AnyFloats, Floats
from plenoptic.rendering.settings import Caustics, RenderSettings
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.environment import EnvironmentMap
from plenoptic.scene.lights.fields import channel_mean
from plenoptic.scene.lights.registry import AreaLight
from plenoptic.scene.lights.sheet import Sheet
from plenoptic.scene.lights.spot import SpotLight
from plenoptic.scene.lights.sun import SunLight
from plenoptic.scene.materials.conductor import Conductor
from plenoptic.scene.materials.dielectric import Dielectric
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.color import mean_colour
from plenoptic.scene.textures.texture import Texture

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

_FEWEST_RAYS = 100
"""Reflections at a receiver of which one leads to a light: fewer find it often enough for its own standard error."""
_LEAST_REFLECTANCE, _LEAST_ALPHA = 0.1, 1e-3
"""Least reflectance of mirrors and gloss that cast caustics (plastic and varnish have 0.04); least alpha of glTF."""
_METAL = 0.5
"""Fraction of metal in `MetallicRoughness` from which no matt base counts."""
_TEXELS = 1 << 16


class RareLight(NamedTuple):
    """Light that reaches matt surfaces by way of a mesh, where paths meet it by chance only."""

    light: str
    mesh: str
    radiance: float
    """Radiance of a path that meets it, mean of the channels; by way of a glossy mesh, that of the highlight."""
    rays: float
    """One of so many reflections at the widest scattering surface meets it."""


def rare_light(scene: Scene | None, settings: RenderSettings) -> RareLight | None:
    """Brightest light of a scene that paths meet by chance after a matt and a specular or glossy surface, or None.

    A light of solid angle W is met by one diffuse reflection in pi / W, also through a mirror or glass. Gloss of width
    alpha adds its highlight, 4 pi alpha^2, to W (B. Walter et al., EGSR 2007). Polished metal that scatters into its
    highlight alone also receives such light; pi is then its highlight.
    """
    if scene is None or settings.caustics is Caustics.EXCLUDE or settings.max_bounces < 2:
        return None
    parts = [_mesh(part) for part in scene.meshes]
    highlights = {material: _highlight(material) for material in {part.material for part in parts}}
    spreads = {material: _spread(material, highlight) for material, highlight in highlights.items()}
    if not (widest := max(spreads.values(), default=0.0)):
        return None
    receivers = [mesh.bounds for mesh, part in zip(scene.meshes, parts, strict=True) if spreads[part.material] > 0]
    lamps, rare, names = _lamps(scene), [], scene.object_names
    for name, mesh, part in zip(names, scene.meshes, parts, strict=False):
        if (highlight := highlights[part.material]) is not None:
            for light, irradiance, solid_angle in (lamp.seen_from(mesh.bounds, receivers) for lamp in lamps):
                angle = solid_angle + highlight
                if irradiance > 0 < angle <= widest / _FEWEST_RAYS:
                    rare.append(RareLight(light, name, irradiance / angle, widest / angle))
    return max(rare, key=lambda candidate: candidate.radiance, default=None)


def _highlight(material: Material) -> float | None:
    """Solid angle in sr over which a material scatters a ray: 0 if it is specular, None if it casts no caustics."""
    row, alpha, reflectance = material.row(), 0.0 if material.row().specular else math.inf, 1.0
    if isinstance(material, MetallicRoughness):
        metal = _share(material.metallic, 90)
        reflectance = 0.04 * (1.0 - metal) + metal * channel_mean(mean_colour(material.base))
        alpha = max(_share(material.roughness, 10) ** 2, _LEAST_ALPHA)
    elif isinstance(material, Conductor):
        alpha, reflectance = 0.0 if row.specular else material.alpha, channel_mean(material.reflectance)
    elif isinstance(material, Dielectric) and not row.specular:
        # Facets tilted by t deflect reflected rays by 2 t, but refracted ones by (n - 1) t.
        alpha = material.alpha * abs(row.glass_index[0] / row.glass_index[1] - 1.0) / 2.0
    if not row.reflects or reflectance < _LEAST_REFLECTANCE or 4 * alpha**2 > 1 / _FEWEST_RAYS:
        return None
    return 4 * math.pi * alpha**2


def _spread(material: Material, highlight: float | None) -> float:
    """Solid angle in sr over which a material scatters light that is sampled directly: pi if it is matt."""
    is_matt = isinstance(material, MetallicRoughness) and _share(material.metallic, 10) < _METAL
    return 0.0 if not material.row().takes_light else math.pi if is_matt or highlight is None else highlight


def _share(share: float | Texture, percentile: float) -> float:
    """Number of a material, or a percentile of its texels."""
    if not isinstance(share, Texture):
        return share
    texels = share.texels.ravel()
    return float(np.percentile(texels[:: max(texels.size // _TEXELS, 1)], percentile))


class _Lamp(NamedTuple):
    """A light; without a shape it is infinitely far, and its size the solid angle in sr."""

    name: str
    radiance: float
    """Mean of the channels; of suns and maps irradiance, of points intensity."""
    size: float
    """Area in mm^2 that it shows on average, 0 for points."""
    shape: Floats | None = None
    """(2, 3), mm: box around it."""
    cone: tuple[Floats, float] | None = None
    """Unit vector along which it shines, and the half angle in rad up to which it does."""
    sheet: Sheet | None = None

    def seen_from(self, box: Floats, receivers: list[Floats]) -> tuple[str, float, float]:
        """Name, irradiance and solid angle in sr, from the middle of a box (2, 3) in mm or the nearest receiver.

        The longest distance counts: to the box, half its diagonal, or to the nearest of the receivers, boxes (2, 3).
        """
        if self.sheet is not None and not self.sheet.reaches(box):
            return self.name, 0.0, 0.0
        if self.shape is None:
            return self.name, self.radiance, self.size
        middle, radius = self.shape.mean(axis=0), float(np.linalg.norm(box[1] - box[0])) / 2
        towards = box.mean(axis=0) - middle
        distance = float(np.linalg.norm(towards))
        if self.cone is not None and distance > radius:
            axis, half_angle = self.cone
            if math.acos(np.clip(towards @ axis / distance, -1, 1)) - math.asin(radius / distance) >= half_angle:
                return self.name, 0.0, 0.0
        nearest = min(float(np.linalg.norm(np.clip(middle, *receiver) - middle)) for receiver in receivers)
        square = max(distance, radius, nearest) ** 2
        return self.name, self.radiance * (self.size or 1.0) / square, self.size / square


def _lamps(scene: Scene) -> list[_Lamp]:
    """Lights of a scene, emissive meshes and bright maps included."""
    shining = [*zip(scene.object_names, scene.meshes, strict=False)]
    lamps, names = [], [f"{type(light).__name__} {k}" for k, light in enumerate(scene.lights)]
    for name, light in zip(names, scene.lights, strict=True):
        if isinstance(light, SunLight):
            lamps.append(_Lamp(name, channel_mean(light.irradiance), math.pi * math.sin(light.angular_radius) ** 2))
        elif isinstance(light, Sheet):
            lamps.append(_Lamp(name, channel_mean(light.irradiance), 0.0, sheet=light))
        elif isinstance(light, AreaLight):
            shining.append((name, light.mesh()))
        else:
            cone = (light.direction, light.outer_angle) if isinstance(light, SpotLight) else None
            lamps.append(_Lamp(name, channel_mean(light.intensity), 0.0, np.stack([light.position] * 2), cone))
    if isinstance(scene.background, EnvironmentMap) and np.any(texels := scene.background.texels):
        mean, typical = _radiances(texels, np.sin(np.pi * (np.arange(len(texels)) + 0.5) / len(texels)))
        lamps.append(_Lamp("EnvironmentMap", 4 * math.pi * mean, 4 * math.pi * mean / typical))
    lamps += [
        _emitter(name, mesh) for name, mesh in shining if np.any(mean_colour(_mesh(mesh).material.row().emission))
    ]
    return lamps


def _emitter(name: str, part: Mesh | Instances) -> _Lamp:
    """Lamp of an emissive mesh."""
    mesh, emission = _mesh(part), _mesh(part).material.row().emission
    mean = typical = channel_mean(mean_colour(emission))
    if isinstance(emission, Texture):
        mean, typical = _radiances(emission.texels, np.ones(len(emission.texels)))
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    normals = np.cross(b - a, c - a) / 2
    area, normal = float(np.linalg.norm(normals, axis=1).sum()), normals.sum(axis=0)
    both, is_flat = mesh.material.row().two_sided, float(np.linalg.norm(normal)) > 0.999 * area
    cone = (normal / np.linalg.norm(normal), math.pi / 2) if is_flat and not both and part is mesh else None
    if isinstance(part, Instances):
        area *= float(np.sum(np.abs(np.linalg.det(part.matrices[:, :3, :3])) ** (2 / 3)))
    x, y, z = part.bounds[1] - part.bounds[0]
    # Convex bodies show a quarter of their surface on average (Cauchy), so do boxes around scattered ones at most.
    visible_area = min(area / 2 if both or is_flat else area / 4, 0.5 * float(x * y + y * z + z * x))
    return _Lamp(name, typical, visible_area * mean / typical, part.bounds, cone)


def _mesh(part: Mesh | Instances) -> Mesh:
    return part.mesh if isinstance(part, Instances) else part


def _radiances(texels: AnyFloats, weights: Floats) -> tuple[float, float]:
    """Mean radiance of texels whose rows have weights, and that of a typical part of the light, sum L^2 / sum L."""
    light = float(weights @ texels.sum(axis=(1, 2), dtype=np.float64))
    squares = float(weights @ np.einsum("ijk,ijk->i", texels, texels, dtype=np.float64))
    return light / (float(weights.sum()) * texels[0].size), squares / light
