"""Condition numbers of single rays at each element: rows of a lens's tables against rays."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.rays import RayBundle
from plenoptic.optics.lens.record import ASPHERE, CONIC, FRAME, IDEAL, SURFACE, LensTables

CHUNK = 64
"""Blocks of 256 rays that are followed together: with ten elements 8 MB of notes."""


class Notes(NamedTuple):
    """What was noted; arrays (elements, rays) in the order of travel, nan where a ray did not pass the element."""

    tables: LensTables
    incidence: NDArray[np.float64]
    refraction: NDArray[np.float64]
    cancellation: NDArray[np.float64]
    newton: NDArray[np.float64]
    """Here and below, nan only where a ray did not come to the element."""
    search: NDArray[np.float64]
    codes: NDArray[np.int64]
    """(rays,): status behind the lens, as in `ray_blocks`."""


def blocks_of(rays: RayBundle) -> NDArray[np.float64]:
    """Rays as they lie in memory; see `ray_blocks`. The last block is filled with rays that are lost."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, MISSED, RAY

    n = len(rays)
    rows = np.zeros((RAY // BLOCK, -(-n // BLOCK) * BLOCK))
    rows[7] = MISSED
    rows[0:3, :n], rows[3:6, :n], rows[6, :n] = rays.origin.T, rays.direction.T, rays.weight
    rows[7, :n] = np.where(rays.status == 0, 0.0, rays.status + CAUSES * (rays.lost_at + 1.0))
    return np.ascontiguousarray(rows.reshape(RAY // BLOCK, -1, BLOCK).transpose(1, 0, 2)).reshape(-1)


def noted(tables: LensTables, blocks: NDArray[np.float64], n: int, waves: NDArray[np.int64] | None = None) -> Notes:
    """Trace the first n rays of a bundle in place and note how each element treats them; see `fill_conditions`."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS
    from plenoptic.optics.lens.kernels.conditioning import fill_conditions, fill_conditions_waves
    from plenoptic.optics.lens.kernels.notes import INCIDENCE, NEWTON, REACH, REFRACTION, STEPS, TOLD

    elements, whole = len(tables.kind), blocks.size // RAY
    kept = np.empty((TOLD, elements, whole, BLOCK))
    for first in range(0, whole, CHUNK):
        end = min(first + CHUNK, whole)
        told = np.empty((end - first, elements, TOLD, BLOCK))
        part = blocks[first * RAY : end * RAY]
        if waves is None:
            fill_conditions(part, told, *_completed(tables))
        else:
            fill_conditions_waves(part, told, waves[first * BLOCK : end * BLOCK], *_completed(tables))
        kept[:, :, first:end] = told.transpose(2, 1, 0, 3)
    rays = kept.reshape(TOLD, elements, -1)[:, :, :n]
    codes = blocks.reshape(-1, RAY)[:, STATUS:].reshape(-1)[:n].astype(np.int64)
    cancellation = rays[REACH] / sizes(tables)[:, None]
    return Notes(tables, rays[INCIDENCE], rays[REFRACTION], cancellation, rays[NEWTON], rays[STEPS], codes)


def _completed(tables: LensTables) -> LensTables:
    """The same lens in one of two forms, with spheres and planes only or with nothing left out.

    Two kernels then serve all lenses: they are compiled once and run on few rays.
    """
    n = len(tables.kind)
    completed = tables._replace(
        frames=np.zeros((n, FRAME)) if tables.frames is None else tables.frames,
        masks=np.zeros(0) if tables.masks is None else tables.masks,
    )
    if tables.conic is not None and tables.aspheric is None:
        return completed._replace(aspheric=np.zeros((n, 3)))
    return completed


def sizes(tables: LensTables) -> NDArray[np.float64]:
    """What the size of each element is measured by, mm.

    Its semi-diameter, or, where it ends at its depth or nowhere, its radius of curvature or focal length.
    """
    with np.errstate(divide="ignore"):
        return np.where(np.isfinite(tables.clear), np.sqrt(tables.clear), 1.0 / np.abs(tables.curvature))


def kinds(tables: LensTables) -> tuple[str, ...]:
    """What each row is, in words."""
    return tuple(_kind(int(kind), float(c)) for kind, c in zip(tables.kind, tables.curvature, strict=True))


def _kind(kind: int, c: float) -> str:
    if kind == SURFACE:
        return "sphere" if c else "plane"
    return {CONIC: "conic", ASPHERE: "asphere", IDEAL: "ideal lens"}.get(kind, "stop")


def largest_and_median(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) of (n, rays), without the rays that are nan; nan where all are."""
    return _pairs(numbers, lambda row: (float(row.max()), float(np.median(row))))


def largest_and_mean(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) of (n, rays), without the rays that are nan; nan where all are."""
    return _pairs(numbers, lambda row: (float(row.max()), float(row.mean())))


def _pairs(numbers: NDArray[np.float64], of) -> NDArray[np.float64]:  # type: ignore[no-untyped-def]
    kept = (row[~np.isnan(row)] for row in numbers)
    return np.array([of(row) if len(row) else (math.nan, math.nan) for row in kept]).reshape(-1, 2)
