"""Kernel: sum of Zernike polynomials and its derivatives at one point."""

from __future__ import annotations

from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.lens_record import FIRST_NUMBER


@device
def zernike_at(x, y, numbers):
    """Sag in mm and its derivatives by x and y; `numbers` ends in those of `ZernikeSag.numbers`.

    With zeta = (x + i y) / norm_radius, the derivatives of zeta^m by x and y are m zeta^(m - 1) and i times that.
    """
    scale, orders, width = numbers[FIRST_NUMBER], int(numbers[FIRST_NUMBER + 1]), int(numbers[FIRST_NUMBER + 2])
    x *= scale
    y *= scale
    u = x * x + y * y
    re, im = 1.0, 0.0
    before_re, before_im = 0.0, 0.0
    sag, dx, dy, by_u = 0.0, 0.0, 0.0, 0.0
    first = FIRST_NUMBER + 3
    for m in range(orders):
        p, p_by_u, q, q_by_u = 0.0, 0.0, 0.0, 0.0
        for j in range(first + width - 1, first - 1, -1):
            p_by_u = p_by_u * u + p
            p = p * u + numbers[j]
            q_by_u = q_by_u * u + q
            q = q * u + numbers[j + width]
        sag += p * re + q * im
        by_u += p_by_u * re + q_by_u * im
        dx += m * (p * before_re + q * before_im)
        dy += m * (q * before_re - p * before_im)
        before_re, before_im = re, im
        re, im = re * x - im * y, re * y + im * x
        first += 2 * width
    return sag, (dx + 2.0 * x * by_u) * scale, (dy + 2.0 * y * by_u) * scale
