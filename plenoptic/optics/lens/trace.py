"""Bundles of rays through a lens, large ones on several threads."""

from __future__ import annotations

import numpy as np

from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import wrong_kind
from plenoptic.optics.lens.record import LensTables, lens_tables
from plenoptic.optics.lens.stack import LensStack

CHUNK = 1 << 15
"""Rays that one thread takes at a time: a few milliseconds of work."""


def traced(lens: LensStack, rays: RayBundle, *, reverse: bool, threads: int | None = None) -> RayBundle:
    """Trace a bundle one way or the other; see `LensStack.trace`."""
    if not isinstance(rays, RayBundle):
        raise wrong_kind(rays, "rays", "RayBundle", "pl.RayBundle([[0, 0, -100]], [[0, 0, 1]])")
    return traced_by(lens_tables(lens, rays.wavelength, reverse=reverse), rays, threads=threads)


def traced_part(
    lens: LensStack, rays: RayBundle, first: int, last: int, *, reverse: bool = False, clipping: bool = True
) -> RayBundle:
    """Trace a bundle exactly through the elements `first` to `last`, both included; without `clipping` to no rim.

    The origins come to lie on the element met last: `last`, or `first` in reverse.
    """
    tables = lens_tables(lens, rays.wavelength, reverse=reverse, first=first, last=last, clipping=clipping)
    return traced_by(tables, rays)


def traced_by(tables: LensTables, rays: RayBundle, *, threads: int | None = None) -> RayBundle:
    """Trace a bundle through what tables describe."""
    from plenoptic.optics.lens.kernels.trace import fill_traced_rows

    n = len(rays)
    origin, direction, weight = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    status, lost_at = np.empty(n, dtype=np.uint8), np.empty(n, dtype=np.int16)
    made = (origin, direction, weight, status, lost_at)
    given = (rays.origin, rays.direction, rays.weight, rays.status, rays.lost_at)

    def trace_chunk(start: int) -> None:
        at = slice(start, min(start + CHUNK, n))
        fill_traced_rows(*(array[at] for array in made), *(array[at] for array in given), *tables)

    workers = min(thread_count(threads), -(-n // CHUNK))
    for _ in run_in_order(trace_chunk, range(0, n, CHUNK), threads=workers):
        pass
    return RayBundle._made(origin, direction, rays.wavelength, weight, status, lost_at)
