"""Kernel: odd powers of the distance from the axis and their derivatives at one point."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.lens_record import FIRST_NUMBER


@device
def odd_powers_at(x, y, numbers):
    """Sag in mm and its derivatives by x and y; `numbers` ends in those of `OddPowerSag.numbers`."""
    u = x * x + y * y
    r = math.sqrt(u)
    sag, slope = 0.0, 0.0  # over r^3, and of dz/dr over r^2
    for i in range(int(numbers[FIRST_NUMBER]) - 1, -1, -1):
        a = numbers[FIRST_NUMBER + 1 + i]
        sag = sag * u + a
        slope = slope * u + (2 * i + 3) * a
    return sag * u * r, slope * r * x, slope * r * y
