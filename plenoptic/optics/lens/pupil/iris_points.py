"""Sampling patterns of the iris: points in the unit disc, in units of its semi-diameter."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from plenoptic.core.values import MAX_POINTS, Floats, whole

MOST_ACROSS = 2048
"""Largest number of points along a diameter, about 4 million in all."""

INSIDE = 1.0 - 1e-9
"""Radius in the unit disc of rays for the rim of the iris: rounding errors do not clip them."""
_SEARCHES = 3
"""Nested searches for an outermost point."""


def hexapolar(rings: int) -> Floats:
    """Hexapolar pattern: the centre and rings of 6, 12, 18, ... points, the outermost on the rim.

    The shape is (1 + 3 rings (rings + 1), 2), with the centre first. Each point has nearly the same area, except for
    the points on the rim.

    Parameters
    ----------
    rings : int
        At least 1.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.aiming.hexapolar(1).round(3).tolist()[:3]
    [[0.0, 0.0], [1.0, 0.0], [0.5, 0.866]]
    """
    count = whole(rings, "rings", at_least=1, at_most=MOST_ACROSS)
    points = [np.zeros((1, 2))]
    for ring in range(1, count + 1):
        angle = 2 * math.pi * np.arange(6 * ring) / (6 * ring)
        points.append(ring / count * np.column_stack([np.cos(angle), np.sin(angle)]))
    return np.concatenate(points)


def square_grid(n: int) -> Floats:
    """Square grid: the centres of n x n equal squares that lie within the disc, (k, 2), with k near pi n^2 / 4.

    The order is by rows from negative y. Each point has the same area; for odd n one lies in the centre.

    Parameters
    ----------
    n : int
        At least 1.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.aiming.square_grid(2).tolist()
    [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]]
    """
    count = whole(n, "n", at_least=1, at_most=MOST_ACROSS)
    x = (2 * np.arange(count) + 1 - count) / count
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    return np.asarray(points[np.hypot(points[:, 0], points[:, 1]) <= 1])


def fan(n: int) -> Floats:
    """Tangential fan of a field along y: n points on the diameter along y from -1 to 1, (n, 2).

    `fan(n)[:, ::-1]` is the fan along x.

    Parameters
    ----------
    n : int
        At least 2; for odd n one point lies in the centre.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.aiming.fan(3).tolist()
    [[0.0, -1.0], [0.0, 0.0], [0.0, 1.0]]
    """
    return np.column_stack([np.zeros(whole(n, "n", at_least=2, at_most=MAX_POINTS)), np.linspace(-1.0, 1.0, n)])


def outermost_finite(function: Callable[[Floats], Floats], end: float, points: int) -> tuple[float, float]:
    """Coordinate from -end to end, nearest to end, at which a function is finite, and its value there; or nan.

    Each search looks at some points between the last finite value of the one before and the next point.
    """
    low, high, place, value = -end, end, math.nan, math.nan
    for _ in range(_SEARCHES):
        places = np.linspace(low, high, points)
        values = function(places)
        finite = np.flatnonzero(np.isfinite(values))
        if not finite.size:
            break
        last = int(finite[-1])
        place, value = float(places[last]), float(values[last])
        if last == points - 1:
            break
        low, high = place, float(places[last + 1])
    return place, value
