"""The triangles of glTF files."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.core.warn import warn
from plenoptic.errors import FileError, FileWarning
from plenoptic.scene.files.file_materials import colour_of, times
from plenoptic.scene.files.gltf.file import INDICES, GltfFile, whole
from plenoptic.scene.files.gltf.materials import WHITE, gltf_material
from plenoptic.scene.files.gltf.nodes import PlacedNode, copies
from plenoptic.scene.files.gltf.tangents import warn_of_tangents
from plenoptic.scene.files.gltf.textures import GltfTextures, MaterialTextures, TexturePlacement
from plenoptic.scene.files.polygons import shared_vertices
from plenoptic.scene.files.vertex_colours import VertexColours, texel_uv
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.geometry.mesh import Mesh, has_area
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.metallic_roughness import MetallicRoughness
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.textures.color import Colour

INSTANCED_FROM = 1000
"""Fewest triangles of a mesh in several places that is kept once: copies of smaller meshes are faster."""

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_COLOURED = {Lambertian: "albedo", Emissive: "radiance", MetallicRoughness: "base"}
"""Field of a material that the colours of vertices multiply."""
_MESH = 1 << 15
"""Bytes that a mesh counts for beside its arrays: it takes fewer, but some 40 microseconds."""
_SHAPES = {"POSITION": (3,), "NORMAL": (3,), "TEXCOORD": (2,), "COLOR": (3, 4), "TANGENT": (4,)}


def gltf_meshes(
    nodes: list[PlacedNode], file: GltfFile, scale: float, material: Material | None, default_name: str
) -> Iterator[Mesh | Instances]:
    """All triangles of a file, whose unit is `scale` mm, in mm, mesh by mesh in the order in which its nodes name them.

    A material replaces those of the file; `default_name` is for meshes that have none.
    """
    places: dict[tuple[int, tuple[float, ...]], list[Floats]] = {}
    for node in nodes:
        if "mesh" in node.described:
            if "skin" in node.described:
                label = node.described.get("name", "without a name")
                warn(f"the node {label!r} bends its mesh, which is shown as it is stored, unbent", FileWarning)
            number = node.described["mesh"]
            weights = node.described.get("weights", file.entry("meshes", number).get("weights", ()))
            places.setdefault((number, tuple(weights) if any(weights) else ()), []).append(copies(node, file))
    reader = _MeshReader(file, scale, material)
    for (number, weights), poses in places.items():
        matrices = np.concatenate(poses)
        # What is flattened cannot be seen.
        matrices = np.diag([scale, scale, scale, 1.0]) @ matrices[np.linalg.det(matrices[:, :3, :3]) != 0]
        described = file.entry("meshes", number)
        name = str(described.get("name") or default_name)
        for primitive in described["primitives"] if len(matrices) else ():
            mesh = reader.mesh(primitive, name, weights)
            if mesh is None:
                continue
            size = mesh.vertices.nbytes + mesh.faces.nbytes
            size += sum(array.nbytes for array in (mesh.normals, mesh.uv) if array is not None)
            if len(matrices) > 1 and len(mesh.faces) >= INSTANCED_FROM:
                file.reader.take(size, "its meshes")
                yield Instances(mesh, matrices)
            else:
                file.reader.take(len(matrices) * (size + _MESH), f"{len(matrices)} copies of its mesh {number}")
                yield from (mesh.transformed(matrix) for matrix in matrices)


class _MeshReader:
    """Reader of a file's meshes, which share materials, each made once."""

    def __init__(self, file: GltfFile, scale: float, material: Material | None) -> None:
        self._file, self._scale, self._given = file, scale, material
        self._textures, self._shown = GltfTextures(file), VertexColours(file.reader)
        self._materials: dict[Any, tuple[Material, TexturePlacement]] = {}

    def mesh(self, primitive: Mapping[str, Any], name: str, weights: tuple[float, ...]) -> Mesh | None:
        """A part of a mesh with its morph targets' weights, in the unit of the file; None if it is invisible."""
        attributes, mode = primitive["attributes"], whole(primitive, "mode", name, _TRIANGLES, most=_FAN)
        if "POSITION" not in attributes or mode < _TRIANGLES:
            return None
        vertices = self._morph(primitive, "POSITION", weights)
        assert vertices is not None
        faces = _faces(self._indices(primitive, len(vertices)), mode)
        if len(faces) == 0 or not has_area(vertices, faces):
            return None
        tint, colours = self._colours(primitive)
        material, placement = self._material(primitive, tint)
        normals, uv = (
            self._morph(primitive, "NORMAL", weights),
            self._morph(primitive, f"TEXCOORD_{placement.coordinates}", weights),
        )
        used = np.zeros(len(vertices), dtype=bool)
        used[faces.ravel()] = True
        if not used.all():  # several parts often share one list of vertices
            faces, vertices = (np.cumsum(used, dtype=np.int32) - 1)[faces], vertices[used]
            normals, uv, colours = (None if array is None else array[used] for array in (normals, uv, colours))
        mesh = Mesh(vertices, faces, material, normals, None if uv is None else placement.uv(uv), name)
        if isinstance(material, MetallicRoughness) and material.normal_map is not None and "TANGENT" in attributes:
            tangents = self._array(attributes, "TANGENT")
            assert tangents is not None
            warn_of_tangents(mesh, tangents if used.all() else tangents[used])
        return mesh if colours is None else self._with_colours(mesh, colours)

    def _with_colours(self, mesh: Mesh, colours: Floats) -> Mesh:
        """The mesh whose material is multiplied by the colours (n, 3) of its vertices."""
        material, name = mesh.material, f"the mesh {mesh.name!r}"
        field = _COLOURED.get(type(material), "")
        colour: Colour = getattr(material, field, 0.0)
        if material.row().textures or colour == 0:  # glass, black, or unlit and transparent
            warn(f"{name}: colours that vary from vertex to vertex are left out: its material takes none", FileWarning)
            return mesh
        texture, texels = self._shown.interpolation(name, colours[mesh.faces])
        corners = mesh.faces.ravel().astype(np.int64)
        faces, corner = shared_vertices(corners, texels)
        rows, multiplied = corners[corner], {field: times(texture, colour)}
        return Mesh(
            mesh.vertices[rows],
            faces.reshape(-1, 3),
            dataclasses.replace(cast(Any, material), **multiplied),
            None if mesh.normals is None else mesh.normals[rows],
            texel_uv(texture, texels[corner]),
            mesh.name,
        )

    def _morph(self, primitive: Mapping[str, Any], name: str, weights: tuple[float, ...]) -> Floats | None:
        """An attribute plus its displacements by the morph targets, times their weights (glTF 2.0, 3.7.2.2)."""
        array, targets = self._array(primitive["attributes"], name), primitive.get("targets", ())
        if weights and len(weights) != len(targets):
            raise FileError(f"it has {len(weights)} weights for {len(targets)} morph targets; export it again")
        for weight, target in zip(weights, targets, strict=False):
            change = self._array(primitive["attributes"], name, target)
            if array is not None and change is not None:
                array = array + float(weight) * change
        return array

    def _array(
        self, attributes: Mapping[str, Any], name: str, target: Mapping[str, Any] | None = None
    ) -> Floats | None:
        """An attribute, or its displacement by a morph target."""
        numbers = attributes if target is None else target
        if name not in numbers:
            return None
        array = self._file.array(numbers[name])
        widths = _SHAPES[name.partition("_")[0]]
        count = self._file.entry("accessors", attributes["POSITION"])["count"]
        if array.shape[1] not in widths or len(array) != count:
            raise FileError(
                f"its {name} (accessors {numbers[name]}) is {array.shape}; it must have {count} rows, as POSITION, "
                f"of {' or '.join(map(str, widths))}: export it again"
            )
        return np.asarray(array, dtype=np.float64)

    def _indices(self, primitive: Mapping[str, Any], count: int) -> NDArray[np.int32]:
        if "indices" not in primitive:
            return np.arange(count, dtype=np.int32)
        number = primitive["indices"]
        array = self._file.array(number)
        if array.shape[1] != 1 or array.dtype.str not in ("|u1", *INDICES.values()):
            raise FileError(f"its indices (accessors {number}) are no whole numbers of one component; export it again")
        if array.max() >= count:
            raise FileError(
                f"its indices (accessors {number}) reach {array.max()}, out of bounds for {count} vertices; export it "
                "again"
            )
        return np.asarray(array[:, 0], dtype=np.int32)

    def _material(
        self, primitive: Mapping[str, Any], tint: tuple[float, ...] | None
    ) -> tuple[Material, TexturePlacement]:
        if self._given is not None:
            return self._given, TexturePlacement()
        if "material" not in primitive:
            return (Lambertian() if tint is None else Lambertian(colour_of(tint[:3]))), TexturePlacement()
        key = (primitive["material"], tint)
        if key not in self._materials:
            described = self._file.entry("materials", primitive["material"])
            read = MaterialTextures(self._textures, str(described.get("name", "without a name")))
            material = gltf_material(described, read, self._scale, tint or WHITE)
            self._materials[key] = material, read.placement(material)
        return self._materials[key]

    def _colours(self, primitive: Mapping[str, Any]) -> tuple[tuple[float, ...] | None, Floats | None]:
        """Colour and opacity that all vertices have, None for none, and their colours (n, 3) where these vary."""
        colours = None if self._given is not None else self._array(primitive["attributes"], "COLOR_0")
        if colours is None or len(colours) == 0:
            return None, None
        rgba = np.ones((len(colours), 4))
        rgba[:, : colours.shape[1]] = np.clip(colours, 0, 1)  # as glTF demands
        varies = np.any(rgba != rgba[0], axis=0)
        if varies[3]:
            warn("opacities that vary from vertex to vertex are left out", FileWarning)
            rgba[:, 3] = 1
        if varies[:3].any():
            return (*WHITE[:3], float(rgba[0, 3])), rgba[:, :3]
        return tuple(map(float, rgba[0])), None


def _faces(indices: NDArray[np.int32], mode: int) -> NDArray[np.int32]:
    """(m, 3) corners of triangles, strips or fans; fronts as glTF has them."""
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    first = np.arange(max(len(indices) - 2, 0))
    if mode == _STRIP:
        odd = first % 2
        return indices[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)]
    return indices[np.stack([first + 1, first + 2, np.zeros_like(first)], axis=1)]
