"""A point on a light, drawn by power: device functions."""

from __future__ import annotations

import math

from plenoptic._jit import device


@device
def choose(cdf, u):
    """Index of the entry of a cumulative distribution that holds u, and u stretched to [0, 1) within it."""
    low, high = 0, cdf.size - 1
    while low < high:
        middle = (low + high) // 2
        if cdf[middle] > u:
            high = middle
        else:
            low = middle + 1
    before = cdf[low - 1] if low > 0 else 0.0
    return low, min(max((u - before) / (cdf[low] - before), 0.0), 1.0)


@device
def point_on_triangle(vertices, triangles, k, u, v):
    """Uniformly distributed point of triangle k and its normal times twice its area."""
    a, b, c = vertices[triangles[k, 0]], vertices[triangles[k, 1]], vertices[triangles[k, 2]]
    root = math.sqrt(u)
    s, t = root * (1.0 - v), root * v
    e1x, e1y, e1z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    e2x, e2y, e2z = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    return a[0] + s * e1x + t * e2x, a[1] + s * e1y + t * e2y, a[2] + s * e1z + t * e2z, nx, ny, nz
