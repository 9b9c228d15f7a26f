"""The cells and openings of listed microlenses: the kernels."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.polygons import cut

_MOST_CORNERS = 64


@kernel
def fill_bins(bin_first, members, points, bins):
    """Sort points (n, 2) into a grid: those of bin b are members[bin_first[b]] to members[bin_first[b + 1]].

    `bins` is x, y of the grid's corner, the width of a bin, and how many there are along x and y.
    """
    rows, columns = int(bins[3]), int(bins[4])
    place = np.empty(points.shape[0], np.int64)
    for k in range(points.shape[0]):
        i = min(max(math.floor((points[k, 0] - bins[0]) / bins[2]), 0), rows - 1)
        j = min(max(math.floor((points[k, 1] - bins[1]) / bins[2]), 0), columns - 1)
        place[k] = i * columns + j
        bin_first[place[k] + 1] += 1
    for b in range(rows * columns):
        bin_first[b + 1] += bin_first[b]
    filled = bin_first[:-1].copy()
    for k in range(points.shape[0]):
        members[filled[place[k]]] = k
        filled[place[k]] += 1


@device
def _cell(x, y, xs, ys, base, k, points, voronoi, margin, reach, bins, bin_first, members):
    """Corners of the cell of point k, widened by a margin: `base`, cut by the lines half way to all near points."""
    n = base.shape[0]
    for q in range(n):
        x[q], y[q] = 8.0 * base[q, 0], 8.0 * base[q, 1]
    for q in range(base.shape[0]):
        r = q + 1 if q + 1 < base.shape[0] else 0
        a, b = base[r, 1] - base[q, 1], base[q, 0] - base[r, 0]
        n = cut(x, y, n, a, b, a * base[q, 0] + b * base[q, 1] + margin * math.hypot(a, b), xs, ys)
    if not voronoi:
        return n
    rows, columns = int(bins[3]), int(bins[4])
    low_i = max(math.floor((points[k, 0] - reach - bins[0]) / bins[2]), 0)
    low_j = max(math.floor((points[k, 1] - reach - bins[1]) / bins[2]), 0)
    high_i = min(math.floor((points[k, 0] + reach - bins[0]) / bins[2]), rows - 1)
    high_j = min(math.floor((points[k, 1] + reach - bins[1]) / bins[2]), columns - 1)
    for i in range(low_i, high_i + 1):
        for j in range(low_j, high_j + 1):
            for m in range(bin_first[i * columns + j], bin_first[i * columns + j + 1]):
                other = members[m]
                if other == k:
                    continue
                dx, dy = points[other, 0] - points[k, 0], points[other, 1] - points[k, 1]
                n = cut(x, y, n, dx, dy, 0.5 * (dx * dx + dy * dy) + margin * math.hypot(dx, dy), xs, ys)
    return n


@kernel
def fill_openings(
    cells,
    cell_counts,
    wide,
    wide_counts,
    corners,
    counts,
    points,
    shifts,
    base,
    opening,
    voronoi,
    stray,
    bins,
    bin_first,
    members,
):
    """Cells and openings of listed lenses, relative to `points` (n, 2); returns the most corners that one has.

    A cell is `base` (k, 2), for `voronoi` cut by the lines to its neighbours; `wide` is the same, widened by `stray`;
    an opening is `opening` (k, 2), shifted by `shifts` (n, 2), inside its widened cell. Arrays are (n, most, 2);
    corners beyond their room are counted and not written.
    """
    x, y = np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS)
    xs, ys = np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS)
    reach = 0.0
    for q in range(base.shape[0]):
        reach = max(reach, 2.0 * (math.hypot(base[q, 0], base[q, 1]) + stray))
    most = 0
    for k in range(points.shape[0]):
        n = _cell(x, y, xs, ys, base, k, points, voronoi, 0.0, reach, bins, bin_first, members)
        most = max(most, n)
        cell_counts[k] = n
        for q in range(min(n, cells.shape[1])):
            cells[k, q, 0], cells[k, q, 1] = x[q], y[q]
        n = _cell(x, y, xs, ys, base, k, points, voronoi, stray, reach, bins, bin_first, members)
        most = max(most, n)
        wide_counts[k] = n
        for q in range(min(n, wide.shape[1])):
            wide[k, q, 0], wide[k, q, 1] = x[q], y[q]
        sides = opening.shape[0]
        for q in range(sides):
            r = q + 1 if q + 1 < sides else 0
            a, b = opening[r, 1] - opening[q, 1], opening[q, 0] - opening[r, 0]
            limit = a * (opening[q, 0] + shifts[k, 0]) + b * (opening[q, 1] + shifts[k, 1])
            n = cut(x, y, n, a, b, limit, xs, ys)
        most = max(most, n)
        counts[k] = n
        for q in range(min(n, corners.shape[1])):
            corners[k, q, 0], corners[k, q, 1] = x[q], y[q]
    return most
