"""A biconic's sag and its derivatives at one point: the kernel."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.record import FIRST_NUMBER


@device
def biconic_at(x, y, numbers):
    """Sag and its derivatives by x and y, nan beyond the equator: `numbers` ends in those of `BiconicSag.numbers`."""
    cx, cy, kx, ky = (
        numbers[FIRST_NUMBER],
        numbers[FIRST_NUMBER + 1],
        numbers[FIRST_NUMBER + 2],
        numbers[FIRST_NUMBER + 3],
    )
    sx, sy = cx * x, cy * y
    w = math.sqrt(1.0 - (kx * sx * sx + ky * sy * sy))
    over = 1.0 / (1.0 + w)
    sag = (sx * x + sy * y) * over
    # The derivative of the sag by the squares under the root.
    change = 0.5 * sag * over / w
    return sag, 2.0 * sx * (over + kx * cx * change), 2.0 * sy * (over + ky * cy * change)
