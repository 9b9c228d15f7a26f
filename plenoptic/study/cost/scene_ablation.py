"""Scenes without one of their properties, each for one stage of a render."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from plenoptic.errors import InvalidValueError
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.environment import ConstantBackground, EnvironmentMap
from plenoptic.scene.lights.registry import AreaLight, DistantLight, Light
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.medium import Medium
from plenoptic.scene.materials.registry import LAMBERTIAN, MATERIALS, Material
from plenoptic.scene.scene import Scene
from plenoptic.scene.textures.color import Colour, mean_colour
from plenoptic.scene.textures.texture import Texture

MOST_COPIES = 5_000_000
"""Largest number of triangles of copies: some 700 MB of memory, 130 bytes each."""

_BLACK = Lambertian(0.0)
T = TypeVar("T", bound=Material | Light)


def _scene(meshes: Any, lights: Any, background: Any, medium: Any = None) -> Scene:
    """A scene, black if it is empty."""
    if not meshes and not lights and background is None:
        background = 0.0
    return Scene(meshes, lights, background, medium=medium)


def with_materials(scene: Scene, change: Callable[..., Material], **arguments: Any) -> Scene:
    """The scene with all materials changed."""
    meshes = []
    for mesh in scene.meshes:
        material = mesh.mesh.material if isinstance(mesh, Instances) else mesh.material
        changed = change(material, **arguments)
        meshes.append(mesh if changed == material else mesh.with_material(changed))
    return dataclasses.replace(scene, meshes=tuple(meshes))


def without_media(scene: Scene) -> Scene:
    """Nothing between surfaces."""
    clear = with_materials(scene, with_fields, absorption=0.0, medium=None)
    return dataclasses.replace(clear, medium=None)


def without_scattering(scene: Scene) -> Scene:
    """Media that absorb only."""
    bare = with_materials(scene, lambda material: _map_fields(material, _no_scattering))
    return dataclasses.replace(bare, medium=_no_scattering("medium", scene.medium))


def _no_scattering(_: str, field: Any) -> Any:
    return dataclasses.replace(field, scattering=0.0) if isinstance(field, Medium) else field


def without_meshes(scene: Scene) -> Scene:
    """Only lights that are far away or points, which no ray meets."""
    return _scene(
        (), [light for light in scene.lights if not isinstance(light, AreaLight)], scene.background, scene.medium
    )


def without_instances(scene: Scene) -> Scene:
    """Instances replaced by copies of their mesh."""
    repeated = [mesh for mesh in scene.meshes if isinstance(mesh, Instances)]
    triangles = sum(len(instances) * len(instances.mesh.faces) for instances in repeated)
    if triangles > MOST_COPIES:
        raise InvalidValueError(f"copies would have {triangles} triangles, and the limit is {MOST_COPIES}")
    copies = [mesh.meshes() if isinstance(mesh, Instances) else (mesh,) for mesh in scene.meshes]
    return dataclasses.replace(scene, meshes=tuple(itertools.chain(*copies)))


def with_fields(material: Material, **changes: Any) -> Material:
    """A material with changed fields; names of fields that it does not have are skipped."""
    return dataclasses.replace(material, **{k: v for k, v in changes.items() if k in material.__dataclass_fields__})


def without_emission(scene: Scene) -> Scene:
    """All surfaces dark, including those of lamps, which stay in place."""
    dark = with_materials(scene, with_fields, emission=0.0, radiance=0.0)
    lamps = [light for light in scene.lights if isinstance(light, AreaLight)]
    bodies = [light.mesh().with_material(_BLACK) for light in lamps]
    return _scene(
        [*dark.meshes, *bodies], [light for light in scene.lights if light not in lamps], scene.background, scene.medium
    )


def without_world(scene: Scene) -> Scene:
    """A black world without suns."""
    return _scene(
        scene.meshes, [light for light in scene.lights if not isinstance(light, DistantLight)], None, scene.medium
    )


def without_lights(scene: Scene) -> Scene:
    """No light that could be sampled: at most a world of constant radiance."""
    world = scene.background
    if isinstance(world, EnvironmentMap):
        world = ConstantBackground(_mean_of(world))
    dark = without_emission(scene)
    return _scene(dark.meshes, (), world)


def _mean_of(world: EnvironmentMap) -> Colour:
    """Mean radiance of a map over the sphere: rows are weighed by their solid angle."""
    edges = np.cos(np.pi * np.arange(world.texels.shape[0] + 1) / world.texels.shape[0])
    mean = (edges[:-1] - edges[1:]) @ world.texels.mean(axis=1, dtype=np.float64) / 2.0
    red, green, blue = np.broadcast_to(mean, 3).tolist()
    return red, green, blue


def as_lambertian(material: Material) -> Material:
    """A matt material of the same colour, grey for clear bodies. An emitter emits as before, and does not reflect."""
    if MATERIALS[type(material)] == LAMBERTIAN:
        return material
    row = material.row()
    if isinstance(row.emission, Texture) or np.any(row.emission):
        return Emissive(row.emission, row.two_sided)
    return Lambertian(0.5 if row.glass_index[0] or row.pane_index else row.base_color)


def without_vertex_normals(scene: Scene) -> Scene:
    """Flat triangles, including those of instances."""
    meshes: list[Mesh | Instances] = []
    for mesh in scene.meshes:
        flat = dataclasses.replace(mesh.mesh if isinstance(mesh, Instances) else mesh, normals=None)
        meshes.append(dataclasses.replace(mesh, mesh=flat) if isinstance(mesh, Instances) else flat)
    return dataclasses.replace(scene, meshes=tuple(meshes))


def _map_fields(owner: T, change: Callable[[str, Any], Any]) -> T:
    """A material or a light with all of its fields changed."""
    fields = {name: change(name, getattr(owner, name)) for name in owner.__dataclass_fields__}
    return dataclasses.replace(owner, **fields)


def without_textures(material: Material) -> Material:
    """A material with the mean of each of its textures."""
    plain = with_fields(material, normal_map=None)
    return _map_fields(plain, lambda _, field: mean_colour(field) if isinstance(field, Texture) else field)


def _grey(name: str, field: Any) -> Any:
    """The mean of the three channels of a colour or texture; other fields stay."""
    if isinstance(field, Texture) and name != "normal_map":
        mean = field.texels.mean(axis=2, keepdims=True, dtype=np.float64)
        return dataclasses.replace(field, texels=mean.astype(np.float32))
    if isinstance(field, Medium):
        return dataclasses.replace(
            field, absorption=_grey("", field.absorption), scattering=_grey("", field.scattering)
        )
    if isinstance(field, tuple) and len(field) == 3:
        return sum(field) / 3
    return field


def grey(scene: Scene) -> Scene:
    """The scene in one channel."""
    grey_meshes = with_materials(scene, lambda material: _map_fields(material, _grey))
    world: Any = scene.background
    if isinstance(world, EnvironmentMap):
        world = dataclasses.replace(world, texels=world.texels.mean(axis=2, keepdims=True))
    elif world is not None:
        world = ConstantBackground(_grey("radiance", world.radiance))
    return dataclasses.replace(
        grey_meshes,
        lights=tuple(_map_fields(light, _grey) for light in scene.lights),
        background=world,
        medium=_grey("", scene.medium),
    )
