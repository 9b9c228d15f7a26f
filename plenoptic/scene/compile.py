"""The record that a scene is compiled into: plain arrays, and None for what the scene has not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.errors import SceneError
from plenoptic.scene.geometry.compile import geometry_record
from plenoptic.scene.geometry.instance import Instances, instance_record
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.geometry.record import Geometry, InstanceRecord
from plenoptic.scene.lights.compile import Emitters, lights_record
from plenoptic.scene.lights.environment import ConstantBackground, EnvironmentMap
from plenoptic.scene.lights.environment_compile import environment_record
from plenoptic.scene.lights.record import Lights, Sky
from plenoptic.scene.lights.registry import AreaLight, Light, PositionalLight
from plenoptic.scene.materials.compile import alpha_record, bsdf_record, color_rows
from plenoptic.scene.materials.record import EXTRA_SHARES, Alpha, Bsdf, Emission, MaterialRow
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.atlas import atlas
from plenoptic.scene.textures.color import is_grey, mean_colour
from plenoptic.scene.textures.record import TextureColumn, Textures
from plenoptic.scene.textures.texture import Texture

A = TypeVar("A", bound=np.generic)

_FIELDS = {"extra_shares": EXTRA_SHARES}
"""What members of `Textures` gather several fields of rows."""


class SceneRecord(NamedTuple):
    """What kernels read of a scene. Absence is None: a record that a scene has no use for is not there.

    nt triangles, nm different materials, C = `channels`. All arrays are C-contiguous and read-only.

    Examples
    --------
    >>> import plenoptic as pl
    >>> record = pl.shapes.white_plane().tables()
    >>> record.channels, record.geometry.triangles.shape, record.emission.radiance.tolist(), record.bsdf is None
    (1, (2, 3), [[1.0]], True)
    """

    channels: int
    """1 where every colour of the scene is grey, textures, lights and background included, otherwise 3."""
    geometry: Geometry | None
    """None, as is the next one, where there is no triangle."""
    triangle_mesh: NDArray[np.int32] | None
    """(nt,): which of the scene's meshes it belongs to; lights count on after the last one."""
    instances: InstanceRecord | None
    """Where instanced meshes stand. None where there are none."""
    bsdf: Bsdf | None
    """None where nothing reflects."""
    textures: Textures | None
    """None where no texture gives what `bsdf` needs."""
    absorption: Floats | None
    """(nm, C), 1/mm. None where nothing absorbs."""
    alpha: Alpha | None
    """None where all is opaque."""
    emission: Emission | None
    """None where nothing emits."""
    lights: Lights
    """What is drawn directly, and the sky."""


