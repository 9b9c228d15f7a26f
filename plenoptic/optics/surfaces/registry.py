"""Departures from rotational symmetry: the closed set, and their types in Zemax files.

Each is a sag that is added to a conic or asphere, and 0 at the vertex.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from plenoptic.optics.surfaces.zernike import ZernikeSag

Departure: TypeAlias = ZernikeSag
"""Any departure."""

DEPARTURES: tuple[type[Departure], ...] = (ZernikeSag,)

ZEMAX: dict[str, Callable[[Mapping[int, float], float], tuple[Departure | None, float]]] = {
    "SZERNSAG": ZernikeSag.from_zemax
}
"""By the TYPE of a surface: from its extra data (XDAT) and the unit in mm to the departure, and the sag at the vertex
that it leaves out, in mm. All of these types have the PARM of even aspheres."""
