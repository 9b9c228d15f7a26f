"""Shape of a surface in a Zemax file, as the readers of its freeform terms get it and return it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple


class ZemaxShape(NamedTuple):
    """Numbers of a surface's lines, and the freeform term read from them."""

    curvature: float
    """CURV, in 1/mm."""
    conic: float
    """CONI."""
    parameters: Mapping[int, float]
    """PARM by number, in the file's unit. A reader removes its own; the rest are those of an even asphere."""
    extra: Mapping[int, float]
    """XDAT by number, in the file's unit."""
    unit: float
    """The file's unit in mm."""
    freeform: Any = None
    """The freeform term; None without one."""
    offset: float = 0.0
    """Omitted sag of the term at the vertex, in mm."""
