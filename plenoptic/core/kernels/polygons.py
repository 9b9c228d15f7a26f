"""Convex polygons: device functions. A polygon is (4, room): its corners' x and y, and room for those of the next."""

from __future__ import annotations

from plenoptic.core.jit import device


@device
def cut(polygon, n, a, b, limit):
    """Cut a polygon of n corners with the half-plane a x + b y <= limit; returns the number of corners left."""
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x, y = polygon[0, i], polygon[1, i]
        here = limit - (a * x + b * y)
        there = limit - (a * polygon[0, j] + b * polygon[1, j])
        if here >= 0.0:
            polygon[2, kept], polygon[3, kept] = x, y
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            f = here / (here - there)
            polygon[2, kept], polygon[3, kept] = x + f * (polygon[0, j] - x), y + f * (polygon[1, j] - y)
            kept += 1
    for i in range(kept):
        polygon[0, i], polygon[1, i] = polygon[2, i], polygon[3, i]
    return kept