def build_record(
    meshes: Sequence[Mesh | Instances], lights: Sequence[Light], background: ConstantBackground | EnvironmentMap | None
) -> SceneRecord:
    """Compile meshes, lights and a background into a record.

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
    columns = _TextureColumns(rows)
    instanced = [mesh for mesh in meshes if isinstance(mesh, Instances)]
    starts = np.cumsum([0, *counts])
    instances = instance_record(instanced, [int(starts[first_of[mesh.mesh]]) for mesh in instanced])
    geometry = None
    if parts:
        geometry = geometry_record(
            _joined([part.vertices for part in parts]),
            _triangles(parts),
            _frozen(np.repeat(np.array(mesh_material, dtype=np.int32), counts)),
            uv=_per_vertex(parts, [part.uv for part in parts], 2) if columns.any else None,
            normals=_per_vertex(parts, [part.normals for part in parts], 3),
            instances=instances,
        )
    bsdf = bsdf_record(list(index), channels)
    absorption = color_rows([row.absorption for row in rows], channels)
    radiance = color_rows([mean_colour(row.emission) for row in rows], channels)
    two_sided = np.array([row.two_sided for row in rows], dtype=np.uint8)
    emitters = None
    if geometry is not None and np.any(radiance):
        # Halves first: sums of the largest numbers would overflow.
        exitance = (radiance / (2 * channels)).sum(axis=1) * (1 + two_sided)
        emitters = Emitters(geometry, exitance, instances)
    boxes = [mesh.bounds for mesh in (*meshes, *shapes)]
    lamps = [light.position for light in lights if isinstance(light, PositionalLight)]
    compiled = lights_record(
        lights, emitters, _sky(background, channels), _around(boxes, lamps), channels, drawn=bsdf is not None
    )
    return SceneRecord(
        channels=channels,
        geometry=geometry,
        triangle_mesh=_frozen(np.repeat(np.array(numbers, dtype=np.int32), counts)) if parts else None,
        instances=instances,
        bsdf=bsdf,
        textures=columns.of_surfaces(),
        absorption=_frozen(absorption) if np.any(absorption) else None,
        alpha=alpha_record(rows, columns.column("opacity")),
        emission=None
        if emitters is None
        else Emission(_frozen(radiance), _frozen(two_sided), compiled.pdf, columns.column("emission")),
        lights=compiled.lights,
    )


def _sky(background: ConstantBackground | EnvironmentMap | None, channels: int) -> Sky:
    """A background or a map; None where they are black."""
    constant = environment = None
    if isinstance(background, ConstantBackground) and np.any(background.radiance):
        constant = _frozen(color_rows([background.radiance], channels)[0])
    elif isinstance(background, EnvironmentMap):
        environment = environment_record(background, channels)
    return Sky(constant, None, None, environment)


class _TextureColumns:
    """Which textures give the properties of materials."""

    def __init__(self, rows: Sequence[MaterialRow]) -> None:
        textures = list(dict.fromkeys(texture for row in rows for texture in row.textures))
        self._rows, self.any = rows, bool(textures)
        self._texels, self._textures = atlas(textures)
        self._numbers = {texture: number for number, texture in enumerate(textures)}

    def column(self, *names: str) -> TextureColumn | None:
        """Textures that a property is, or (materials, properties) those that several are; None where none is one."""
        found = [[getattr(row, name) for name in names] for row in self._rows]
        numbers = [[self._numbers[f] if isinstance(f, Texture) else -1 for f in row] for row in found]
        column = np.array([row[0] for row in numbers] if len(names) == 1 else numbers, dtype=np.int32)
        if self._texels is None or self._textures is None or not np.any(column >= 0):
            return None
        return TextureColumn(_frozen(column), self._textures, self._texels)

    def of_surfaces(self) -> Textures | None:
        """What textures say of how surfaces scatter."""
        columns = Textures(*(self.column(*_FIELDS.get(name, (name,))) for name in Textures._fields))
        return None if all(column is None for column in columns) else columns


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


def _around(boxes: Sequence[Floats], points: Sequence[Floats]) -> Floats | None:
    """(2, 3): lowest and highest corner of boxes and points together."""
    corners = [*boxes, *(np.stack([point, point]) for point in points)]
    if not corners:
        return None
    return np.array([np.min(corners, axis=0)[0], np.max(corners, axis=0)[1]])


def _frozen(array: NDArray[A]) -> NDArray[A]:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


def _joined(parts: Sequence[NDArray[A]]) -> NDArray[A]:
    return _frozen(np.concatenate(parts))


def _triangles(meshes: Sequence[Mesh]) -> NDArray[np.int32]:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    if starts[-1] > np.iinfo(np.int32).max:
        raise SceneError(f"the scene has {starts[-1]} vertices; it must have fewer than 2^31, so split or simplify it")
    return _joined([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts[:-1], strict=True)])


def _per_vertex(meshes: Sequence[Mesh], parts: Sequence[Floats | None], width: int) -> Floats | None:
    """The parts one below the other, with rows of zeros for absent ones; None where all are absent."""
    if all(part is None for part in parts):
        return None
    filled = [np.zeros((len(m.vertices), width)) if p is None else p for m, p in zip(meshes, parts, strict=True)]
    return _joined(filled)
