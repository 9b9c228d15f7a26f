"""Triangles and their places as the record that kernels and Embree read."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, read_only
from plenoptic.scene.geometry.geometry_records import INSTANCE_DISTANCE, Geometry, InstanceRecord

_LARGEST_SCALE = 1e10
_LARGEST_SPREAD = 16.0
"""Embree inverts the matrices of instances in float32. It holds their scale within 1e-10 and 1e10, and lets rounding
errors grow by no more than this factor: by up to 3 for rotations after scalings along the axes of the mesh, by more
for shears only. A mesh placed otherwise is copied."""


def geometry_record(
    vertices: Floats,
    triangles: NDArray[np.int32],
    triangle_material: NDArray[np.int32],
    *,
    uv: Floats | None = None,
    normals: Floats | None = None,
    instances: InstanceRecord | None = None,
) -> Geometry:
    """The record of triangles; see `Geometry` for shapes."""
    middle = read_only(middle_of(vertices, triangles))
    geometry = Geometry(vertices, triangles, triangle_material, uv, normals, None, middle)
    return geometry if instances is None else add_instances(geometry, instances)


def add_instances(geometry: Geometry, instances: InstanceRecord) -> Geometry:
    """The same triangles with instances of some of them."""
    middle = middle_of(geometry.vertices, geometry.triangles, instances)
    rows = np.column_stack([instances.matrices, np.zeros(len(instances.matrices))])
    for child in child_meshes(geometry.vertices, geometry.triangles, instances, middle):
        rows[child.instances, INSTANCE_DISTANCE] = np.abs(child.matrices[:, :, 3]).sum(axis=1)
    return geometry._replace(instance_to_world=read_only(rows), middle=read_only(middle))


class ChildMesh(NamedTuple):
    """A mesh with several transforms, and its float32 coordinates."""

    vertices: Floats
    triangles: NDArray[np.int32]
    middle: Floats
    """(3,): its own float32 coordinates count from here."""
    matrices: Floats
    """(n, 3, 4): transforms from these coordinates to those about the middle of the scene."""
    instances: NDArray[np.intp]
    """(n,): rows of the instances."""


def child_meshes(
    vertices: Floats, triangles: NDArray[np.int32], instances: InstanceRecord, middle: Floats
) -> Iterator[ChildMesh]:
    """The meshes of instances; those whose matrix float32 cannot invert are copied into the world."""
    for first, count, rows in distinct_meshes(instances):
        corners, faces = part_of(vertices, triangles[first : first + count])
        matrices = instances.matrices[rows].reshape(-1, 3, 4)
        fits = suits_float32(matrices[:, :, :3])
        if fits.any():
            mesh_middle = np.median(corners, axis=0)
            yield ChildMesh(corners, faces, mesh_middle, _relative(matrices[fits], mesh_middle, middle), rows[fits])
        for matrix, k in zip(matrices[~fits], np.flatnonzero(~fits), strict=True):
            turned = corners @ matrix[:, :3].T + matrix[:, 3]
            mesh_middle = np.median(turned, axis=0)
            yield ChildMesh(turned, faces, mesh_middle, _relative(np.eye(4)[None, :3], mesh_middle, middle), rows[[k]])


def _relative(matrices: Floats, own: Floats, middle: Floats) -> Floats:
    # p - M = A (q - m) + (A m + t - M), for points p of the world and q of the mesh and their middles M and m.
    relative = matrices.copy()
    relative[:, :, 3] += matrices[:, :, :3] @ own - middle
    return relative


def part_of(vertices: Floats, triangles: NDArray[np.int32]) -> tuple[Floats, NDArray[np.int32]]:
    """The range of vertices that some triangles use, and those triangles as rows of it."""
    low = triangles.min()
    return vertices[low : triangles.max() + 1], triangles - low if low else triangles


def middle_of(vertices: Floats, triangles: NDArray[np.int32], instances: InstanceRecord | None = None) -> Floats:
    """Median of the vertices: near the details, also within large surfaces.

    An instance counts as two opposite corners of the box around its mesh; where others stand still, those that move do
    not count, so that the coordinates of still objects are the same at all times.
    """
    if instances is None:
        return np.asarray(np.median(vertices, axis=0))
    if instances.moving is not None and (instances.plain or np.any(instances.moving < 0)):
        still = instances.some(instances.moving < 0)
        if still is None:
            return np.asarray(np.median(part_of(vertices, triangles[: instances.plain])[0], axis=0))
        instances = still
    points = [part_of(vertices, triangles[: instances.plain])[0]] if instances.plain else []
    matrices = instances.matrices.reshape(-1, 3, 4)
    for first, count, places in distinct_meshes(instances):
        corners = part_of(vertices, triangles[first : first + count])[0]
        for corner in (corners.min(axis=0), corners.max(axis=0)):
            points.append(matrices[places, :, :3] @ corner + matrices[places, :, 3])
    return np.asarray(np.median(np.concatenate(points), axis=0))


def distinct_meshes(instances: InstanceRecord) -> list[tuple[int, int, NDArray[np.intp]]]:
    """First triangle, number of triangles and rows of the instances of each mesh."""
    firsts, mesh = np.unique(instances.first, return_inverse=True)
    order = np.argsort(mesh, kind="stable")
    groups = np.split(order, np.searchsorted(mesh[order], np.arange(1, len(firsts))))
    return [(int(instances.first[rows[0]]), int(instances.faces[rows[0]]), rows) for rows in groups]


def suits_float32(linear: Floats) -> NDArray[np.bool_]:
    """True for matrices (n, 3, 3) that can be inverted in float32 without much loss."""
    scale = np.linalg.norm(linear, axis=1)
    suits: NDArray[np.bool_] = ((scale > 1 / _LARGEST_SCALE) & (scale < _LARGEST_SCALE)).all(axis=1)
    suits[suits] = _spread(linear[suits]) < _LARGEST_SPREAD
    return suits


def _spread(linear: Floats) -> Floats:
    """Largest row sum of |A| |A^-1|: by how much errors grow on the way into the frame of a mesh and back."""
    # With columns of unit length, which changes nothing in the product, no inverse overflows.
    unit = linear / np.linalg.norm(linear, axis=1, keepdims=True)
    flat = np.abs(np.linalg.det(unit)) < np.finfo(np.float64).eps
    unit[flat] = np.eye(3)
    spread: Floats = (np.abs(unit) @ np.abs(np.linalg.inv(unit))).sum(axis=2).max(axis=1)
    return np.where(flat, np.inf, spread)
