"""Angle of a direction in a plane: a device function."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device

_TERMS = tuple((-1.0) ** k / (2 * k + 1) for k in range(17))
_TAN_EIGHTH = math.tan(math.pi / 8)


@device
def arctan2(y, x):
    """Angle of (x, y) in [-pi, pi], to 2e-15: Taylor series up to an eighth of pi; 0 for (0, 0).

    Selections in place of branches: loops that call it are vectorised.
    """
    width, height = abs(x), abs(y)
    high, low = max(width, height), min(width, height)
    is_large = low > _TAN_EIGHTH * high
    over = low - high if is_large else low
    under = low + high if is_large else high
    t = over / (under if under > 0.0 else 1.0)
    t2, angle = t * t, _TERMS[16]
    for k in range(15, -1, -1):
        angle = angle * t2 + _TERMS[k]
    angle = angle * t + (0.25 * math.pi if is_large else 0.0)
    angle = 0.5 * math.pi - angle if height > width else angle
    angle = math.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle
