"""Addition of shifted views."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device, kernel
from plenoptic.lightfield.kernels.cubic import cubic_weights


@device
def _interpolate(view, row, column, c):
    """Channel c of a view at a fractional position: by cubic convolution, bilinear at borders; nan outside."""
    rows, columns, _ = view.shape
    top, left = math.floor(row), math.floor(column)
    down, right = row - top, column - left
    (a, _), (b, _) = cubic_weights(down), cubic_weights(right)
    top, left, total = int(top), int(left), 0.0
    if 1 <= top < rows - 2 and 1 <= left < columns - 2:
        for i in range(4):
            for j in range(4):
                total += a[i] * b[j] * view[top - 1 + i, left - 1 + j, c]
        if not math.isnan(total):
            return total
    total = 0.0
    for i in range(2):
        for j in range(2):
            weight = (down if i else 1.0 - down) * (right if j else 1.0 - right)
            if weight > 0.0:
                if not (0 <= top + i < rows and 0 <= left + j < columns):
                    return math.nan
                total += weight * view[top + i, left + j, c]
    return total


@kernel
def add_view(total, count, view, shift):
    """Add a view (rows, columns, C), shifted by (rows, columns, 2) pixels, to `total`; count its finite values."""
    for y in range(view.shape[0]):
        for x in range(view.shape[1]):
            for c in range(view.shape[2]):
                value = _interpolate(view, y + shift[y, x, 0], x + shift[y, x, 1], c)
                if not math.isnan(value):
                    total[y, x, c] += value
                    count[y, x, c] += 1.0
