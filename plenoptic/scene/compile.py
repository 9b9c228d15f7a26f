"""The tables that a scene is compiled into: plain arrays, and None for what the scene has not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from plenoptic.errors import SceneError
from plenoptic.scene.geometry.instance import Instances, InstanceTables, instance_tables
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.environment import ConstantBackground, EnvironmentMap
from plenoptic.scene.lights.environment_record import EnvironmentTables, build_environment
from plenoptic.scene.lights.record import Emitters, LightTables, build_lights
from plenoptic.scene.lights.registry import AreaLight, Light, PositionalLight
from plenoptic.scene.materials.record import BsdfTables, build_bsdf
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.atlas import atlas
from plenoptic.scene.textures.color import Colour, is_grey, mean_colour
from plenoptic.scene.textures.texture import Texture

A = TypeVar("A", bound=np.generic)


class SceneTables(NamedTuple):
    """What kernels read of a scene. Absence is None: a table that a scene has no use for is not there.

    nv vertices, nt triangles, nm different materials, C = `channels`. All arrays are C-contiguous and read-only.
    Triangles of plain meshes come first, then those of the shapes of lights, then those of instanced meshes, once each.

    Examples
    --------
    >>> import plenoptic as pl
    >>> tables = pl.white_plane().tables()
    >>> tables.channels, tables.triangles.shape, tables.emission.tolist(), tables.albedo is None
    (1, (2, 3), [[1.0]], True)
    """

    channels: int
    """1 where every colour of the scene is grey, textures, lights and background included, otherwise 3."""

    vertices: NDArray[np.float64] | None
    """(nv, 3), mm. None, as are the next three, where there is no triangle."""
    triangles: NDArray[np.int32] | None
    """(nt, 3): rows of `vertices`, counter-clockwise as seen from the front."""
    triangle_material: NDArray[np.int32] | None
    """(nt,): row of the material tables."""
    triangle_mesh: NDArray[np.int32] | None
    """(nt,): which of the scene's meshes it belongs to; lights count on after the last one."""
    instances: InstanceTables | None
    """Where instanced meshes stand. None where there are none."""

    normals: NDArray[np.float64] | None
    """(nv, 3), unit length; 0 where a mesh has none. None where no mesh has any."""
    uv: NDArray[np.float64] | None
    """(nv, 2): texture coordinates, v up; 0 where a mesh has none. None where no material has a texture."""

    scatters: NDArray[np.uint8] | None
    """(nm,): 1 for materials that reflect. None, as is the next one, where nothing does."""
    takes_light: NDArray[np.uint8] | None
    """(nm,): 1 for those that scatter light drawn directly; not mirrors and polished glass."""
    albedo: NDArray[np.float64] | None
    """(nm, C), in [0, 1]: base colours; 1 where a texture gives it. None where nothing reflects."""
    roughness: NDArray[np.float64] | None
    """(nm,). None where all materials are Lambertian or black."""
    metallic: NDArray[np.float64] | None
    """(nm,). None where none is MetallicRoughness."""
    bsdf: BsdfTables
    """What kinds of materials there are, and columns of some kinds."""
    absorption: NDArray[np.float64] | None
    """(nm, C), 1/mm. None where nothing absorbs."""
    opacity: NDArray[np.float64] | None
    """(nm,): 0 where a texture gives it. None, as is the next one, where all is opaque."""
    cutoff: NDArray[np.float64] | None
    """(nm,): -1 where there is none."""

    emission: NDArray[np.float64] | None
    """(nm, C): emitted radiance, of textures their mean. None where nothing emits."""
    two_sided: NDArray[np.uint8] | None
    """(nm,): 1 where both sides emit. None where nothing emits."""

    base_texture: NDArray[np.int32] | None
    """(nm,): row of `texture_rows`, -1 for none. None, as are the next five, where no material has one."""
    roughness_texture: NDArray[np.int32] | None
    metallic_texture: NDArray[np.int32] | None
    normal_texture: NDArray[np.int32] | None
    opacity_texture: NDArray[np.int32] | None
    emission_texture: NDArray[np.int32] | None
    texels: NDArray[np.float32] | None
    """(n,): all textures, one after the other. None, as is the next one, where there are none."""
    texture_rows: NDArray[np.int64] | None
    """(textures, 7): see `atlas`."""

    lights: LightTables
    """What is drawn directly, and suns."""
    environment: EnvironmentTables | None
    """None where there is no map, or a black one."""
    background: NDArray[np.float64] | None
    """(C,): constant radiance of the world. None where it is black or a map."""


