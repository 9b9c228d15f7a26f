"""Convex polygons as arrays of corners: device functions."""

from __future__ import annotations

from plenoptic.core.jit import device


@device
def cut(x, y, n, a, b, limit, xs, ys):
    """Cut a convex polygon with the half-plane a x + b y <= limit; returns the number of corners left."""
    kept = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here = limit - (a * x[i] + b * y[i])
        there = limit - (a * x[j] + b * y[j])
        if here >= 0.0:
            xs[kept] = x[i]
            ys[kept] = y[i]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            f = here / (here - there)
            xs[kept] = x[i] + f * (x[j] - x[i])
            ys[kept] = y[i] + f * (y[j] - y[i])
            kept += 1
    for i in range(kept):
        x[i] = xs[i]
        y[i] = ys[i]
    return kept
