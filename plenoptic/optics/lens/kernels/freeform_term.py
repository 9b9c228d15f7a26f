"""Freeform term of a surface's sag at one point: the kernels of all kinds behind one function."""

from __future__ import annotations

from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.kernels.biconic import biconic_at, biconic_bending
from plenoptic.optics.lens.kernels.zernike import zernike_at
from plenoptic.optics.lens.lens_record import FREEFORM_KIND, SHARPEST
from plenoptic.optics.surfaces.biconic import BICONIC
from plenoptic.optics.surfaces.zernike import ZERNIKE


@device
def freeform_term_at(x, y, numbers):
    """Added sag and its derivatives by x and y; `numbers` is a row of `LensRecord.freeform`."""
    if numbers[FREEFORM_KIND] == ZERNIKE:
        return zernike_at(x, y, numbers)
    if numbers[FREEFORM_KIND] == BICONIC:
        return biconic_at(x, y, numbers)
    return 0.0, 0.0, 0.0


@device
def freeform_bending(r2, numbers):
    """Bound on the second derivative in any direction up to a distance from the vertex, whose square is `r2`."""
    if numbers[FREEFORM_KIND] == BICONIC:
        return min(biconic_bending(r2, numbers), numbers[SHARPEST])
    return numbers[SHARPEST]
