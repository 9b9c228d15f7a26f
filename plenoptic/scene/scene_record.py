"""Record that a scene is compiled into: plain arrays, and None for absent features."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.motions.motion import Motion
from plenoptic.core.values import Floats, contiguous
from plenoptic.errors import SceneError
from plenoptic.scene.geometry.build_geometry import add_instances, geometry_record
from plenoptic.scene.geometry.geometry_records import Geometry, InstanceRecord
from plenoptic.scene.geometry.instance import Instances, instance_record
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.build_lights import Emitters, environment_record, lights_record
from plenoptic.scene.lights.environment import Background, ConstantBackground, EnvironmentMap
from plenoptic.scene.lights.light_records import Lights, Sky
from plenoptic.scene.lights.registry import AreaLight, Light, PositionalLight
from plenoptic.scene.lights.sheet import Sheet
from plenoptic.scene.materials.build_materials import alpha_record, bsdf_record, color_rows, media_records
from plenoptic.scene.materials.material_records import EXTRA_SHARES, Alpha, Bsdf, Emission, MaterialRow, Media
from plenoptic.scene.materials.medium import Medium
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.color import is_grey, mean_colour
from plenoptic.scene.textures.texture import Texture
from plenoptic.scene.textures.texture_records import TEXTURE, TextureColumn, Textures

_FIELDS = {"extra_shares": EXTRA_SHARES}
"""Members of `Textures` that hold several fields per row."""


class SceneRecord(NamedTuple):
    """Scene as kernels read it. Members that a scene does not need are None.

    nt triangles, nm different materials, C = `channels`. All arrays are C-contiguous and read-only.
    """

    channels: int
    """1 where every colour of the scene is grey, textures, lights and background included, otherwise 3."""
    geometry: Geometry | None
    """None, as is the next one, where there is no triangle."""
    triangle_mesh: NDArray[np.int32] | None
    """(nt,): index of the triangle's mesh in the scene; lights follow the last mesh."""
    instances: InstanceRecord | None
    """Transforms of instanced meshes. None if there are none."""
    motions: tuple[Motion, ...] | None
    """Motions as functions of the time from the middle of the exposure. None if nothing moves."""
    bsdf: Bsdf | None
    """None where nothing reflects."""
    textures: Textures | None
    """None if no texture gives a property of `bsdf`."""
    absorption: Floats | None
    """(nm, C), 1/mm, with one row more for the scene's medium. None where nothing absorbs or scatters."""
    media: Media | None
    """None where no medium scatters."""
    surrounding: int | None
    """Row of the scene's medium in `absorption`. None where the scene has none."""
    alpha: Alpha | None
    """None where all is opaque."""
    emission: Emission | None
    """None where nothing emits."""
    lights: Lights
    """Lights that are sampled directly, and the sky."""


class CompiledMeshes(NamedTuple):
    """Compiled meshes in their own frames: scenes that differ in poses and lights share them."""

    meshes: tuple[weakref.ref[Mesh], ...]
    """Meshes in the order of the scene; for `Instances`, the instanced mesh."""
    repeated: tuple[bool, ...]
    """Which of them are `Instances`."""
    shapes: tuple[Mesh, ...]
    """Of lights."""
    first: tuple[int, ...]
    """First row of `triangles` of the mesh of each of the `Instances`."""
    geometry: Geometry | None
    """Without places."""
    triangle_mesh: NDArray[np.int32] | None
    materials: tuple[Material, ...]
    textures: TextureColumns

    def are(self, meshes: Sequence[Mesh | Instances], shapes: Sequence[Mesh]) -> bool:
        """True if compiled from these meshes and lights: the same mesh objects, and equal lights."""
        return (
            len(meshes) == len(self.meshes)
            and all(reference() is _mesh_of(mesh) for reference, mesh in zip(self.meshes, meshes, strict=True))
            and self.repeated == tuple(isinstance(mesh, Instances) for mesh in meshes)
            and self.shapes == tuple(shapes)
        )


def _mesh_of(part: Mesh | Instances) -> Mesh:
    return part.mesh if isinstance(part, Instances) else part


def build_surfaces(meshes: Sequence[Mesh | Instances], shapes: Sequence[Mesh]) -> CompiledMeshes:
    """Compile meshes and the shapes of lights."""
    parts, first_of, numbers = _order(meshes, shapes)
    index: dict[Material, int] = {}
    mesh_material = [index.setdefault(part.material, len(index)) for part in parts]
    counts = [len(part.faces) for part in parts]
    columns = TextureColumns([material.row() for material in index])
    starts = np.cumsum([0, *counts])
    geometry = triangle_mesh = None
    if parts:
        geometry = geometry_record(
            contiguous(np.concatenate([part.vertices for part in parts])),
            _triangles(parts),
            contiguous(np.repeat(np.array(mesh_material, dtype=np.int32), counts)),
            uv=_per_vertex(parts, "uv", 2) if columns.any else None,
            normals=_per_vertex(parts, "normals", 3),
        )
        triangle_mesh = contiguous(np.repeat(np.array(numbers, dtype=np.int32), counts))
    return CompiledMeshes(
        meshes=tuple(weakref.ref(_mesh_of(mesh)) for mesh in meshes),
        repeated=tuple(isinstance(mesh, Instances) for mesh in meshes),
        shapes=tuple(shapes),
        first=tuple(int(starts[first_of[mesh.mesh]]) for mesh in meshes if isinstance(mesh, Instances)),
        geometry=geometry,
        triangle_mesh=triangle_mesh,
        materials=tuple(index),
        textures=columns,
    )


