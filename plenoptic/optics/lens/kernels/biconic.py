"""Biconic sag and its derivatives at one point: the kernel."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.record import FIRST_NUMBER


@device
def biconic_at(x, y, numbers):
    """Sag and its derivatives by x and y, nan beyond the surface; `numbers` ends in those of `BiconicSag.numbers`."""
    c_x, c_y = numbers[FIRST_NUMBER], numbers[FIRST_NUMBER + 1]
    q_x, q_y = numbers[FIRST_NUMBER + 2], numbers[FIRST_NUMBER + 3]
    w = math.sqrt(1.0 - (q_x * x * x + q_y * y * y))
    sag = (c_x * x * x + c_y * y * y) / (1.0 + w)
    by_root = sag / w
    return sag, (2.0 * c_x + by_root * q_x) * x / (1.0 + w), (2.0 * c_y + by_root * q_y) * y / (1.0 + w)