def build_tables(
    meshes: Sequence[Mesh | Instances], lights: Sequence[Light], background: ConstantBackground | EnvironmentMap | None
) -> SceneTables:
    """Compile meshes, lights and a background into tables.

    Parameters
    ----------
    meshes : sequence of Mesh or Instances
    lights : sequence of Light
    background : ConstantBackground, EnvironmentMap or None
        None where the world is black.
    """
    shapes = [light.mesh() for light in lights if isinstance(light, AreaLight)]
    parts, first_of, numbers = _ordered(meshes, shapes)
    index: dict[Material, int] = {}
    mesh_material = [index.setdefault(part.material, len(index)) for part in parts]
    rows = [material.row() for material in index]
    channels = 1 if all(row.is_grey for row in rows) and _all_grey(lights, background) else 3

    counts = [len(part.faces) for part in parts]
    vertices = _joined([part.vertices for part in parts])
    triangles = _triangles(parts)
    triangle_material = _frozen(np.repeat(np.array(mesh_material, dtype=np.int32), counts)) if parts else None
    instanced = [mesh for mesh in meshes if isinstance(mesh, Instances)]
    starts = np.cumsum([0, *counts])
    instances = instance_tables(instanced, [int(starts[first_of[mesh.mesh]]) for mesh in instanced])

    reflecting = any(row.reflects for row in rows)
    emission = _rows([mean_colour(row.emission) for row in rows], channels)
    emitting = bool(np.any(emission))
    two_sided = np.array([row.two_sided for row in rows], dtype=np.uint8)
    textures = {
        texture: number for number, texture in enumerate(dict.fromkeys(t for row in rows for t in row.textures))
    }
    texels, texture_rows = atlas(list(textures))
    bsdf = build_bsdf(list(index), channels)
    absorption = _rows([row.absorption for row in rows], channels)
    opacity = _numbers([row.opacity for row in rows])
    cutoff = np.array([-1.0 if row.cutoff is None else row.cutoff for row in rows])
    thinned = bool(np.any(opacity != 1))

    environment = build_environment(background, channels) if isinstance(background, EnvironmentMap) else None
    emitters = None
    if emitting and vertices is not None and triangles is not None and triangle_material is not None:
        # Halves first: sums of the largest numbers would overflow.
        exitance = (emission / (2 * channels)).sum(axis=1) * (1 + two_sided)
        emitters = Emitters(vertices, triangles, triangle_material, exitance, instances)
    boxes = [mesh.bounds for mesh in (*meshes, *shapes)]
    lamps = [light.position for light in lights if isinstance(light, PositionalLight)]
    return SceneTables(
        channels=channels,
        vertices=vertices,
        triangles=triangles,
        triangle_material=triangle_material,
        triangle_mesh=_frozen(np.repeat(np.array(numbers, dtype=np.int32), counts)) if parts else None,
        instances=instances,
        normals=_per_vertex(parts, [part.normals for part in parts], 3),
        uv=_per_vertex(parts, [part.uv for part in parts], 2) if textures else None,
        scatters=_flags([row.reflects for row in rows]) if reflecting else None,
        takes_light=_flags([row.takes_light for row in rows]) if reflecting else None,
        albedo=_frozen(_rows([_plain(row.base) for row in rows], channels)) if reflecting else None,
        roughness=None if bsdf.kinds is None else _frozen(_numbers([row.roughness for row in rows])),
        metallic=None if bsdf.coupling is None else _frozen(_numbers([row.metallic for row in rows])),
        bsdf=bsdf,
        absorption=_frozen(absorption) if np.any(absorption) else None,
        opacity=_frozen(opacity) if thinned else None,
        cutoff=_frozen(cutoff) if thinned else None,
        emission=_frozen(emission) if emitting else None,
        two_sided=_frozen(two_sided) if emitting else None,
        base_texture=_texture_column([row.base for row in rows], textures),
        roughness_texture=_texture_column([row.roughness for row in rows], textures),
        metallic_texture=_texture_column([row.metallic for row in rows], textures),
        normal_texture=_texture_column([row.normal_map for row in rows], textures),
        opacity_texture=_texture_column([row.opacity for row in rows], textures),
        emission_texture=_texture_column([row.emission for row in rows], textures),
        texels=texels,
        texture_rows=texture_rows,
        lights=build_lights(emitters, lights, environment, _around(boxes, lamps), channels, drawn=reflecting),
        environment=environment,
        background=_frozen(_rows([background.radiance], channels)[0])
        if isinstance(background, ConstantBackground) and np.any(background.radiance)
        else None,
    )


