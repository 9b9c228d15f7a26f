"""Sampling of deflections from far-field patterns: kernels."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device, kernel


@device
def _find_interval(cumulative, u):
    """Interval of cumulative probabilities that holds u, and the fraction of the interval below u."""
    low, high = 0, cumulative.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if cumulative[middle] <= u:
            low = middle
        else:
            high = middle
    width = cumulative[low + 1] - cumulative[low]
    return low, (u - cumulative[low]) / width if width > 0.0 else 0.5


@device
def _sample_edges(field, u, v):
    """Sample a frequency outside the disc, in periods; with the weights of paths through the opening and the gap."""
    edges, k = field.edges, 0
    while k < edges.shape[0] - 1 and edges[k, 0] <= u:
        k += 1
    below = edges[k - 1, 0] if k > 0 else 0.0
    u = (u - below) / (edges[k, 0] - below)
    a = field.radius / (1.0 - v)
    if edges[k, 3] == 0.0:
        angle = 2.0 * math.pi * u
        return a * math.cos(angle), a * math.sin(angle), edges[k, 4], edges[k, 5]
    if u < 0.5:
        a, u = -a, 2.0 * u
    else:
        u = 2.0 * u - 1.0
    position = u * (field.sinc2_quantiles.size - 1)
    i = min(int(position), field.sinc2_quantiles.size - 2)
    low, high = field.sinc2_quantiles[i], field.sinc2_quantiles[i + 1]
    b = (low + (position - i) * (high - low)) / edges[k, 3]
    return a * edges[k, 1] - b * edges[k, 2], a * edges[k, 2] + b * edges[k, 1], edges[k, 4], edges[k, 5]


@device
def sample_deflection(field, u, v):
    """Sample a deflection from two numbers in [0, 1): spatial frequencies along x and y in cycles/mm.

    Also returns the weights of paths through the opening and through the gap.
    """
    inside = field.rows[field.rows.size - 1]
    opening_weight, gap_weight = 1.0, 0.0
    if u < inside:
        row, y = _find_interval(field.rows, u)
        column, x = _find_interval(field.columns[row], v)
        if field.opening is not None:
            opening_weight = field.opening[row, column]
            gap_weight = (1.0 - field.opening_fraction * opening_weight) / (1.0 - field.opening_fraction)
        x, y = (column + x) * field.step - field.radius, (row + y) * field.step - field.radius
    else:
        x, y, opening_weight, gap_weight = _sample_edges(field, (u - inside) / (1.0 - inside), v)
    scale = field.scale
    return scale[0, 0] * x + scale[0, 1] * y, scale[1, 0] * x + scale[1, 1] * y, opening_weight, gap_weight


@kernel
def fill_deflections(deflections, numbers, field):
    """Deflections (n, 4) for numbers (n, 2): frequencies along x and y, weights of paths through opening and gap."""
    for i in range(numbers.shape[0]):
        deflections[i, 0], deflections[i, 1], deflections[i, 2], deflections[i, 3] = sample_deflection(
            field, numbers[i, 0], numbers[i, 1]
        )
