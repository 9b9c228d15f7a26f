"""Registry of freeform terms, and their types in Zemax files.

Each term is a sag that is added to a conic or asphere, and 0 at the vertex. Odd powers belong to types of Zemax files
that have even powers, too; see `lens.files.zemax`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from plenoptic.optics.surfaces.biconic import BiconicSag
from plenoptic.optics.surfaces.freeform_bounds import ZemaxNumbers
from plenoptic.optics.surfaces.odd_powers import OddPowerSag
from plenoptic.optics.surfaces.zernike import ZernikeSag

FreeformTerm: TypeAlias = ZernikeSag | BiconicSag | OddPowerSag
"""Any freeform term."""

FREEFORM_TERMS: tuple[type[FreeformTerm], ...] = (ZernikeSag, BiconicSag, OddPowerSag)


class ZemaxType(NamedTuple):
    """Type of a surface in Zemax files that has a freeform term."""

    read: Callable[[ZemaxNumbers], tuple[FreeformTerm | None, float]]
    """Returns the term, and its omitted sag at the vertex in mm."""
    n_parameters: int
    """Number of its PARM."""
    is_whole: bool = False
    """True if the term includes CURV, CONI and PARM; otherwise these describe an even asphere to which it is added."""


ZEMAX: dict[str, ZemaxType] = {
    "SZERNSAG": ZemaxType(ZernikeSag.from_zemax, 8),
    "BICONICX": ZemaxType(BiconicSag.from_zemax, 2, is_whole=True),
}
"""Zemax types by the TYPE of the surface."""
