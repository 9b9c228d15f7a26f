"""Freeform term of a surface's sag at one point: the kernels of all kinds behind one function."""

from __future__ import annotations

from plenoptic.core.numba.jit import device
from plenoptic.optics.lens.kernels.biconic import biconic_at
from plenoptic.optics.lens.kernels.zernike import zernike_at
from plenoptic.optics.lens.record import FREEFORM_KIND
from plenoptic.optics.surfaces.biconic import BICONIC
from plenoptic.optics.surfaces.zernike import ZERNIKE


@device
def freeform_term_at(x, y, numbers):
    """Sag of the term and its derivatives by x and y; `numbers` is a row of `LensRecord.freeform`."""
    if numbers[FREEFORM_KIND] == ZERNIKE:
        return zernike_at(x, y, numbers)
    if numbers[FREEFORM_KIND] == BICONIC:
        return biconic_at(x, y, numbers)
    return 0.0, 0.0, 0.0
