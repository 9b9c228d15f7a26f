"""Kernels: polynomial of a sum of Zernike terms and its derivatives, at one point and at the points of a block."""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import BLOCK, X, Y
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.lens_record import FIRST_NUMBER

DEGREE, FIRST_POWER = FIRST_NUMBER, FIRST_NUMBER + 1
"""Columns of a freeform row: degree of the polynomial in x and y, and its first coefficient."""


@device
def zernike_at(x, y, numbers):
    """Sag in mm and its derivatives by x and y; `numbers` ends in those of `ZernikeSag.numbers`.

    Horner's scheme in x, whose coefficients are polynomials in y.
    """
    sag, dx, dy, j = 0.0, 0.0, 0.0, FIRST_POWER
    for n_powers in range(1, int(numbers[DEGREE]) + 2):
        q, q_by_y = 0.0, 0.0
        for _ in range(n_powers):
            q_by_y = q_by_y * y + q
            q = q * y + numbers[j]
            j += 1
        dx = dx * x + sag
        dy = dy * x + q_by_y
        sag = sag * x + q
    return sag, dx, dy


@device
def fill_zernike(term, ray, numbers):
    """Fill the first 3 rows of `term` (5, BLOCK) with `zernike_at` for all rays of a block; the others are buffers.

    The loops over coefficients are outermost, for SIMD.
    """
    sag, dx, dy, q, q_by_y = term[0], term[1], term[2], term[3], term[4]
    for i in range(BLOCK):
        sag[i], dx[i], dy[i] = 0.0, 0.0, 0.0
    j = FIRST_POWER
    for n_powers in range(1, int(numbers[DEGREE]) + 2):
        a = numbers[j]
        for i in range(BLOCK):
            q[i], q_by_y[i] = a, 0.0
        for k in range(j + 1, j + n_powers):
            a = numbers[k]
            for i in range(BLOCK):
                y = ray[Y + i]
                q_by_y[i] = q_by_y[i] * y + q[i]
                q[i] = q[i] * y + a
        j += n_powers
        for i in range(BLOCK):
            x = ray[X + i]
            dx[i] = dx[i] * x + sag[i]
            dy[i] = dy[i] * x + q_by_y[i]
            sag[i] = sag[i] * x + q[i]
