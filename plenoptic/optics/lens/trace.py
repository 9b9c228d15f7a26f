"""Tracing of ray bundles through a lens; large bundles use several threads."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, check_kind
from plenoptic.optics.lens.lens_record import LensRecord, lens_record, radiometric_lens_record
from plenoptic.optics.lens.stack import LensStack

CHUNK = 1 << 15
"""Rays of one task of a thread: a few milliseconds of work."""


def trace_rays(lens: LensStack, rays: RayBundle, *, reverse: bool, threads: int | None = None) -> RayBundle:
    """Trace a bundle through a lens, or in reverse; see `LensStack.trace`."""
    check_kind(rays, "rays", RayBundle, "pl.RayBundle([[0, 0, -100]], [[0, 0, 1]])")
    return trace_record(radiometric_lens_record(lens, rays.wavelength, reverse=reverse), rays, threads=threads)


def trace_part(
    lens: LensStack, rays: RayBundle, first: int, last: int, *, reverse: bool = False, clipping: bool = True
) -> RayBundle:
    """Trace a bundle exactly through the elements `first` to `last`, both included; `clipping` enables rims and stops.

    The resulting origins lie on the element `last`, or on `first` in reverse.
    """
    record = lens_record(lens, rays.wavelength, reverse=reverse, first=first, last=last, clipping=clipping)
    return trace_record(record, rays)


class RayArrays(NamedTuple):
    """Arrays of a bundle of n rays in the layout of kernels."""

    origin: Floats
    """(3 n,): strides known at compile time allow SIMD instructions."""
    direction: Floats
    """(3 n,)"""
    weight: Floats
    status: NDArray[np.uint8]
    lost_at: NDArray[np.int16]


def trace_record(record: LensRecord, rays: RayBundle, *, threads: int | None = None) -> RayBundle:
    """Trace a bundle through the elements of a record."""
    from plenoptic.optics.lens.kernels.trace import fill_traced_rows

    def fill(out: RayArrays, given: RayArrays, first: int, end: int) -> None:
        fill_traced_rows(out, given, record, first, end)

    return in_chunks(fill, rays, threads=threads)


def in_chunks(
    fill: Callable[[RayArrays, RayArrays, int, int], None], rays: RayBundle, *, threads: int | None = None
) -> RayBundle:
    """Call `fill(output, input, begin, end)` for all chunks of a bundle; returns the output."""
    n = len(rays)
    arrays = RayArrays(rays.origin.reshape(-1), rays.direction.reshape(-1), rays.weight, rays.status, rays.lost_at)
    out = RayArrays(np.empty(3 * n), np.empty(3 * n), np.empty(n), np.empty(n, np.uint8), np.empty(n, np.int16))
    workers = min(thread_count(threads), -(-n // CHUNK))
    for _ in run_in_order(lambda k: fill(out, arrays, k, min(k + CHUNK, n)), range(0, n, CHUNK), threads=workers):
        pass
    origin, direction = out.origin.reshape(n, 3), out.direction.reshape(n, 3)
    return RayBundle._from_arrays(origin, direction, rays.wavelength, out.weight, out.status, out.lost_at)
