"""Registry of freeform terms, and their types in Zemax files.

Each is a sag that is added to a conic or asphere, and 0 at the vertex.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from plenoptic.optics.surfaces.zernike import ZernikeSag

FreeformTerm: TypeAlias = ZernikeSag
"""Any freeform term."""

FREEFORM_TERMS: tuple[type[FreeformTerm], ...] = (ZernikeSag,)

ZEMAX: dict[str, Callable[[Mapping[int, float], float], tuple[FreeformTerm | None, float]]] = {
    "SZERNSAG": ZernikeSag.from_zemax
}
"""By the TYPE of a surface: functions of its extra data (XDAT) and the unit in mm that return the freeform term, and
its omitted sag at the vertex in mm. All of these types have the PARM of even aspheres."""