def build_record(
    meshes: Sequence[Mesh | Instances],
    lights: Sequence[Light],
    background: Background | None,
    previous: CompiledMeshes | None = None,
    medium: Medium | None = None,
) -> tuple[SceneRecord, CompiledMeshes]:
    """Compile meshes, lights, a background (None: black) and a medium, with the `previous` surfaces where they are of
    the same meshes.
    """
    shapes = [light.mesh() for light in lights if isinstance(light, AreaLight)]
    surfaces = previous if previous is not None and previous.are(meshes, shapes) else build_surfaces(meshes, shapes)
    rows, columns = surfaces.textures.rows, surfaces.textures
    grey = all(row.is_grey for row in rows) and _all_grey(lights, background)
    channels = 1 if grey and (medium is None or (is_grey(medium.absorption) and is_grey(medium.scattering))) else 3
    instanced = [mesh for mesh in meshes if isinstance(mesh, Instances)]
    instances, geometry = instance_record(instanced, surfaces.first), surfaces.geometry
    if geometry is not None and instances is not None:
        geometry = add_instances(geometry, instances)
    bsdf = bsdf_record(surfaces.materials, channels)
    absorption, media = media_records(rows, _lit_bodies(surfaces.materials, meshes, lights), medium, channels)
    radiance = color_rows([mean_colour(row.emission) for row in rows], channels)
    two_sided = np.array([row.two_sided for row in rows], dtype=np.uint8)
    emitters = None
    if geometry is not None and surfaces.triangle_mesh is not None and np.any(radiance):
        # Halves first: sums of the largest numbers would overflow.
        exitance = (radiance / (2 * channels)).sum(axis=1) * (1 + two_sided)
        emitters = Emitters(geometry, exitance, instances, surfaces.triangle_mesh)
    boxes = [mesh.bounds for mesh in (*meshes, *shapes)]
    boxes += [np.stack([light.position] * 2) for light in lights if isinstance(light, PositionalLight)]
    drawn = bsdf is not None or media is not None
    emitter_record, pdf = lights_record(
        lights, emitters, _sky(background, channels), box_around(boxes), channels, drawn=drawn
    )
    emission = None
    if emitters is not None:
        emission = Emission(radiance, contiguous(two_sided), pdf, columns.column("emission"))
    of_surfaces = Textures(*(columns.column(*_FIELDS.get(name, (name,))) for name in Textures._fields))
    record = SceneRecord(
        channels=channels,
        geometry=geometry,
        triangle_mesh=surfaces.triangle_mesh,
        instances=instances,
        motions=tuple(one.motion for one in instanced if one.motion is not None) or None,
        bsdf=bsdf,
        textures=None if all(column is None for column in of_surfaces) else of_surfaces,
        absorption=absorption,
        media=media,
        surrounding=None if medium is None or absorption is None else len(rows),
        alpha=alpha_record(rows, columns.column("opacity")),
        emission=emission,
        lights=emitter_record,
    )
    return record, surfaces


def _lit_bodies(
    materials: Sequence[Material], meshes: Sequence[Mesh | Instances], lights: Sequence[Light]
) -> list[bool]:
    """Which materials that scatter have a body whose box, or the box of all its places, meets that of a light."""
    scattering = {material for material in materials if np.any(material.row().scattering)}
    if not scattering:
        return [False] * len(materials)
    shining = [mesh for mesh in meshes if np.any(mean_colour(_mesh_of(mesh).material.row().emission))]
    boxes = [mesh.bounds for mesh in (*shining, *(light.mesh() for light in lights if isinstance(light, AreaLight)))]
    boxes += [np.stack([light.position] * 2) for light in lights if isinstance(light, PositionalLight)]
    moves = any(isinstance(mesh, Instances) and mesh.motion is not None for mesh in meshes)
    always, lit = moves or any(isinstance(light, Sheet) for light in lights), set()
    for mesh in meshes:
        low, high = mesh.bounds
        if always or any(np.all(box[0] <= high) and np.all(box[1] >= low) for box in boxes):
            lit.add(_mesh_of(mesh).material)
    return [material in lit & scattering for material in materials]


