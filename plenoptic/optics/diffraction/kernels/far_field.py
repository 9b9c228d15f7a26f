"""Drawing bends from far-field patterns."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device, kernel


@device
def _found(shares, u):
    """The interval of cumulative shares that holds u, and where in it u lies, from 0 to 1."""
    low, high = 0, shares.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if shares[middle] <= u:
            low = middle
        else:
            high = middle
    width = shares[low + 1] - shares[low]
    return low, (u - shares[low]) / width if width > 0.0 else 0.5


@device
def _beyond(field, u, v):
    """Sample a frequency outside the disc, in periods; returns the weights of paths through and outside the opening,
    too.
    """
    edges, k = field.edges, 0
    while k < edges.shape[0] - 1 and edges[k, 0] <= u:
        k += 1
    before = edges[k - 1, 0] if k > 0 else 0.0
    u = (u - before) / (edges[k, 0] - before)
    a = field.inner / (1.0 - v)
    if edges[k, 3] == 0.0:
        angle = 2.0 * math.pi * u
        return a * math.cos(angle), a * math.sin(angle), edges[k, 4], edges[k, 5]
    if u < 0.5:
        a, u = -a, 2.0 * u
    else:
        u = 2.0 * u - 1.0
    at = u * (field.spread.size - 1)
    i = min(int(at), field.spread.size - 2)
    b = (field.spread[i] + (at - i) * (field.spread[i + 1] - field.spread[i])) / edges[k, 3]
    return a * edges[k, 1] - b * edges[k, 2], a * edges[k, 2] + b * edges[k, 1], edges[k, 4], edges[k, 5]


@device
def bend(field, u, v):
    """Sample a deflection, as a spatial frequency in cycles/mm, from two numbers in [0, 1).

    Returns the weights of a path through the opening and of one outside it, too.
    """
    inside = field.rows[field.rows.size - 1]
    through, beside = 1.0, 0.0
    if u < inside:
        row, y = _found(field.rows, u)
        column, x = _found(field.columns[row], v)
        if field.opening is not None:
            through = field.opening[row, column]
            beside = (1.0 - field.share * through) / (1.0 - field.share)
        x, y = (column + x) * field.step - field.inner, (row + y) * field.step - field.inner
    else:
        x, y, through, beside = _beyond(field, (u - inside) / (1.0 - inside), v)
    scale = field.scale
    return scale[0, 0] * x + scale[0, 1] * y, scale[1, 0] * x + scale[1, 1] * y, through, beside


@kernel
def fill_bends(bends, numbers, field):
    """Write deflections (n, 4) for numbers (n, 2): frequencies along x and y, weights of paths through and outside
    openings.
    """
    for i in range(numbers.shape[0]):
        bends[i, 0], bends[i, 1], bends[i, 2], bends[i, 3] = bend(field, numbers[i, 0], numbers[i, 1])
