"""Dust and scratches: kernels that attenuate paths where they cross its plane.

A grain or scratch is a capsule: all points nearer than a radius to a segment. Capsules are looked up in a grid of bins
(see `dust.DustRecord`), so that the cost of a path does not depend on the number of grains.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel


@device
def _bin(value, low, per_mm, bins):
    return min(max(math.floor((value - low) * per_mm), 0), bins - 1)


@device
def _columns_of(capsule, grid, margin):
    """First and last column of bins that a capsule may overlap."""
    reach = math.sqrt(capsule.radius2) + margin
    x, dx = capsule.start_x, capsule.along_x
    low, high = min(x, x + dx) - reach, max(x, x + dx) + reach
    columns = int(grid[3])
    return _bin(low, grid[0], grid[2], columns), _bin(high, grid[0], grid[2], columns)


@device
def _rows_of(capsule, grid, margin, column):
    """First and last bin that a capsule may overlap in a column: the part of its segment near it, and the radius."""
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
    return _bin(low, grid[1], grid[2], rows), _bin(high, grid[1], grid[2], rows)


@kernel
def count_members(capsules, grid, margin):
    """Total number of entries of a grid's bins: a capsule is an entry of every bin that it may overlap."""
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
    `margin` widens capsules by the largest rounding error. `bin_first` must be 0 on entry.
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
    cursor = bin_first[:-1].copy()
    for k in range(capsules.shape[0]):
        first, last = _columns_of(capsules[k], grid, margin)
        for column in range(first, last + 1):
            low, high = _rows_of(capsules[k], grid, margin, column)
            for row in range(low, high + 1):
                members[cursor[column * rows + row]] = k
                cursor[column * rows + row] += 1


@device
def apply_affine(axes, x, y):
    """Transform a point of a plane by an affine map (2, 3)."""
    return axes[0, 0] * x + axes[0, 1] * y + axes[0, 2], axes[1, 0] * x + axes[1, 1] * y + axes[1, 2]


@device
def _attenuate(ray, row, point, axes, dust):
    """Multiply a number by the transmission of the dust at a local point; nan points are outside of all dust."""
    x, y = point
    grid = dust.grid
    if axes is not None:
        x, y = apply_affine(axes, x, y)
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
def fill_aim_transmission(blocks, sensor, height, axes, dust):
    """Attenuate aimed samples (see `to_lens`) where they cross a plane `height` mm in front of the sensor.

    The sensor is a `SensorPlane` behind the plane of aims, and the plane of the dust is parallel to it. `height` None:
    dust lies on the plane of aims itself. `axes` (2, 3) is the affine map from local x, y to the dust's axes, None
    if they are the same (see `dust.plane_axes`).
    """
    distance = sensor.distance
    rise, straight = 0.0, 0.0
    if height is not None:
        # Distance of a parallel plane at `height`, along the local axis.
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
            _attenuate(ray, WEIGHT + i, (x, y), axes, dust)


@kernel
def fill_ray_transmission(blocks, z, axes, dust):
    """Attenuate rays where their lines cross the plane at z; lost rays may hold any numbers."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            t = (z - ray[Z + i]) / ray[N + i]
            _attenuate(ray, WEIGHT + i, (ray[X + i] + t * ray[L + i], ray[Y + i] + t * ray[M + i]), axes, dust)


@kernel
def fill_transmission(transmission, points, dust):
    """Transmission at points (n, 2) in the dust's axes."""
    for k in range(points.shape[0]):
        transmission[k] = 1.0
        _attenuate(transmission, k, (points[k, 0], points[k, 1]), None, dust)
