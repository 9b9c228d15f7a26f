"""Registry of freeform terms, and their types in Zemax files.

Each is a sag that is added to a plane, conic or asphere, and 0 at the vertex.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from plenoptic.optics.surfaces.biconic import BiconicSag
from plenoptic.optics.surfaces.zemax_shape import ZemaxShape
from plenoptic.optics.surfaces.zernike import ZernikeSag

FreeformTerm: TypeAlias = ZernikeSag | BiconicSag
"""Any freeform term."""

FREEFORM_TERMS: tuple[type[FreeformTerm], ...] = (ZernikeSag, BiconicSag)

ZEMAX: dict[str, Callable[[ZemaxShape], ZemaxShape]] = {
    "SZERNSAG": ZernikeSag.from_zemax,
    "BICONICX": BiconicSag.from_zemax,
}
"""By the TYPE of a surface: functions that read its freeform term from its numbers."""
