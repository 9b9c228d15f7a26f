"""Light of points on the sensor: rays of many points and all their replicates are traced together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.psf.sensor_hits import BUNDLE, ForwardRecord, fill_to_sensor
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats

REPLICATES = 32
"""Independent scramblings of the rays of a point, for the standard error."""


class PointRays(NamedTuple):
    """Points in the lens's axes and the polygons at which their rays are aimed."""

    number: NDArray[np.int64]
    """(n,): number of each point."""
    bits: NDArray[np.uint64]
    """(n, 3): bits of its coordinates in the world."""
    point: Floats
    """(n, 3)"""
    polygon: Floats
    """(n, k, 2): corners on the entrance plane, counter-clockwise."""
    replicates: int = REPLICATES


class SensorLight(NamedTuple):
    """Light of points that reaches the sensor, a row for each point and microlens."""

    keys: NDArray[np.int64]
    """(k, 3): row of the point and lattice indices of the microlens, sorted; 0, 0 without microlenses."""
    moments: Floats
    """(k, replicates, 3): light, and light times x and y on the sensor, in mm."""


def light_of_points(record: ForwardRecord, points: PointRays, each: int, threads: int) -> SensorLight:
    """Trace `each` rays of every point and replicate; no light without rays."""
    from plenoptic.camera.points.kernels.point_light import fill_light_keys, fill_light_sums
    from plenoptic.camera.psf.kernels.source_rays import fill_rays_of_points
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY

    sensor, per_point = record.camera.sensor, REPLICATES * each

    def trace(first: int) -> tuple[NDArray[np.int64], int, Floats]:
        """Keys (k, 3) of a bundle, its first replicate, and sums (k, replicates, 3)."""
        n = min(BUNDLE, per_task - first % per_task, total - first)
        blocks, key_of = np.empty(-(-n // BLOCK) * RAY), np.empty(n, np.int32)
        fill_rays_of_points(blocks, first, n, points, each, record.entrance.z, record.ideal, record.facing)
        fill_to_sensor(blocks, record)
        keys, table = np.empty((n, 3), np.int64), np.full(1 << n.bit_length(), -1, np.int32)
        screen = (*sensor.shape, sensor.pixel_pitch)
        keys = keys[: fill_light_keys(key_of, keys, table, blocks, (first, per_point), screen)]
        low, last = first // each % REPLICATES, (first + n - 1) // each % REPLICATES
        sums = np.zeros((len(keys), last + 1 - low, 3))
        fill_light_sums(sums, key_of, blocks, first % per_point - low * each, each)
        return keys, low, sums

    # Whole points, or parts of one.
    total, per_task = per_point * len(points.number), max(BUNDLE // max(per_point, 1), 1) * max(per_point, 1)
    firsts = [k for task in range(0, total, per_task) for k in range(task, min(task + per_task, total), BUNDLE)]
    parts = list(run_in_order(trace, firsts, threads=threads))
    keys, row = unique_rows(np.concatenate([np.empty((0, 3), np.int64), *(keys for keys, _, _ in parts)]))
    moments, end = np.zeros((len(keys), REPLICATES, 3)), 0
    for part, low, sums in parts:
        start, end = end, end + len(part)
        moments[row[start:end], low : low + sums.shape[1]] += sums
    return SensorLight(keys, moments / max(each, 1))


def unique_rows(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Unique rows (k, c) of integers (n, c), sorted, and the index of each row among them (n,)."""
    if not len(keys):
        return keys, np.empty(0, np.int64)
    low = keys.min(axis=0)
    number = np.ravel_multi_index(tuple((keys - low).T), tuple(keys.max(axis=0) - low + 1))
    _, first, row = np.unique(number, return_index=True, return_inverse=True)
    return keys[first], row
