"""A calibration target: meshes, and points on them that are known exactly."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats, Given, frozen_array, positions, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.scene.geometry import moves
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.materials.diffuse import Lambertian

DARK = Lambertian(0.05)
BRIGHT = Lambertian(0.8)

_SIMILAR = 1e-9
"""By how much a matrix may differ from turning and scaling, relative to its scale, for frequencies to remain known."""


@value
class Target:
    """A calibration target: meshes, and points on them that are known exactly.

    The makers in `pl.targets` put it into the plane z = 0, centred on the origin, facing +z: towards the camera.

    Parameters
    ----------
    meshes : sequence of Mesh
        Its surfaces; none of one target overlaps another one.
    points : (n, 3) array
        Known points in mm: corners, centres of dots, ends of an edge.
    index : (n, 2) array of int, optional
        Index of each point on its target, such as (row, column), as its maker documents.
    frequencies : (n,) array, optional
        Line pairs per mm of the bars around each point.
    name : str
        For the reader.
    marks : (rows, columns) array of bool, optional
        Squares that have a mark, by `marked_checkerboard`.

    Raises
    ------
    InvalidValueError
        No meshes, arrays of another shape, points that are not finite, frequencies that are not above 0.

    Examples
    --------
    >>> import plenoptic as pl
    >>> board = pl.targets.checkerboard(9, 6, square=2.0).rotated_deg((0, 1, 0), 25).translated(z=-404)
    >>> board
    Target('checkerboard', 2 meshes, 108 triangles, 40 points)
    >>> scene = pl.Scene([*board.meshes], background=1.0)
    >>> board.points[0].round(3).tolist()
    [-6.344, 4.0, -401.042]
    """

    meshes: Given[tuple[Mesh, ...], Iterable[Mesh]]
    points: Given[Floats, ArrayLike]
    index: Given[NDArray[np.int64] | None, ArrayLike | None] = Given(default=None)
    frequencies: Given[Floats | None, ArrayLike | None] = Given(default=None)
    name: str = ""
    marks: Given[NDArray[np.bool_] | None, ArrayLike | None] = Given(default=None)

    def __post_init__(self) -> None:
        meshes = tuple(self.meshes) if isinstance(self.meshes, Iterable) else ()
        if not meshes or not all(isinstance(mesh, Mesh) for mesh in meshes):
            raise InvalidValueError(f"meshes is {self.meshes!r}; it must be one Mesh or more, as in [mesh]")
        points = positions(self.points, name="points", shape=(None, 3))
        if not isinstance(self.name, str):
            raise InvalidValueError(f"name is {self.name!r}; it must be a text")
        set_field(self, "meshes", meshes)
        set_field(self, "points", points)
        if self.index is not None:
            set_field(self, "index", frozen_array(self.index, name="index", shape=(len(points), 2), dtype=np.int64))
        if self.frequencies is not None:
            frequencies = frozen_array(self.frequencies, name="frequencies", shape=(len(points),))
            if not (np.isfinite(frequencies) & (frequencies > 0)).all():
                raise InvalidValueError(
                    "frequencies hold numbers that are not finite and above 0; leave these points out"
                )
            set_field(self, "frequencies", frequencies)

        if self.marks is not None:
            set_field(self, "marks", frozen_array(self.marks, name="marks", shape=("rows", "columns"), dtype=np.bool_))

    def __repr__(self) -> str:
        name = f"{self.name!r}, " if self.name else ""
        triangles = sum(len(mesh.faces) for mesh in self.meshes)
        meshes = f"{len(self.meshes)} mesh{'' if len(self.meshes) == 1 else 'es'}"
        return f"Target({name}{meshes}, {triangles} triangles, {len(self.points)} points)"

    def transformed(self, matrix: ArrayLike) -> Target:
        """The target moved by an affine map, p' = M p, as `Mesh.transformed`: meshes and points.

        Parameters
        ----------
        matrix : (4, 4) array
            For column vectors, lengths in mm. With frequencies, which its scale divides, it must not stretch or shear.

        Raises
        ------
        InvalidValueError
            Not 4 x 4; one that stretches or shears a target with frequencies.
        SceneError
            Not finite, projective, or flattening.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> chart = pl.targets.usaf_1951([0]).transformed(np.diag([2, 2, 2, 1]))
        >>> chart.frequencies[0]
        np.float64(0.5)
        """
        # Points ride on a mesh of their own, so that they move exactly as vertices do; its triangle is beside them.
        n = len(self.points)
        carrier = Mesh(np.concatenate([self.points, np.eye(3)]), [[n, n + 1, n + 2]])
        meshes = tuple(mesh.transformed(matrix) for mesh in self.meshes)
        moved = dataclasses.replace(self, meshes=meshes, points=carrier.transformed(matrix).vertices[:n])
        if self.frequencies is None:
            return moved
        linear = np.asarray(matrix, dtype=np.float64)[:3, :3]
        scale = float(np.sqrt(np.mean(np.sum(linear**2, axis=0))))
        if not np.allclose(linear @ linear.T, scale**2 * np.eye(3), rtol=0, atol=_SIMILAR * scale**2):
            raise InvalidValueError(
                f"matrix {linear.tolist()} stretches or shears bars of known frequency; turn and scale them only, or "
                "remove the frequencies by dataclasses.replace(target, frequencies=None)"
            )
        # A turn by itself changes nothing, not by rounding either.
        turns = np.isclose(scale, 1.0, rtol=1e-14, atol=0)
        return moved if turns else dataclasses.replace(moved, frequencies=self.frequencies / scale)

    translated, rotated, rotated_deg = moves.translated, moves.rotated, moves.rotated_deg
