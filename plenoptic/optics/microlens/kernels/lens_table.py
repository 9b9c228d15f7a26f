"""Cells and openings of the lenses in a lens table: kernels."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.polygons import cut
from plenoptic.core.numba.jit import device, kernel

_MAX_CORNERS = 64


@device
def bins_around(x, y, reach, bins):
    """First and last row, first and last column of the bins of points within `reach` along x and y."""
    low_i = max(math.floor((x - reach - bins.x) / bins.width), 0)
    low_j = max(math.floor((y - reach - bins.y) / bins.width), 0)
    high_i = min(math.floor((x + reach - bins.x) / bins.width), bins.rows - 1)
    high_j = min(math.floor((y + reach - bins.y) / bins.width), bins.columns - 1)
    return low_i, high_i, low_j, high_j


@kernel
def fill_bins(bins, points):
    """Sort points (n, 2) into a grid of bins (see `BinsRecord`), which is empty on entry."""
    first, members = bins.first, bins.members
    bin_of = np.empty(points.shape[0], np.int64)
    for k in range(points.shape[0]):
        i = min(max(math.floor((points[k, 0] - bins.x) / bins.width), 0), bins.rows - 1)
        j = min(max(math.floor((points[k, 1] - bins.y) / bins.width), 0), bins.columns - 1)
        bin_of[k] = i * bins.columns + j
        first[bin_of[k] + 1] += 1
    for b in range(bins.rows * bins.columns):
        first[b + 1] += first[b]
    cursor = first[:-1].copy()
    for k in range(points.shape[0]):
        members[cursor[bin_of[k]]] = k
        cursor[bin_of[k]] += 1


@device
def _clip_by_edges(polygon, n, corners, shift, margin):
    """Clip a polygon of n corners by the edges of another one, moved outwards by a margin; return its new number."""
    sides = corners.shape[0]
    for q in range(sides):
        r = q + 1 if q + 1 < sides else 0
        a, b = corners[r, 1] - corners[q, 1], corners[q, 0] - corners[r, 0]
        limit = a * (corners[q, 0] + shift[0]) + b * (corners[q, 1] + shift[1])
        n = cut(polygon, 0, n, a, b, limit + margin * math.hypot(a, b))
    return n


@kernel
def fill_cells(cells, counts, points, base, margin, reach, neighbours):
    """Cells of the lenses at `points` (n, 2), relative to these; return the largest number of corners.

    A cell is `base` (k, 2), widened by a margin. With bins of `neighbours`, it is clipped by the perpendicular
    bisectors to all points within `reach`, moved outwards by the margin. `cells` is (n, room, 2); corners beyond the
    room are counted and not written.
    """
    polygon = np.empty((3, _MAX_CORNERS))
    max_corners = 0
    for k in range(points.shape[0]):
        n = base.shape[0]
        for q in range(n):
            polygon[0, q], polygon[1, q] = 8.0 * base[q, 0], 8.0 * base[q, 1]
        n = _clip_by_edges(polygon, n, base, (0.0, 0.0), margin)
        if neighbours is not None:
            low_i, high_i, low_j, high_j = bins_around(points[k, 0], points[k, 1], reach, neighbours)
            for i in range(low_i, high_i + 1):
                for j in range(low_j, high_j + 1):
                    b = i * neighbours.columns + j
                    for m in range(neighbours.first[b], neighbours.first[b + 1]):
                        other = neighbours.members[m]
                        if other == k:
                            continue
                        dx, dy = points[other, 0] - points[k, 0], points[other, 1] - points[k, 1]
                        limit = 0.5 * (dx * dx + dy * dy) + margin * math.hypot(dx, dy)
                        if n < _MAX_CORNERS:
                            n = cut(polygon, 0, n, dx, dy, limit)
        max_corners = max(max_corners, n)
        counts[k] = n
        for q in range(min(n, cells.shape[1])):
            cells[k, q, 0], cells[k, q, 1] = polygon[0, q], polygon[1, q]
    return max_corners


@kernel
def fill_openings(corners, counts, cells, cell_counts, opening, shifts):
    """Openings of listed lenses: `opening` (k, 2), displaced by `shifts` (n, 2), clipped by their cells.

    Returns the largest number of corners; see `fill_cells`.
    """
    polygon = np.empty((3, _MAX_CORNERS))
    max_corners = 0
    for k in range(cells.shape[0]):
        n = cell_counts[k]
        for q in range(n):
            polygon[0, q], polygon[1, q] = cells[k, q, 0], cells[k, q, 1]
        n = _clip_by_edges(polygon, n, opening, (shifts[k, 0], shifts[k, 1]), 0.0)
        max_corners = max(max_corners, n)
        counts[k] = n
        for q in range(min(n, corners.shape[1])):
            corners[k, q, 0], corners[k, q, 1] = polygon[0, q], polygon[1, q]
    return max_corners
