"""The part of the microlens plane from which light can reach a pixel, as triangles: the kernels.

For each pixel and each microlens that may feed it, the microlens's cell is cut with the outline of the
exit pupil as seen through the lens from the pixel (an affine map in the thin-lens limit, which is where
margins for thick microlenses come in). What is left is a convex polygon, kept as a fan of triangles.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic._jit import device, kernel

TRIANGLE = 9
"""Numbers of a triangle: corner x, y; two edges x, y; area up to and with this triangle; centre of its cell."""

_MOST_CORNERS = 32


@device
def _cut(x, y, n, a, b, limit, xs, ys):
    """Cut a convex polygon with the half-plane a x + b y <= limit; returns the number of corners left."""
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = limit - (a * x[i] + b * y[i])
        there = limit - (a * x[j] + b * y[j])
        if here >= 0.0:
            xs[kept] = x[i]
            ys[kept] = y[i]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            f = here / (here - there)
            xs[kept] = x[i] + f * (x[j] - x[i])
            ys[kept] = y[i] + f * (y[j] - y[i])
            kept += 1
    for i in range(kept):
        x[i] = xs[i]
        y[i] = ys[i]
    return kept


@device
def _store_fan(triangles, used, x, y, n, shift_x, shift_y, cx, cy, area):
    """Append a polygon as a fan of triangles; returns the triangles used and the area so far."""
    for k in range(1, n - 1):
        ax, ay = x[k] - x[0], y[k] - y[0]
        bx, by = x[k + 1] - x[0], y[k + 1] - y[0]
        twice = ax * by - ay * bx
        if twice <= 0.0:
            continue
        area += 0.5 * twice
        if used < triangles.shape[0]:
            row = triangles[used]
            row[0], row[1] = x[0] + shift_x, y[0] + shift_y
            row[2], row[3], row[4], row[5] = ax, ay, bx, by
            row[6] = area
            row[7], row[8] = cx, cy
        used += 1
    return used, area


@kernel
def fill_cell_regions(
    triangles, first, pixels, pixel_margin, basis, inverse, cell, ratio, bend, slack, normals, support, reach, step
):
    """Regions of the pixels whose centres are `pixels` (n, 2); returns the number of triangles they need.

    A ray from the sensor at s through the point c + d of the cell with centre c meets the plane of the
    outlines at c + ratio (c - s) + bend d. `slack` is how far a real microlens strays from that there,
    `cell` the (slightly widened) corners of a cell. Pixels no light reaches get no triangle. Where the room in
    `triangles` is too small nothing beyond it is written.
    """
    corners = cell.shape[0]
    x, y = np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS)
    xs, ys = np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS)
    cell_radius = 0.0
    for i in range(corners):
        cell_radius = max(cell_radius, math.hypot(cell[i, 0], cell[i, 1]))
    spread = abs(bend) * cell_radius
    margin = slack + ratio * pixel_margin
    largest = 0.0
    for i in range(reach.size):
        largest = max(largest, reach[i])
    search = (largest + spread + margin) / (1.0 + ratio)
    span_i = search * math.hypot(inverse[0, 0], inverse[1, 0])
    span_j = search * math.hypot(inverse[0, 1], inverse[1, 1])
    used = 0
    for p in range(pixels.shape[0]):
        first[p] = used
        sx, sy = pixels[p, 0], pixels[p, 1]
        mx, my = sx * ratio / (1.0 + ratio), sy * ratio / (1.0 + ratio)
        mid_i = mx * inverse[0, 0] + my * inverse[1, 0]
        mid_j = mx * inverse[0, 1] + my * inverse[1, 1]
        area = 0.0
        for i in range(math.ceil(mid_i - span_i), math.floor(mid_i + span_i) + 1):
            for j in range(math.ceil(mid_j - span_j), math.floor(mid_j + span_j) + 1):
                cx = i * basis[0, 0] + j * basis[1, 0]
                cy = i * basis[0, 1] + j * basis[1, 1]
                qx, qy = cx + ratio * (cx - sx), cy + ratio * (cy - sy)
                rho = math.hypot(cx, cy)
                interval = int(rho / step)
                if interval >= reach.size:
                    continue
                limit = reach[interval] + spread + margin
                if qx * qx + qy * qy > limit * limit:
                    continue
                # Turn the axes so that the cell's centre lies on +x, as the outlines have it.
                cos, sin = (cx / rho, cy / rho) if rho > 0.0 else (1.0, 0.0)
                tx, ty = cos * qx + sin * qy, cos * qy - sin * qx
                n = -1
                for k in range(normals.shape[0]):
                    room = support[interval, k] + margin - (normals[k, 0] * tx + normals[k, 1] * ty)
                    if room >= spread:
                        continue
                    if room < -spread:
                        n = 0
                        break
                    if n < 0:
                        n = corners
                        for q in range(corners):
                            x[q], y[q] = cell[q, 0], cell[q, 1]
                    # The side's normal, turned back.
                    ux = cos * normals[k, 0] - sin * normals[k, 1]
                    uy = sin * normals[k, 0] + cos * normals[k, 1]
                    n = _cut(x, y, n, bend * ux, bend * uy, room, xs, ys)
                    if n == 0:
                        break
                if n < 0:
                    n = corners
                    for q in range(corners):
                        x[q], y[q] = cell[q, 0], cell[q, 1]
                used, area = _store_fan(triangles, used, x, y, n, cx, cy, cx, cy, area)
    first[pixels.shape[0]] = used
    return used


@kernel
def fill_pupil_regions(triangles, first, pixels, corners, reach, step):
    """Without microlenses: the outline of the pupil itself, seen from each pixel."""
    sides = corners.shape[1]
    x, y = np.empty(sides), np.empty(sides)
    used = 0
    for p in range(pixels.shape[0]):
        first[p] = used
        sx, sy = pixels[p, 0], pixels[p, 1]
        rho = math.hypot(sx, sy)
        interval = min(int(rho / step), reach.size - 1)
        if reach[interval] <= 0.0:
            continue
        cos, sin = (sx / rho, sy / rho) if rho > 0.0 else (1.0, 0.0)
        for k in range(sides):
            x[k] = cos * corners[interval, k, 0] - sin * corners[interval, k, 1]
            y[k] = sin * corners[interval, k, 0] + cos * corners[interval, k, 1]
        used, _ = _store_fan(triangles, used, x, y, sides, 0.0, 0.0, 0.0, 0.0, 0.0)
    first[pixels.shape[0]] = used
    return used
