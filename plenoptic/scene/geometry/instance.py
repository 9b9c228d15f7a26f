"""Instances: one mesh at many places, its triangles stored once."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.motions.motion import Motion
from plenoptic.core.values import (
    LARGEST_LENGTH,
    Floats,
    Given,
    check_kind,
    checked_field,
    contiguous,
    frozen_array,
    read_only,
    value,
)
from plenoptic.errors import SceneError
from plenoptic.scene.geometry import moves
from plenoptic.scene.geometry.geometry_records import InstanceRecord
from plenoptic.scene.geometry.mesh import Mesh, affine_determinants
from plenoptic.scene.materials.registry import Material


@value
class Instances:
    """A mesh repeated at many places, with no copy of its triangles.

    A place costs some 700 bytes, and 7 microseconds before rendering, for meshes of any size; a copy costs some
    130 bytes and 0.7 microseconds for each triangle (tests/benchmarks/large_scenes.py).

    Parameters
    ----------
    mesh : Mesh
        In a frame of its own, mm.
    matrices : (n, 4, 4) array
        From the mesh's frame to the world, for column vectors: p' = M p, lengths in mm. Where a matrix mirrors, the
        front of the mesh stays the front.
    motion : Motion, optional
        Motion of all of them from there, by the time in s from the middle of an exposure, as a `Sequence` gives it to
        moving objects. It shows where the camera has a `Shutter`. None: they stand still.

    Raises
    ------
    InvalidValueError
        Something that is not a mesh or a motion, or an array of another shape.
    SceneError
        No place; a matrix that is not finite, projective, flattening (determinant 0), or leads beyond 1e15 mm.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> places = np.tile(np.eye(4), (3, 1, 1))
    >>> places[:, 0, 3] = -10, 0, 10
    >>> row = pl.scene.Instances(pl.box(4), places)
    >>> row
    Instances(3 of Mesh(24 vertices, 12 triangles, Lambertian()))
    >>> len(row), row.bounds[:, 0].tolist()
    (3, [-12.0, 12.0])
    """

    mesh: Mesh
    matrices: Given[Floats, ArrayLike] = checked_field(frozen_array, shape=(None, 4, 4))
    motion: Motion | None = None

    def __post_init__(self) -> None:
        check_kind(self.mesh, "mesh", Mesh, "pl.box(4)")
        if self.motion is not None:
            check_kind(self.motion, "motion", Motion, "pl.Motion.screw((0, 1), axis=(0, 1, 0), angle_deg=90)")
        if not len(self.matrices):
            raise SceneError("matrices has no rows; give at least one place, or leave the instances out")
        with np.errstate(over="ignore", invalid="ignore"):
            affine_determinants(self.matrices)
            low, high = self.bounds
        if not np.abs([low, high]).max() <= LARGEST_LENGTH:
            raise SceneError(
                f"the instances reach from {low.tolist()} to {high.tolist()} mm; they must stay within +-1e15 mm: "
                "check the units of mesh and matrices"
            )

    def __len__(self) -> int:
        return len(self.matrices)

    def __repr__(self) -> str:
        return f"Instances({len(self)} of {self.mesh!r}{'' if self.motion is None else ', moving'})"

    @cached_property
    def bounds(self) -> Floats:
        """(2, 3), mm: the lowest and the highest corner of all triangles in the world.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> pl.scene.Instances(pl.box((2, 4, 6)), [np.diag([1, 2, 3, 1])]).bounds[1].tolist()
        [1.0, 4.0, 9.0]
        """
        points = self.mesh.vertices[np.unique(self.mesh.faces)]
        lowest = [-_farthest(points, -self.matrices[:, k]) for k in range(3)]
        return read_only(np.array([lowest, [_farthest(points, self.matrices[:, k]) for k in range(3)]]))

    def transformed(self, matrix: ArrayLike) -> Instances:
        """All instances moved by an affine map of the world, p' = M p; as allowed for `Mesh.transformed`.

        With a motion, the map must turn, shift and scale equally in all directions.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> pl.scene.Instances(pl.box(2), [np.eye(4)]).transformed(np.diag([3, 1, 1, 1])).bounds[1].tolist()
        [3.0, 1.0, 1.0]
        """
        full = frozen_array(matrix, name="matrix", shape=(4, 4))
        affine_determinants(full[None])
        motion = self.motion
        if motion is not None:
            full, scale = moves.similarity(full)
            motion = motion.in_frame(full[:3, :3] / scale, full[:3, 3], scale)
        return dataclasses.replace(self, matrices=full @ self.matrices, motion=motion)

    translated, rotated, rotated_deg, scaled = moves.translated, moves.rotated, moves.rotated_deg, moves.scaled

    def with_material(self, material: Material) -> Instances:
        """The same places of a mesh of another material.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> pl.scene.Instances(pl.box(2), [np.eye(4)]).with_material(pl.Lambertian(0.8)).mesh.material
        Lambertian(albedo=0.8)
        """
        return dataclasses.replace(self, mesh=self.mesh.with_material(material))

    def meshes(self) -> tuple[Mesh, ...]:
        """Plain copies, one for each place, as many times as large in memory.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> (copy,) = pl.scene.Instances(pl.box(2), [np.diag([1, 1, 2, 1])]).meshes()
        >>> copy.bounds[1].tolist()
        [1.0, 1.0, 2.0]
        """
        return tuple(self.mesh.transformed(matrix) for matrix in self.matrices)


def instance_record(instances: Sequence[Instances], first: Sequence[int]) -> InstanceRecord | None:
    """Instances as plain arrays; None where there are none. `first` holds the row of `triangles` at which those of each
    one's mesh begin, the same for those of one mesh; the lowest is the number of plain triangles.
    """
    if not instances:
        return None
    matrices = np.concatenate([one.matrices for one in instances])
    lengths = [len(one) for one in instances]
    numbers = np.cumsum([one.motion is not None for one in instances]) - 1
    moving = np.array([-1 if one.motion is None else k for one, k in zip(instances, numbers, strict=True)], np.int32)
    return InstanceRecord(
        matrices=contiguous(matrices[:, :3].reshape(-1, 12)),
        first=contiguous(np.repeat(np.asarray(first, dtype=np.int32), lengths)),
        faces=contiguous(np.repeat(np.array([len(one.mesh.faces) for one in instances], dtype=np.int32), lengths)),
        plain=int(min(first)),
        moving=contiguous(np.repeat(moving, lengths)) if np.any(moving >= 0) else None,
    )


def _farthest(points: Floats, rows: Floats) -> float:
    """Largest coordinate of any point (n, 3) in any place, given the row (m, 4) of each place's matrix for it.

    Places are tried in the order of the most that a box and a sphere around the points allow, until none can be
    farther: few are, out of a million.
    """
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    linear, half = rows[:, :3], np.abs(points - middle).max(axis=0)
    radius = np.linalg.norm(points - middle, axis=1).max() * (1 + 1e-12)
    allowed = np.minimum(np.abs(linear) @ half, np.linalg.norm(linear, axis=1) * radius) + linear @ middle + rows[:, 3]
    farthest = -np.inf
    for k in np.argsort(-allowed):
        if allowed[k] <= farthest:
            break
        farthest = max(farthest, float((points @ linear[k]).max() + rows[k, 3]))
    return farthest
