"""Orthonormal frame about a direction: a device function."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device


@device
def frame_about(n):
    """Two unit vectors perpendicular to a unit normal (T. Duff et al., J. Comput. Graph. Tech. 6(1), 2017)."""
    sign = math.copysign(1.0, n[2])
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    return (1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]), (b, sign + n[1] * n[1] * a, -n[1])
