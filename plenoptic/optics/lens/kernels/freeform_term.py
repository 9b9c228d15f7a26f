"""Freeform term of a surface's sag, at one point and at the points of a block: functions for all kinds of term."""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import BLOCK, X, Y
from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.kernels.biconic import biconic_at, biconic_second_bound
from plenoptic.optics.lens.kernels.odd_powers import odd_powers_at
from plenoptic.optics.lens.kernels.zernike import fill_zernike, zernike_at
from plenoptic.optics.lens.lens_record import FREEFORM_KIND, SHARPEST
from plenoptic.optics.surfaces.biconic import BICONIC
from plenoptic.optics.surfaces.odd_powers import ODD_POWERS
from plenoptic.optics.surfaces.zernike import ZERNIKE


@device
def freeform_term_at(x, y, numbers):
    """Sag of the freeform term in mm and its derivatives by x and y; `numbers` is a row of `LensRecord.freeform`."""
    if numbers[FREEFORM_KIND] == ZERNIKE:
        return zernike_at(x, y, numbers)
    if numbers[FREEFORM_KIND] == BICONIC:
        return biconic_at(x, y, numbers)
    if numbers[FREEFORM_KIND] == ODD_POWERS:
        return odd_powers_at(x, y, numbers)
    return 0.0, 0.0, 0.0


@device
def fill_freeform_term(term, ray, numbers):
    """Fill the first 3 rows of `term` (5, BLOCK) with `freeform_term_at` for all rays of a block."""
    if numbers[FREEFORM_KIND] == ZERNIKE:
        fill_zernike(term, ray, numbers)
    elif numbers[FREEFORM_KIND] == BICONIC:
        for i in range(BLOCK):
            term[0, i], term[1, i], term[2, i] = biconic_at(ray[X + i], ray[Y + i], numbers)
    elif numbers[FREEFORM_KIND] == ODD_POWERS:
        for i in range(BLOCK):
            term[0, i], term[1, i], term[2, i] = odd_powers_at(ray[X + i], ray[Y + i], numbers)


@device
def freeform_second_bound(r2, numbers):
    """Upper bound, in 1/mm, of the second derivative in any direction, within x^2 + y^2 <= `r2`."""
    if numbers[FREEFORM_KIND] == BICONIC:
        return min(biconic_second_bound(r2, numbers), numbers[SHARPEST])
    return numbers[SHARPEST]
