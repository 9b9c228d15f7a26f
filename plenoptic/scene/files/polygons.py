"""Polygons of mesh files as triangles, and vertices that corners share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.errors import FileError

Indices = NDArray[np.int64]

_CONCAVE = 1e-9
"""Area of a fan's triangle that counts as turned over, in parts of the polygon's area: far above rounding."""
_CUBES = 10**12
"""Sum of the cubes of the numbers of corners of concave polygons; that of one spiral takes 2.3 s."""


def triangulate(points: Floats, lengths: Indices, corners: Indices) -> tuple[Indices, Indices]:
    """Triangles of polygons with given numbers of corners, which follow one another in `corners`, rows of `points`.

    Returns (m, 3) positions in `corners`, in the winding of their polygon, and (m,) the polygon of each. Polygons are
    fans around their first corner unless one of the fan's triangles would be turned over; these are concave, and
    their ears are clipped in the plane of their vector area, unless they cross themselves there. Less than three
    corners make no triangle.
    """
    if np.all(lengths == 3):
        return np.arange(len(corners)).reshape(-1, 3), np.arange(len(lengths))
    count = np.maximum(lengths - 2, 0)
    polygon = np.repeat(np.arange(len(lengths)), count)
    number = np.arange(len(polygon)) - np.repeat(np.cumsum(count) - count, count)
    starts = np.cumsum(lengths) - lengths
    first = starts[polygon]
    triangles = np.stack([first, first + number + 1, first + number + 2], axis=1)
    several = np.flatnonzero(count > 1)
    if len(several) == 0:
        return triangles, polygon
    a, b, c = (points[corners[column]] for column in triangles[np.repeat(count > 1, count)].T)
    u, v = b - a, c - a
    areas = u[:, [1, 2, 0]] * v[:, [2, 0, 1]] - u[:, [2, 0, 1]] * v[:, [1, 2, 0]]
    begin = np.cumsum(count[several]) - count[several]
    normals = np.add.reduceat(areas, begin)
    with np.errstate(all="ignore"):  # infinite vertices are refused by name
        shares = (areas * np.repeat(normals, count[several], axis=0)).sum(axis=1)
        concave = np.minimum.reduceat(shares, begin) < -_CONCAVE * (normals**2).sum(axis=1)
    if float((lengths[several[concave]].astype(np.float64) ** 3).sum()) > _CUBES:
        raise FileError(f"it has concave faces of up to {lengths[several[concave]].max()} corners; divide them")
    is_fan, parts = np.ones(len(lengths), dtype=bool), []
    for k, normal in zip(several[concave], normals[concave], strict=True):
        ears = starts[k] + _ears(points[corners[starts[k] : starts[k] + lengths[k]]], normal)
        is_fan[k] = len(ears) == 0
        parts.append((ears, np.full(len(ears), k)))
    if not parts:
        return triangles, polygon
    ears, owners = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    fans = is_fan[polygon]
    polygon = np.concatenate([polygon[fans], owners])
    order = np.argsort(polygon, kind="stable")
    return np.concatenate([triangles[fans], ears])[order], polygon[order]


def _ears(points: Floats, normal: Floats) -> Indices:
    """(m, 3) corners of the triangles of one polygon, in its order; none if it crosses itself in its plane."""
    from mapbox_earcut import triangulate_float64

    axis = int(np.argmax(np.abs(normal)))
    plane = np.ascontiguousarray(points[:, [(axis + 1) % 3, (axis + 2) % 3]])
    corners = triangulate_float64(plane, np.array([len(points)], dtype=np.uint32))
    ears: Indices = np.sort(corners.astype(np.int64).reshape(-1, 3), axis=1)
    a, b, c = points[ears.T]
    # Any division of a polygon, flat or not, has its vector area.
    whole = np.allclose(np.cross(b - a, c - a).sum(axis=0), normal, rtol=0, atol=0.01 * np.abs(normal).max())
    return ears if whole else ears[:0]


def shared_vertices(first: Indices, *others: Indices | None) -> tuple[NDArray[np.int32], Indices]:
    """Vertices of corners, each a combination of rows of several arrays: one vertex for each combination.

    Returns the vertex of each corner, and a corner of each vertex, in the order of the rows of `first`.
    """
    key = first
    for other in others:
        if other is not None and other is not first and not np.array_equal(other, first):
            largest = int(other.max(initial=0)) + 2
            if int(key.max(initial=0)) > (1 << 62) // largest:
                key = np.unique(key, return_inverse=True)[1]
            key = key * largest + other + 1
    if key is not first:
        _, corner, vertex = np.unique(key, return_index=True, return_inverse=True)
        return vertex.astype(np.int32), corner
    corner_of = np.full(int(first.max(initial=-1)) + 1, -1, dtype=np.int64)
    corner_of[first] = np.arange(len(first))
    used = corner_of >= 0
    return (np.cumsum(used, dtype=np.int32) - 1)[first], corner_of[used]