def _ordered(
    meshes: Sequence[Mesh | Instances], shapes: Sequence[Mesh]
) -> tuple[list[Mesh], dict[Mesh, int], list[int]]:
    """All meshes in the order of their triangles, the place of instanced ones among them, and their numbers."""
    plain = [(mesh, number) for number, mesh in enumerate(meshes) if isinstance(mesh, Mesh)]
    plain += [(mesh, len(meshes) + number) for number, mesh in enumerate(shapes)]
    first_of: dict[Mesh, int] = {}
    repeated: list[tuple[Mesh, int]] = []
    for number, mesh in enumerate(meshes):
        if isinstance(mesh, Instances) and mesh.mesh not in first_of:
            first_of[mesh.mesh] = len(plain) + len(repeated)
            repeated.append((mesh.mesh, number))
    parts = plain + repeated
    return [mesh for mesh, _ in parts], first_of, [number for _, number in parts]


def _all_grey(lights: Sequence[Light], background: ConstantBackground | EnvironmentMap | None) -> bool:
    """Whether what shines besides surfaces is grey: colours are the fields of lights that are three numbers."""
    if isinstance(background, EnvironmentMap) and not background.is_grey:
        return False
    world = (background.radiance,) if isinstance(background, ConstantBackground) else ()
    fields = [getattr(light, name) for light in lights for name in light.__dataclass_fields__]
    return all(is_grey(colour) for colour in (*world, *fields) if isinstance(colour, tuple))


def _plain(colour: Colour | Texture) -> Colour:
    return 1.0 if isinstance(colour, Texture) else colour


def _numbers(shares: Sequence[float | Texture]) -> NDArray[np.float64]:
    """(materials,): 0 where a texture gives the number."""
    return np.array([0.0 if isinstance(share, Texture) else share for share in shares])


def _flags(holds: Sequence[bool]) -> NDArray[np.uint8]:
    return _frozen(np.array(holds, dtype=np.uint8))


def _texture_column(fields: Sequence[object], numbers: dict[Texture, int]) -> NDArray[np.int32] | None:
    """(materials,): row of the texture that a field is; None where none is one."""
    column = np.array([numbers[f] if isinstance(f, Texture) else -1 for f in fields], dtype=np.int32)
    return _frozen(column) if np.any(column >= 0) else None


def _around(boxes: Sequence[NDArray[np.float64]], points: Sequence[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """(2, 3): lowest and highest corner of boxes and points together."""
    corners = [*boxes, *(np.stack([point, point]) for point in points)]
    if not corners:
        return None
    return np.array([np.min(corners, axis=0)[0], np.max(corners, axis=0)[1]])


def _frozen(array: NDArray[A]) -> NDArray[A]:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


def _joined(parts: Sequence[NDArray[A]]) -> NDArray[A] | None:
    return _frozen(np.concatenate(parts)) if parts else None


def _triangles(meshes: Sequence[Mesh]) -> NDArray[np.int32] | None:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    if starts[-1] > np.iinfo(np.int32).max:
        raise SceneError(f"the scene has {starts[-1]} vertices; it must have fewer than 2^31, so split or simplify it")
    return _joined([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts[:-1], strict=True)])


def _rows(colours: Sequence[Colour], channels: int) -> NDArray[np.float64]:
    """(n, C): grey scenes keep the one value that all channels share."""
    rows = np.array([np.broadcast_to(c, 3) for c in colours], dtype=np.float64).reshape(-1, 3)
    return rows[:, :channels].copy()


def _per_vertex(
    meshes: Sequence[Mesh], parts: Sequence[NDArray[np.float64] | None], width: int
) -> NDArray[np.float64] | None:
    """The parts one below the other, with rows of zeros for absent ones; None where all are absent."""
    if all(part is None for part in parts):
        return None
    filled = [np.zeros((len(m.vertices), width)) if p is None else p for m, p in zip(meshes, parts, strict=True)]
    return _joined(filled)