def brightest_radiance(record: SceneRecord) -> float:
    """Approximate largest radiance of a path: of emitters, the background, or matt surfaces under lights.

    Channels are averaged. Textures and maps count with their mean; point lights as seen from the middle of the scene.
    """
    lights, sky, candidates = record.lights, record.lights.sky, [0.0]
    for rows in (None if record.emission is None else record.emission.radiance, sky.background):
        if rows is not None:
            candidates.append(float(np.atleast_2d(rows).mean(axis=1).max()))
    if sky.environment is not None:
        candidates.append(sky.environment.total / math.pi)
    if sky.suns is not None and sky.sun_colors is not None:
        angle = 2 * math.pi * sky.suns["cap"]
        irradiance = sky.sun_colors.mean(axis=1) * np.where(angle > 0, angle, 1.0)
        candidates.append(float(irradiance.max()) / math.pi)
    if lights.sheet_colors is not None:
        candidates.append(float(lights.sheet_colors.mean(axis=1).max()) / math.pi)
    if lights.point_colors is not None:
        candidates.append(float(lights.point_colors.mean(axis=1).max()) / (math.pi * (lights.far / 4) ** 2))
    return max(candidates)


def _sky(background: Background | None, channels: int) -> Sky:
    """A background or a map; None where they are black."""
    constant = environment = None
    if isinstance(background, ConstantBackground) and np.any(background.radiance):
        constant = color_rows([background.radiance], channels)[0]
    elif isinstance(background, EnvironmentMap):
        environment = environment_record(background, channels)
    return Sky(constant, None, None, environment)


def atlas(textures: Sequence[Texture]) -> tuple[NDArray[np.float32] | None, NDArray[Any] | None]:
    """Lay textures into one array, one behind the other, and the rows that say where; both None without textures.

    Channels lie side by side; there is 1 where all are equal, otherwise 3. Both arrays are read-only.
    """
    if not textures:
        return None, None
    planes = [texture.texels[..., :1] if texture.is_grey else texture.texels for texture in textures]
    ends = np.cumsum([plane.size for plane in planes], dtype=np.int64)
    texels = np.empty(ends[-1], dtype=np.float32)
    rows = np.empty(len(textures), dtype=TEXTURE)
    for k, (texture, plane, end) in enumerate(zip(textures, planes, ends, strict=True)):
        start = end - plane.size
        texels[start:end].reshape(plane.shape)[...] = plane
        rows[k] = (start, *plane.shape, *texture.wraps, texture.filter)
    texels.flags.writeable = rows.flags.writeable = False
    return texels, rows


class TextureColumns:
    """Textures that give the properties of materials."""

    def __init__(self, rows: Sequence[MaterialRow]) -> None:
        textures = list(dict.fromkeys(texture for row in rows for texture in row.textures))
        self.rows, self.any = rows, bool(textures)
        self._texels, self._textures = atlas(textures)
        self._numbers = {texture: number for number, texture in enumerate(textures)}

    def column(self, *names: str) -> TextureColumn | None:
        """Textures of a property, (materials,), or of several, (materials, properties); None if none is a texture."""
        fields = [[getattr(row, name) for name in names] for row in self.rows]
        numbers = [[self._numbers[f] if isinstance(f, Texture) else -1 for f in row] for row in fields]
        column = np.array([row[0] for row in numbers] if len(names) == 1 else numbers, dtype=np.int32)
        if self._texels is None or self._textures is None or not np.any(column >= 0):
            return None
        return TextureColumn(contiguous(column), self._textures, self._texels)


def _order(meshes: Sequence[Mesh | Instances], shapes: Sequence[Mesh]) -> tuple[list[Mesh], dict[Mesh, int], list[int]]:
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


def _all_grey(lights: Sequence[Light], background: Background | None) -> bool:
    """True if all emission besides that of surfaces is grey: fields of lights that are three numbers are colours."""
    if isinstance(background, EnvironmentMap) and not background.is_grey:
        return False
    world = (background.radiance,) if isinstance(background, ConstantBackground) else ()
    fields = [getattr(light, name) for light in lights for name in light.__dataclass_fields__]
    return all(is_grey(colour) for colour in (*world, *fields) if isinstance(colour, tuple))


def box_around(boxes: Sequence[Floats]) -> Floats | None:
    """(2, 3): lowest and highest corner of boxes (2, 3) together; None where there is none."""
    return np.array([np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]]) if boxes else None


def _triangles(meshes: Sequence[Mesh]) -> NDArray[np.int32]:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    if starts[-1] > np.iinfo(np.int32).max:
        raise SceneError(f"the scene has {starts[-1]} vertices; it must have fewer than 2^31, so split or simplify it")
    faces = [mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts[:-1], strict=True)]
    return contiguous(np.concatenate(faces))


def _per_vertex(meshes: Sequence[Mesh], name: str, width: int) -> Floats | None:
    """The arrays of that name one below the other, with rows of zeros for absent ones; None where all are absent."""
    parts = [getattr(mesh, name) for mesh in meshes]
    if all(part is None for part in parts):
        return None
    filled = [np.zeros((len(m.vertices), width)) if p is None else p for m, p in zip(meshes, parts, strict=True)]
    return contiguous(np.concatenate(filled))
