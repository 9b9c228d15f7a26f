"""Condition numbers of single rays at each element: rows of a lens's record against rays."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.element_record import ASPHERE, CONIC, FREEFORM, IDEAL, SPHERE
from plenoptic.optics.lens.lens_record import LensRecord

CHUNK = 64
"""Blocks of 256 rays that are followed together: with ten elements 8 MB of records."""


class ProbeRecords(NamedTuple):
    """Records of rays; arrays (elements, rays) in the order of travel, nan where a ray did not pass the element."""

    lens: LensRecord
    incidence: Floats
    refraction: Floats
    cancellation: Floats
    newton: Floats
    """Here and below, nan only where a ray did not come to the element."""
    search: Floats
    codes: NDArray[np.int64]
    """(rays,): status behind the lens, as in `ray_blocks`."""


def blocks_of(rays: RayBundle) -> Floats:
    """Rays as they lie in memory; see `ray_blocks`. The last block is filled with rays that are lost."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, MISSED, RAY

    n = len(rays)
    rows = np.zeros((RAY // BLOCK, -(-n // BLOCK) * BLOCK))
    rows[7] = MISSED
    rows[0:3, :n], rows[3:6, :n], rows[6, :n] = rays.origin.T, rays.direction.T, rays.weight
    rows[7, :n] = np.where(rays.status == 0, 0.0, rays.status + CAUSES * (rays.lost_at + 1.0))
    return np.ascontiguousarray(rows.reshape(RAY // BLOCK, -1, BLOCK).transpose(1, 0, 2)).reshape(-1)


def probe_rays(lens: LensRecord, blocks: Floats, n: int, waves: NDArray[np.int64] | None = None) -> ProbeRecords:
    """Trace the first n rays of a bundle in place and record their conditioning; see `fill_conditions`."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS
    from plenoptic.optics.lens.kernels.notes import INCIDENCE, LOG, NEWTON, REACH, REFRACTION, STEPS
    from plenoptic.optics.lens.kernels.trace import fill_conditions

    elements, whole = len(lens.rows), blocks.size // RAY
    columns = np.empty((LOG, elements, whole, BLOCK))
    for first in range(0, whole, CHUNK):
        end = min(first + CHUNK, whole)
        log = np.empty((end - first, elements, LOG, BLOCK))
        part = None if waves is None else waves[first * BLOCK : end * BLOCK]
        fill_conditions(blocks[first * RAY : end * RAY], log, lens.completed, part)
        columns[:, :, first:end] = log.transpose(2, 1, 0, 3)
    rays = columns.reshape(LOG, elements, -1)[:, :, :n]
    codes = blocks.reshape(-1, RAY)[:, STATUS:].reshape(-1)[:n].astype(np.int64)
    cancellation = rays[REACH] / sizes(lens)[:, None]
    return ProbeRecords(lens, rays[INCIDENCE], rays[REFRACTION], cancellation, rays[NEWTON], rays[STEPS], codes)


def sizes(lens: LensRecord) -> Floats:
    """Semi-diameters in mm, or, where an element ends at its depth or nowhere, its radius or focal length."""
    squared, curvature = lens.rows["semi_diameter2"], lens.rows["curvature"]
    with np.errstate(divide="ignore"):
        return np.asarray(np.where(np.isfinite(squared), np.sqrt(squared), 1.0 / np.abs(curvature)))


def kinds(lens: LensRecord) -> tuple[str, ...]:
    """Name of the element of each row."""
    names = {CONIC: "conic", ASPHERE: "asphere", FREEFORM: "freeform", IDEAL: "ideal lens"}
    of_spheres = ("sphere" if c else "plane" for c in lens.rows["curvature"])
    shapes = zip(lens.rows["kind"].tolist(), of_spheres, strict=True)
    return tuple(sphere if kind == SPHERE else names.get(kind, "stop") for kind, sphere in shapes)


def largest_and(typical: Callable[[Floats], Any], numbers: Floats) -> Floats:
    """(n, 2) of (n, rays): the largest number and the mean or median, without rays that are nan; nan where all are."""
    passing = (row[~np.isnan(row)] for row in numbers)
    pairs = [(row.max(), typical(row)) if len(row) else (math.nan, math.nan) for row in passing]
    return np.array(pairs).reshape(-1, 2)
