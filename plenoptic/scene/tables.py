"""The tables that a scene is compiled into: plain arrays, and None for what the scene has not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from plenoptic.errors import SceneError
from plenoptic.scene.material import Colour, Emissive, Material, is_grey
from plenoptic.scene.mesh import Mesh
from plenoptic.scene.texture import Texture

A = TypeVar("A", bound=np.generic)


class SceneTables(NamedTuple):
    """What kernels read of a scene. Absence is None: a table that a scene has no use for is not there.

    nv vertices, nt triangles, nm different materials, C = `channels`. All arrays are C-contiguous and read-only.

    Examples
    --------
    >>> import plenoptic as pl
    >>> tables = pl.white_plane().tables()
    >>> tables.channels, tables.triangles.shape, tables.emission.tolist(), tables.albedo is None
    (1, (2, 3), [[1.0]], True)
    """

    channels: int
    """1 where every colour of the scene is grey, textures and background included, otherwise 3."""

    vertices: NDArray[np.float64] | None
    """(nv, 3), mm. None, as are the next three, where there is no triangle."""
    triangles: NDArray[np.int32] | None
    """(nt, 3): rows of `vertices`, counter-clockwise as seen from the front."""
    triangle_material: NDArray[np.int32] | None
    """(nt,): row of the material tables."""
    triangle_mesh: NDArray[np.int32] | None
    """(nt,): which mesh it belongs to; lights count on after the last mesh."""

    normals: NDArray[np.float64] | None
    """(nv, 3), unit length; 0 where a mesh has none. None where no mesh has any."""
    uv: NDArray[np.float64] | None
    """(nv, 2): texture coordinates, v up; 0 where a mesh has none. None where no material has a texture."""

    albedo: NDArray[np.float64] | None
    """(nm, C), in [0, 1]; 1 where a texture gives it. None where nothing reflects."""
    emission: NDArray[np.float64] | None
    """(nm, C): emitted radiance. None where nothing emits."""
    two_sided: NDArray[np.uint8] | None
    """(nm,): 1 where both sides emit. None where nothing emits."""

    material_texture: NDArray[np.int32] | None
    """(nm,): row of `texture_shape`, -1 for none. None, as are the next two, where no material has a texture."""
    texels: NDArray[np.float32] | None
    """(n, C): the texels of all textures, row by row from the top, one texture after the other."""
    texture_shape: NDArray[np.int64] | None
    """(textures, 3): first row in `texels`, rows and columns of the image."""

    light_triangles: NDArray[np.int32] | None
    """(nl,), ascending: the triangles that emit. None, as are the next three, unless something reflects and emits."""
    light_cdf: NDArray[np.float64] | None
    """(nl,): cumulative probability, proportional to area x mean radiance x emitting sides; the last is exactly 1."""
    light_pdf: NDArray[np.float64] | None
    """(nl,): probability of each light triangle."""
    light_area_pdf: NDArray[np.float64] | None
    """(nl,), 1/mm^2: the same per area of the triangle."""

    background: NDArray[np.float64] | None
    """(C,): radiance of the world. None where it is black."""


def build_tables(meshes: Sequence[Mesh], background: Colour | None) -> SceneTables:
    """Compile meshes (those of lights included, last) and a background into tables.

    Parameters
    ----------
    meshes : sequence of Mesh
        Validated meshes; may be empty.
    background : float, (float, float, float) or None
        Radiance of the world; None where it is black.
    """
    index: dict[Material, int] = {}
    mesh_material = [index.setdefault(mesh.material, len(index)) for mesh in meshes]
    materials = list(index)
    colours = [m.radiance if isinstance(m, Emissive) else m.albedo for m in materials]
    grey = all(map(is_grey, colours)) and (background is None or is_grey(background))
    channels = 1 if grey else 3

    counts = [len(mesh.faces) for mesh in meshes]
    vertices = _joined([mesh.vertices for mesh in meshes])
    triangles = _triangles(meshes)
    triangle_material = _frozen(np.repeat(np.array(mesh_material, dtype=np.int32), counts)) if meshes else None
    triangle_mesh = _frozen(np.repeat(np.arange(len(meshes), dtype=np.int32), counts)) if meshes else None

    albedo = _rows([1.0 if isinstance(c, Texture) else c for c in colours], channels)
    emission = albedo.copy()
    emits = np.array([isinstance(m, Emissive) for m in materials], dtype=bool)
    albedo[emits], emission[~emits] = 0.0, 0.0
    two_sided = np.array([isinstance(m, Emissive) and m.two_sided for m in materials], dtype=np.uint8)
    textures = {c: None for c in colours if isinstance(c, Texture)}
    reflecting, emitting = bool(np.any(albedo)), bool(np.any(emission))

    lights: tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None = None
    if vertices is not None and triangles is not None and triangle_material is not None and reflecting and emitting:
        # Relative to the brightest, so that no radiance overflows the sums.
        exitance = (emission / emission.max()).mean(axis=1) * (1 + two_sided)
        lights = _lights(vertices, triangles, triangle_material, exitance)
    texels, texture_shape = _atlas(list(textures), channels)
    rows = {texture: row for row, texture in enumerate(textures)}
    chosen = [rows[c] if isinstance(c, Texture) else -1 for c in colours]
    return SceneTables(
        channels=channels,
        vertices=vertices,
        triangles=triangles,
        triangle_material=triangle_material,
        triangle_mesh=triangle_mesh,
        normals=_per_vertex(meshes, [mesh.normals for mesh in meshes], 3),
        uv=_per_vertex(meshes, [mesh.uv for mesh in meshes], 2) if textures else None,
        albedo=_frozen(albedo) if reflecting else None,
        emission=_frozen(emission) if emitting else None,
        two_sided=_frozen(two_sided) if emitting else None,
        material_texture=_frozen(np.array(chosen, dtype=np.int32)) if textures else None,
        texels=texels,
        texture_shape=texture_shape,
        light_triangles=None if lights is None else lights[0],
        light_cdf=None if lights is None else lights[1],
        light_pdf=None if lights is None else lights[2],
        light_area_pdf=None if lights is None else lights[3],
        background=None if background is None else _frozen(_rows([background], channels)[0]),
    )


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


def _atlas(textures: Sequence[Texture], channels: int) -> tuple[NDArray[np.float32] | None, NDArray[np.int64] | None]:
    if not textures:
        return None, None
    shapes = np.array([t.texels.shape[:2] for t in textures], dtype=np.int64)
    ends = np.cumsum(shapes.prod(axis=1))
    texels = np.empty((int(ends[-1]), channels), dtype=np.float32)
    starts = np.concatenate([[0], ends[:-1]])
    for texture, start, end in zip(textures, starts, ends, strict=True):
        # A grey texture among coloured ones is repeated, a grey one with three equal channels keeps the first.
        flat = texture.texels.reshape(-1, texture.texels.shape[2])
        texels[start:end] = flat if flat.shape[1] == channels else flat[:, :1]
    return _frozen(texels), _frozen(np.column_stack([starts, shapes]))


def _lights(
    vertices: NDArray[np.float64],
    triangles: NDArray[np.int32],
    triangle_material: NDArray[np.int32],
    exitance: NDArray[np.float64],
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
    """The triangles that emit, with the probabilities by which they are drawn; None where all are degenerate."""
    candidates = np.flatnonzero(exitance[triangle_material] > 0)
    a, b, c = (vertices[triangles[candidates, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen, area = candidates[area > 0], area[area > 0]
    if chosen.size == 0:
        return None
    density = exitance[triangle_material[chosen]]
    cumulative = np.cumsum(area * density)
    total = cumulative[-1]
    cdf = cumulative / total
    cdf[-1] = 1.0
    return _frozen(chosen.astype(np.int32)), _frozen(cdf), _frozen(area * density / total), _frozen(density / total)
