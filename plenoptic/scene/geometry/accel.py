"""What finds the triangle that a ray meets."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.geometry.instance import InstanceTables

_LARGEST_SCALE = 1e10
_LARGEST_SPREAD = 16.0
"""Embree inverts the matrices of instances in float32. It holds their scale within 1e-10 and 1e10, and lets rounding
errors grow by no more than this factor: by up to 3 for rotations after scalings along the axes of the mesh, by more
for shears only. A mesh placed otherwise is copied."""


class Intersector(Protocol):
    """Finds triangles, as float32 goes; the exact hit is computed from the triangle afterwards."""

    middle: NDArray[np.float64]
    """(3,): float32 coordinates count from here, so that a scene far from the world's origin loses no digits."""
    placements: NDArray[np.float64] | None
    """(ni, 13): the matrix of each instance, and how far, |x| + |y| + |z| in mm, its mesh has the middle from which its
    own coordinates count from that of the scene: rays are turned into its frame in float32, and err by units of this.
    None without instances."""

    def fill_closest(
        self,
        hits: NDArray[np.int32],
        rays: NDArray[np.float64],
        *,
        coherent: bool,
        placed: NDArray[np.int32] | None = None,
    ) -> None:
        """Triangle that each ray (origin and direction, (n, 6)) meets first, or -1; and its instance.

        `hits` are rows of `triangles`, `placed` rows of the instances, -1 for plain triangles and where there is no
        hit. `coherent` says that neighbouring rays go nearly the same way, as those of a pixel do; it changes nothing
        but the time (a third less where it is so, up to three times as much where it is not), and which of two
        triangles at the very same place is found, inside both: that may then depend on the rays beside it.
        """

    def fill_blocked(self, blocked: NDArray[np.uint8], rays: NDArray[np.float64]) -> None:
        """1 where something lies between a ray's origin and origin + direction, else 0."""


def part_of(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """The range of vertices that some triangles use, and those triangles as rows of it."""
    low = triangles.min()
    return vertices[low : triangles.max() + 1], triangles - low if low else triangles


def middle_of(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32], instances: InstanceTables | None = None
) -> NDArray[np.float64]:
    """Median of the vertices: where the details are, whatever large surfaces lie around them.

    An instance counts as two opposite corners of the box around its mesh.
    """
    if instances is None:
        return np.asarray(np.median(vertices, axis=0))
    points = [part_of(vertices, triangles[: instances.plain])[0]] if instances.plain else []
    matrices = instances.matrices.reshape(-1, 3, 4)
    for first, count, places in distinct_meshes(instances):
        corners = part_of(vertices, triangles[first : first + count])[0]
        for corner in (corners.min(axis=0), corners.max(axis=0)):
            points.append(matrices[places, :, :3] @ corner + matrices[places, :, 3])
    return np.asarray(np.median(np.concatenate(points), axis=0))


def distinct_meshes(instances: InstanceTables) -> list[tuple[int, int, NDArray[np.intp]]]:
    """First triangle, number of triangles and rows of the instances of each mesh."""
    firsts, mesh = np.unique(instances.first, return_inverse=True)
    order = np.argsort(mesh, kind="stable")
    groups = np.split(order, np.searchsorted(mesh[order], np.arange(1, len(firsts))))
    return [(int(instances.first[rows[0]]), int(instances.count[rows[0]]), rows) for rows in groups]


def suits_float32(linear: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the matrices (n, 3, 3) can be inverted in float32 without much loss."""
    scale = np.linalg.norm(linear, axis=1)
    suits: NDArray[np.bool_] = ((scale > 1 / _LARGEST_SCALE) & (scale < _LARGEST_SCALE)).all(axis=1)
    suits[suits] = _spread(linear[suits]) < _LARGEST_SPREAD
    return suits


def _spread(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest row sum of |A| |A^-1|: by how much errors grow on the way into the frame of a mesh and back."""
    # With columns of unit length, which changes nothing in the product, no inverse overflows.
    unit = linear / np.linalg.norm(linear, axis=1, keepdims=True)
    flat = np.abs(np.linalg.det(unit)) < np.finfo(np.float64).eps
    unit[flat] = np.eye(3)
    spread: NDArray[np.float64] = (np.abs(unit) @ np.abs(np.linalg.inv(unit))).sum(axis=2).max(axis=1)
    return np.where(flat, np.inf, spread)


def placements_of(instances: InstanceTables | None) -> NDArray[np.float64] | None:
    """The matrices of instances, with a column of zeros behind."""
    if instances is None:
        return None
    return np.column_stack([instances.matrices, np.zeros(len(instances.matrices))])


def build_intersector(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32], instances: InstanceTables | None = None
) -> Intersector:
    """Embree through its C library, or through `EmbreeScene.run` where that cannot be had.

    Parameters
    ----------
    vertices : (nv, 3) array
        mm; those of instanced meshes in frames of their own.
    triangles : (nt, 3) array of int32
        Rows of `vertices`; plain triangles first.
    instances : InstanceTables or None
        None: all triangles are plain.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> from plenoptic.scene.geometry.accel import build_intersector
    >>> tables = pl.white_plane().tables()
    >>> hits = np.empty(2, np.int32)
    >>> rays = np.array([[10, 20, 0, 0, 0, -1.0], [10, 20, 0, 0, 0, 1.0]])
    >>> build_intersector(tables.vertices, tables.triangles).fill_closest(hits, rays, coherent=False)
    >>> hits.tolist()
    [1, -1]
    """
    try:
        from plenoptic.scene.geometry.kernels.embree import EmbreeTriangles
    except ImportError:
        from plenoptic.scene.geometry.embree_run import SceneRunTriangles

        return SceneRunTriangles(vertices, triangles, instances)
    return EmbreeTriangles(vertices, triangles, instances)
