"""Triangle meshes: one surface of one material."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import LARGEST_LENGTH, Floats, Given, frozen_array, plain_array, read_only, set_field, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.geometry import moves
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.registry import MATERIALS, Material

_CLOSED = 1e-6
"""Sum of the areas of a closed mesh as vectors, over that of their sizes, at most."""


@value
class Mesh:
    """Triangles of one material.

    The front of a triangle is the side from which its vertices wind counter-clockwise.

    Parameters
    ----------
    vertices : (n, 3) array
        Corners, mm, finite.
    faces : (m, 3) array of int
        The rows of `vertices` that make up each triangle. Triangles without area may be among them, not all of them.
    material : Material
        One of `pl.materials`; a textured one needs `uv`.
    normals : (n, 3) array or None
        Smooth shading normals at the vertices, brought to unit length; zeros mean a flat surface. None: flat triangles.
    uv : (n, 2) array or None
        Texture coordinates; (0, 0) is the lower left corner of the image, (1, 1) the upper right one.
    name : str
        Name in `object_names`, files and warnings.

    Raises
    ------
    InvalidValueError
        Arrays of another shape, another material, or a name that is not a str.
    SceneError
        No triangles, no area, numbers that are not finite, indices out of range, a texture without `uv`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> mesh = pl.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], pl.Lambertian(0.8))
    >>> mesh
    Mesh(3 vertices, 1 triangle, Lambertian(albedo=0.8))
    """

    vertices: Given[Floats, ArrayLike]
    faces: Given[NDArray[np.int32], ArrayLike]
    material: Material = Lambertian()
    normals: Given[Floats | None, ArrayLike | None] = Given(default=None)
    uv: Given[Floats | None, ArrayLike | None] = Given(default=None)
    name: str = ""

    def __post_init__(self) -> None:
        vertices = frozen_array(self.vertices, name="vertices", shape=(None, 3))
        faces = _faces(self.faces, len(vertices))
        _check_range(vertices, "vertices", "repair the mesh, or check its unit")
        if not has_area(vertices, faces):
            raise SceneError(f"all {len(faces)} triangles have zero area; spread the vertices or leave the mesh out")
        if type(self.material) not in MATERIALS:
            names = ", ".join(kind.__name__ for kind in MATERIALS)
            raise InvalidValueError(f"material is {self.material!r}; it must be one of {names}")
        if not isinstance(self.name, str):
            raise InvalidValueError(f"name is {self.name!r}; it must be a text")
        if self.normals is not None:
            normals = frozen_array(self.normals, name="normals", shape=(len(vertices), 3))
            _check_range(normals, "normals", "give None for flat triangles")
            set_field(self, "normals", _unit_rows(normals))
        if self.uv is not None:
            uv = frozen_array(self.uv, name="uv", shape=(len(vertices), 2))
            _check_range(uv, "uv", "map the mesh again")
            set_field(self, "uv", uv)
        elif self.material.row().textures:
            raise SceneError("the material has a texture and uv is None; give uv, or a material without a texture")
        set_field(self, "vertices", vertices)
        set_field(self, "faces", faces)

    def __repr__(self) -> str:
        name = f"{self.name!r}, " if self.name else ""
        triangles = f"{len(self.faces)} triangle{'' if len(self.faces) == 1 else 's'}"
        return f"Mesh({name}{len(self.vertices)} vertices, {triangles}, {self.material!r})"

    @cached_property
    def bounds(self) -> Floats:
        """(2, 3), mm: the lowest and the highest corner of its triangles.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.box((2, 4, 6)).bounds.tolist()
        [[-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]]
        """
        used = np.zeros(len(self.vertices), dtype=bool)
        used[self.faces.ravel()] = True
        points = self.vertices[used]
        return read_only(np.array([points.min(axis=0), points.max(axis=0)]))

    @cached_property
    def is_inside_out(self) -> bool:
        """True if the mesh is closed and its faces wind inwards: its volume is negative."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        areas = np.cross(b - a, c - a)
        is_closed = np.abs(areas.sum(axis=0)).max() < _CLOSED * np.abs(areas).sum()
        return bool(is_closed and np.einsum("ij,ij->", a - self.bounds[0], areas) < 0.0)

    def transformed(self, matrix: ArrayLike) -> Mesh:
        """The mesh moved by an affine map, p' = M p; normals by the inverse transpose of its 3 x 3 part.

        Parameters
        ----------
        matrix : (4, 4) array
            For column vectors, lengths in mm. Where it mirrors, the winding is turned: the front stays the front.

        Raises
        ------
        InvalidValueError
            Not 4 x 4.
        SceneError
            Not finite, projective (last row not 0, 0, 0, 1), or flattening (determinant 0).

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> pl.box(2).transformed(np.diag([1, 2, 3, 1])).bounds[1].tolist()
        [1.0, 2.0, 3.0]
        """
        full = frozen_array(matrix, name="matrix", shape=(4, 4))
        (determinant,) = affine_determinants(full[None])
        linear, shift = full[:3, :3], full[:3, 3]
        return dataclasses.replace(
            self,
            vertices=self.vertices @ linear.T + shift,
            faces=self.faces[:, [0, 2, 1]] if determinant < 0 else self.faces,
            # (M^-T n)^T = n^T M^-1; the scale, which is lost anyway, must not under- or overflow.
            normals=None if self.normals is None else self.normals @ np.linalg.inv(linear / np.abs(linear).max()),
        )

    translated, rotated, rotated_deg, scaled = moves.translated, moves.rotated, moves.rotated_deg, moves.scaled

    def with_material(self, material: Material) -> Mesh:
        """The same mesh of another material.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.box(2).with_material(pl.Emissive(3.0)).material
        Emissive(radiance=3.0)
        """
        return dataclasses.replace(self, material=material)


