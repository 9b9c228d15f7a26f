"""Check of an untested Numba version: a kernel that uses every feature that the deviations change."""

from __future__ import annotations

import sys
from importlib.metadata import version
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.numba.deviations import leave_all_out
from plenoptic.core.numba.jit import device, kernel

_TESTED = ((0, 66), (0, 68))
"""Oldest and newest version."""


class _Arrays(NamedTuple):
    numbers: NDArray[np.float64]
    absent: NDArray[np.float64] | None


@device
def _sum(part, i, j):
    return part[i] + part[j]


@kernel
def _fill_sums(arrays, out):
    for i in range(out.size):
        part = arrays.numbers[i:]
        out[i] = _sum(part, 0, 1) + _sum(part, 1, i - i)
        if arrays.absent is not None:
            out[i] += arrays.absent[i]


def probe_numba() -> None:
    """Disable the deviations if an untested Numba version compiles the kernel wrongly with them."""
    installed = version("numba")
    if _TESTED[0] <= tuple(map(int, installed.split(".")[:2])) <= _TESTED[1]:
        return
    numbers, out = np.arange(65.0), np.zeros(64)
    references = sys.getrefcount(numbers)
    _fill_sums(_Arrays(numbers, None), out)
    if not np.array_equal(out, 4.0 * numbers[:-1] + 2.0) or sys.getrefcount(numbers) != references:
        leave_all_out(f"version {installed} compiles a kernel of known numbers wrongly")
