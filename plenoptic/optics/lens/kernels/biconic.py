"""Kernel: sag of a biconic and its derivatives at one point."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.lens_record import FIRST_NUMBER


@device
def biconic_at(x, y, numbers):
    """Sag in mm and its derivatives by x and y, nan beyond the equator. `numbers` ends in those of
    `BiconicSag.numbers`."""
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
    # Derivative of the sag by the radicand.
    change = 0.5 * sag * over / w
    return sag, 2.0 * sx * (over + kx * cx * change), 2.0 * sy * (over + ky * cy * change)


@device
def biconic_second_bound(r2, numbers):
    """Upper bound, in 1/mm, of the second derivative in any direction, within x^2 + y^2 <= `r2`.

    For a sag A h(B), as in `surfaces.biconic`, |A| <= c r^2 and |B| <= p r^2; h and its derivatives increase with B.
    For a sphere the bound equals its second derivative along the radius.
    """
    cx, cy, kx, ky = (
        numbers[FIRST_NUMBER],
        numbers[FIRST_NUMBER + 1],
        numbers[FIRST_NUMBER + 2],
        numbers[FIRST_NUMBER + 3],
    )
    c = max(abs(cx), abs(cy))
    b_x, b_y = kx * cx * cx * r2, ky * cy * cy * r2
    w = math.sqrt(1.0 - max(b_x, b_y, 0.0))
    size, over = max(abs(b_x), abs(b_y)), 1.0 / (1.0 + w)
    first = 0.5 * over * over / w
    second = 0.25 * (1.0 + 3.0 * w) * (over / w) ** 3
    return 2.0 * c * (over + size * first) + 4.0 * c * size * (2.0 * first + size * second)