def affine_determinants(matrices: Floats) -> Floats:
    """(n,): determinants of the 3 x 3 parts of matrices (n, 4, 4), which must be affine and not flatten."""
    with np.errstate(all="ignore"):
        determinants = np.asarray(np.linalg.det(matrices[:, :3, :3]))
    affine = np.isfinite(matrices).all(axis=(1, 2)) & (matrices[:, 3] == (0, 0, 0, 1)).all(axis=1)
    for fits, requirement in (
        (affine, "it must be finite and end with the row 0, 0, 0, 1"),
        (determinants != 0, "it flattens the mesh; its determinant must not be 0"),
    ):
        if not fits.all():
            k = int(np.argmin(fits))
            name = f"matrix {k}" if len(matrices) > 1 else "matrix"
            raise SceneError(f"{name} is {matrices[k].tolist()}; {requirement}")
    return determinants


def _faces(faces: ArrayLike, count: int) -> NDArray[np.int32]:
    """(m, 3) int32, with each index in range; floats that are whole numbers will do."""
    indices = plain_array(faces, "faces")
    if indices.size == 0:
        raise SceneError("the mesh has no triangles; give at least one row of faces, or leave the mesh out")
    rows = frozen_array(indices, name="faces", shape=(None, 3), dtype=np.int32)
    low, high = rows.min(), rows.max()
    if low < 0 or high >= count:
        raise SceneError(f"faces names vertex {low if low < 0 else high}; it must be within 0 and {count - 1}")
    return rows


def _check_range(array: Floats, name: str, remedy: str) -> None:
    # min and max hand NaN on, so this sees everything without temporaries.
    low, high = float(array.min()), float(array.max())
    if not (low >= -LARGEST_LENGTH and high <= LARGEST_LENGTH):
        raise SceneError(f"{name} lie within {low:g} and {high:g}; they must be finite and within +-1e15: {remedy}")


def has_area(vertices: Floats, faces: NDArray[np.integer[Any]], block: int = 1 << 16) -> bool:
    """True if any triangle has an area; ends at the first block that has."""
    for start in range(0, len(faces), block):
        a, b, c = (vertices[faces[start : start + block, k]] for k in range(3))
        u, v = b - a, c - a
        if (u[:, [1, 2, 0]] * v[:, [2, 0, 1]] - u[:, [2, 0, 1]] * v[:, [1, 2, 0]]).any():
            return True
    return False


def _unit_rows(normals: Floats) -> Floats:
    """Rows at unit length; rows of unit length to rounding, and zeros, keep their bits."""
    largest = np.abs(normals).max(axis=1, keepdims=True)
    # The largest component first, so that squares of tiny ones do not vanish.
    scaled = np.divide(normals, largest, out=np.zeros_like(normals), where=largest > 0)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    unit = np.divide(scaled, length, out=scaled, where=length > 0)
    unit = np.where(np.abs(length * largest - 1) > 1e-15, unit, normals)
    unit.flags.writeable = False
    return unit
