"""Kernels: sums of the light of points over microlenses, and the rays of points that hit the array nearest to them."""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel


@device
def _slot(keys, table, row, first, second):
    """Slot of a hash table with the number of a key, or a free one."""
    mask = table.size - 1
    slot = (row * 7919 + first * 73856093 + second * 19349663) & mask
    while table[slot] >= 0:
        k = table[slot]
        if keys[k, 0] == row and keys[k, 1] == first and keys[k, 2] == second:
            break
        slot = (slot + 1) & mask
    return slot


@kernel
def fill_light_keys(key_of, keys, table, blocks, ray_range, sensor):
    """Number the microlenses that the rays of each point reach: fill `keys` (row of the point, lattice indices).

    `key_of` (n,) gets the number of each ray, -1 beside the sensor; `table` holds -1 in more than n slots, a power of
    two. Ray k of the bundle is ray first + k of `ray_range` = (first, rays per point). Returns the number of keys.
    """
    (first, per_point), (rows, columns, pitch), count = ray_range, sensor, 0
    point, remaining = first // per_point, per_point - first % per_point
    for k in range(key_of.size):
        # Divisions would cost more than the rest.
        if remaining == 0:
            point, remaining = point + 1, per_point
        remaining -= 1
        base = (k // BLOCK) * RAY + k % BLOCK
        key_of[k] = -1
        if blocks[base + STATUS] != 0.0:
            continue
        column, row = 0.5 * columns - blocks[base + X] / pitch, 0.5 * rows + blocks[base + Y] / pitch
        if 0.0 <= row < rows and 0.0 <= column < columns:
            i, j = int(blocks[base + Z]), int(blocks[base + N])
            slot = _slot(keys, table, point, i, j)
            if table[slot] < 0:
                table[slot] = count
                keys[count, 0], keys[count, 1], keys[count, 2] = point, i, j
                count += 1
            key_of[k] = table[slot]
    return count


@kernel
def fill_light_sums(sums, key_of, blocks, first, each):
    """Add w, w x, w y of the rays of a bundle to `sums` (keys, replicates, 3), by key and replicate.

    Ray k is ray first + k of replicates of `each` rays, counted from the first one of `sums`.
    """
    replicate, remaining = first // each, each - first % each
    for k in range(key_of.size):
        if remaining == 0:
            replicate, remaining = replicate + 1 if replicate + 1 < sums.shape[1] else 0, each
        remaining -= 1
        if key_of[k] >= 0:
            base = (k // BLOCK) * RAY + k % BLOCK
            of_replicate, w = sums[key_of[k], replicate], blocks[base + WEIGHT]
            of_replicate[0] += w
            of_replicate[1] += w * blocks[base + X]
            of_replicate[2] += w * blocks[base + Y]


@kernel
def fill_nearest(nearest, number, positions, arriving, passing):
    """For rows (n,) of points `number`, the ray (p, f, 2) that hits nearest to `positions` (n, 2).

    `nearest` (n, 2) gets its number among all rays, and among those with `passing` (p, f); -1 without one.
    """
    for k in range(number.size):
        shortest = (math.inf, math.inf)
        nearest[k, 0] = nearest[k, 1] = -1
        for ray in range(passing.shape[1]):
            x, y = arriving[number[k], ray, 0] - positions[k, 0], arriving[number[k], ray, 1] - positions[k, 1]
            distance = x * x + y * y
            if distance < shortest[0]:
                nearest[k, 0], shortest = ray, (distance, shortest[1])
            if passing[number[k], ray] and distance < shortest[1]:
                nearest[k, 1], shortest = ray, (shortest[0], distance)
