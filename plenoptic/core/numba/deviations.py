"""Deviations of the compiler of kernels from Numba's own, and which of them are in force.

`PLENOPTIC_PLAIN_NUMBA=1` leaves all out, and names joined by commas leave out these. Where Numba lacks an internal that
one of them needs, or a kernel compiles only without them, all are left out, with one warning. The pass `absent_fields`
always runs: it uses Numba's documented interface for passes, and kernels do not compile without it.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator
from contextlib import contextmanager

from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError

ALL = frozenset({"borrowed_arrays", "helper_processes", "lean_pipeline", "no_wrappers", "one_integer"})
"""Each is described in docs/concepts/compilation.md, with its measured worth."""

_left_out: set[str] = set()


@functools.cache
def _chosen() -> frozenset[str]:
    """The deviations that the environment leaves."""
    asked = os.environ.get("PLENOPTIC_PLAIN_NUMBA", "")
    names = frozenset(filter(None, asked.replace("0", "").split(",")))
    if "1" in names:
        return frozenset()
    if unknown := names - ALL:
        raise InvalidValueError(
            f"PLENOPTIC_PLAIN_NUMBA has {', '.join(sorted(unknown))}; it may be 1, or some of {', '.join(sorted(ALL))}"
        )
    return ALL - names


def deviations() -> frozenset[str]:
    """Names of the deviations in force."""
    return _chosen() - _left_out


@contextmanager
def plainly() -> Iterator[None]:
    """Context manager without deviations, in all threads."""
    before = set(_left_out)
    _left_out.update(ALL)
    try:
        yield
    finally:
        _left_out.intersection_update(before)


def leave_all_out(reason: object) -> None:
    """Compile by Numba's own pipeline from now on, and warn of it."""
    if deviations():
        _left_out.update(ALL)
        warn(
            f"this version of Numba differs from those that are known ({reason}): kernels are compiled in its own way, "
            "which is slower; PLENOPTIC_PLAIN_NUMBA=1 does the same without this warning"
        )
