"""The light of points, microlens by microlens: rays through all stages, and their sums."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.psf.sensor_hits import ForwardRecord, Task, landed
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats

REPLICATES = 8
"""Independent scramblings of the rays of a point; errors come from their spread."""


class Light(NamedTuple):
    """Light of points that lands on the sensor, a row for each point and microlens."""

    keys: NDArray[np.int64]
    """(k, 3): number of the point and lattice indices of the microlens, in order; 0, 0 without microlenses."""
    moments: Floats
    """(k, replicates, 3): light, and light times x and y on the sensor, in mm."""


def light_of(tables: ForwardRecord, tasks: list[Task], each: int, threads: int) -> Light:
    """Trace tasks that come to `each` rays for every point and replicate."""

    def work(task: Task) -> tuple[NDArray[np.int64], Floats]:
        rows = landed(tables, task, np.uint64(0)).rows
        lens, place = unique_rows(np.column_stack([rows["first"], rows["second"]]))
        sums = np.empty((len(lens), 3))
        for k, amount in enumerate((rows["weight"], rows["weight"] * rows["x"], rows["weight"] * rows["y"])):
            sums[:, k] = np.bincount(place, amount, minlength=len(lens))
        return lens, sums / each

    parts = list(run_in_order(work, tasks, threads=min(threads, max(len(tasks), 1))))
    counts = [len(lens) for lens, _ in parts]
    number = np.repeat([task.number for task in tasks], counts).astype(np.int64)
    replicate = np.repeat([task.replicate for task in tasks], counts).astype(np.int64)
    index = np.concatenate([np.empty((0, 2), np.int64), *(lens for lens, _ in parts)])
    keys, row = unique_rows(np.column_stack([number, index]))
    moments = np.zeros((len(keys), REPLICATES, 3))
    np.add.at(moments, (row, replicate), np.concatenate([np.empty((0, 3)), *(sums for _, sums in parts)]))
    return Light(keys, moments)


def unique_rows(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The different rows (k, c) of whole numbers (n, c) in order, and which of them each row is (n,)."""
    if not len(keys):
        return keys, np.empty(0, np.int64)
    order = np.lexsort(keys.T[::-1])
    ordered = keys[order]
    new = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    row = np.empty(len(keys), np.int64)
    row[order] = np.cumsum(new) - 1
    return ordered[new], row


def light_and_error(moments: Floats) -> tuple[Floats, Floats]:
    """Light (k,) and its standard error."""
    light = moments[:, :, 0]
    return light.mean(axis=1), light.std(axis=1, ddof=1) / np.sqrt(light.shape[1])


def centroid_and_error(moments: Floats) -> tuple[Floats, Floats]:
    """Centroids (k, 2), nan without light, and their errors, by leaving one replicate out at a time."""
    total, count = moments.sum(axis=1), moments.shape[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        others = total[:, None] - moments
        without = others[..., 1:] / others[..., :1]
        centroid = total[:, 1:] / total[:, :1]
        error = np.sqrt((count - 1) * without.var(axis=1))
    # All light in one replicate: the error is not known, and not small.
    return np.where(total[:, :1] > 0, centroid, np.nan), np.where(np.isfinite(error), error, np.inf)
