"""Dust and scratches: kernels that dim paths where they cross its plane.

A grain or scratch is a capsule: all points nearer than a radius to a segment. Capsules are found through a grid of bins
(see `dust.DustRecord`), so that a path costs the same for ten grains and for ten thousand.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel


@device
def _place(value, low, per_mm, bins):
    return min(max(math.floor((value - low) * per_mm), 0), bins - 1)


@device
def _columns_of(capsule, grid, margin):
    """First and last column of bins that a capsule can touch."""
    reach = math.sqrt(capsule.radius2) + margin
    x, dx = capsule.start_x, capsule.along_x
    low, high = min(x, x + dx) - reach, max(x, x + dx) + reach
    columns = int(grid[3])
    return _place(low, grid[0], grid[2], columns), _place(high, grid[0], grid[2], columns)


@device
def _rows_of(capsule, grid, margin, column):
    """First and last bin that a capsule can touch in one column: the part of its segment near it, and the radius."""
    reach = math.sqrt(capsule.radius2) + margin
    left = grid[0] + column / grid[2] - reach
    right = grid[0] + (column + 1) / grid[2] + reach
    x, dx = capsule.start_x, capsule.along_x
    first, last = 0.0, 1.0
    if dx != 0.0:
        first, last = (left - x) / dx, (right - x) / dx
        if first > last:
            first, last = last, first
        first, last = min(max(first, 0.0), 1.0), min(max(last, 0.0), 1.0)
    y, dy = capsule.start_y, capsule.along_y
    low, high = min(y + first * dy, y + last * dy) - reach, max(y + first * dy, y + last * dy) + reach
    rows = int(grid[4])
    return _place(low, grid[1], grid[2], rows), _place(high, grid[1], grid[2], rows)


@kernel
def count_members(capsules, grid, margin):
    """Number of entries of all bins of a grid: each capsule is one in every bin that it can touch."""
    total = 0
    for k in range(capsules.shape[0]):
        first, last = _columns_of(capsules[k], grid, margin)
        for column in range(first, last + 1):
            low, high = _rows_of(capsules[k], grid, margin, column)
            total += high - low + 1
    return total


@kernel
def fill_dust_bins(bin_first, members, capsules, grid, margin):
    """Sort capsules into bins: those of bin b are members[bin_first[b]] to members[bin_first[b + 1]].

    `grid` is x, y of its corner, bins per mm and the numbers of columns and rows; bins count column by column.
    `margin` widens capsules by the largest rounding error. `bin_first` comes as zeros.
    """
    rows = int(grid[4])
    for k in range(capsules.shape[0]):
        first, last = _columns_of(capsules[k], grid, margin)
        for column in range(first, last + 1):
            low, high = _rows_of(capsules[k], grid, margin, column)
            for row in range(low, high + 1):
                bin_first[column * rows + row + 1] += 1
    for b in range(bin_first.size - 1):
        bin_first[b + 1] += bin_first[b]
    filled = bin_first[:-1].copy()
    for k in range(capsules.shape[0]):
        first, last = _columns_of(capsules[k], grid, margin)
        for column in range(first, last + 1):
            low, high = _rows_of(capsules[k], grid, margin, column)
            for row in range(low, high + 1):
                members[filled[column * rows + row]] = k
                filled[column * rows + row] += 1


@device
def in_axes(axes, x, y):
    """A point of a plane through an affine map (2, 3)."""
    return axes[0, 0] * x + axes[0, 1] * y + axes[0, 2], axes[1, 0] * x + axes[1, 1] * y + axes[1, 2]


@device
def _dim(ray, row, point, axes, dust):
    """Multiply a number by the transmission of the dust at a local point; by 1 where the point is not finite."""
    x, y = point
    grid = dust.grid
    if axes is not None:
        x, y = in_axes(axes, x, y)
    u, v = (x - grid[0]) * grid[2], (y - grid[1]) * grid[2]
    if u >= 0.0 and u < grid[3] and v >= 0.0 and v < grid[4]:
        b = int(u) * int(grid[4]) + int(v)
        for m in range(dust.first[b], dust.first[b + 1]):
            capsule = dust.capsules[dust.members[m]]
            px, py = x - capsule.start_x, y - capsule.start_y
            along = (px * capsule.along_x + py * capsule.along_y) * capsule.inverse_length2
            along = min(max(along, 0.0), 1.0)
            px, py = px - along * capsule.along_x, py - along * capsule.along_y
            if px * px + py * py < capsule.radius2:
                ray[row] *= capsule.transmission


@kernel
def fill_dimmed_aims(blocks, sensor, height, axes, dust):
    """Dim aimed samples (see `to_lens`) where they cross a plane `height` mm in front of the sensor.

    The sensor is a `SensorPlane` behind the plane of aims, and the plane of the dust is parallel to it. `height` None:
    dust lies on the plane of aims itself. `axes` (2, 3) is the affine map from local x, y to the dust's axes, None
    where they are the same (see `dust.plane_axes`).
    """
    distance = sensor.distance
    rise, straight = 0.0, 0.0
    if height is not None:
        # Along the local axis a parallel plane at `height` lies this far away.
        rise = height
        if sensor.tilt is not None:
            rise = height * math.sqrt(1.0 + sensor.tilt[0] * sensor.tilt[0] + sensor.tilt[1] * sensor.tilt[1])
        straight = 1.0 - rise / distance
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            x, y = ray[X + i], ray[Y + i]
            if height is not None:
                # From the sensor's plane, the path rises to the sensor's distance at the point aimed at.
                back = straight
                if sensor.tilt is not None:
                    back = 1.0 - rise / (distance + sensor.tilt[0] * x + sensor.tilt[1] * y)
                x, y = x - back * ray[L + i], y - back * ray[M + i]
            _dim(ray, WEIGHT + i, (x, y), axes, dust)


@kernel
def fill_dimmed_rays(blocks, z, axes, dust):
    """Dim rays where their lines cross the plane at z; lost rays may hold anything."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            t = (z - ray[Z + i]) / ray[N + i]
            _dim(ray, WEIGHT + i, (ray[X + i] + t * ray[L + i], ray[Y + i] + t * ray[M + i]), axes, dust)


@kernel
def fill_passing(passing, points, dust):
    """Write the transmission at points (n, 2) in the dust's axes."""
    for k in range(points.shape[0]):
        passing[k] = 1.0
        _dim(passing, k, (points[k, 0], points[k, 1]), None, dust)
