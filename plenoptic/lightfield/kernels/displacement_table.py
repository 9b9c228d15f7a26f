"""Interpolation of tabulated quantities of pixels."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device, kernel
from plenoptic.lightfield.kernels.cubic import cubic_weights


@device
def _add_multiple(out, values, factor):
    for i in range(out.size):
        out[i] += factor * values[i]


@device
def _taps(position, size):
    """Index of the first of four grid points around a position, and their weights."""
    first = min(max(math.floor(position), 1), size - 3)
    return first - 1, cubic_weights(position - first)[0]


@kernel
def fill_values(result, series, basis, types, first, step, workspace):
    """Values (k, n, n, f) of pixels from grid positions `first` (k, 2) on, `step` apart, of microlenses.

    `series` are (types, terms, size, size, f), `basis` (k, terms); `workspace` are arrays (size, size, f), (size, f).
    """
    grid, row = workspace
    size, n_values = row.shape
    for k in range(result.shape[0]):
        grid[:] = 0.0
        for term in range(basis.shape[1]):
            _add_multiple(grid.reshape(grid.size), series[types[k], term].reshape(grid.size), basis[k, term])
        for y in range(result.shape[1]):
            top, weights = _taps(first[k, 0] + y * step, size)
            row[:] = 0.0
            for i in range(4):
                _add_multiple(row.reshape(row.size), grid[top + i].reshape(row.size), weights[i])
            for x in range(result.shape[2]):
                left, (a, b, c, d) = _taps(first[k, 1] + x * step, size)
                for f in range(n_values):
                    result[k, y, x, f] = (
                        a * row[left, f] + b * row[left + 1, f] + c * row[left + 2, f] + d * row[left + 3, f]
                    )
