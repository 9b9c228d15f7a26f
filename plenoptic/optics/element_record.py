"""Records of lens elements, shared by their descriptions and by kernels."""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from plenoptic.core.values import Floats


class ElementKind(enum.IntEnum):
    """Kind of a lens element. IDEAL_LENS stands for the whole lens in the models THIN and PARAXIAL.

    Examples
    --------
    See `replay`.
    """

    SPHERE = 0
    CIRCULAR_STOP = 1
    POLYGON_STOP = 2
    CONIC = 3
    ASPHERE = 4
    IDEAL_LENS = 5
    CURVED_POLYGON_STOP = 6
    STAR_STOP = 7
    MASK_STOP = 8
    FREEFORM = 9
    RING_STOP = 10


SPHERE, CIRCLE, POLYGON, CONIC, ASPHERE, IDEAL, ARCS, STAR, MASK, FREEFORM, RING = map(int, ElementKind)
"""The same numbers for kernels. SPHERE stands for planes too."""


class ElementRow(NamedTuple):
    """Numbers of an element for kernels; `LensRecord` explains the entries."""

    kind: int
    semi_diameter2: float = math.inf
    curvature: float = 0.0
    max_depth: float = math.inf
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()
    freeform: tuple[float, ...] = ()
    edges: tuple[tuple[float, ...], ...] = ()
    cells: Floats | None = None
    """Transmission of the cells of a mask stop."""
    cells_per_mm: float = 0.0
    z: float = 0.0
    """This and the following members are set by the lens."""
    surface_index: int = 0
    index_ratio: float = 1.0
    frame: tuple[float, ...] = ()
    mirror: tuple[float, ...] = ()

    @property
    def circular(self) -> ElementRow:
        """The row with the circle around the hole of a stop in place of its shape; other rows unchanged."""
        return self._replace(kind=CIRCLE, edges=(), cells=None) if self.edges or self.cells is not None else self


class PathWorkspace(NamedTuple):
    """Workspace for the optical path lengths of a block of rays."""

    indices: Floats
    """(n,) refractive index before each element, in the order of travel."""
    start: Floats
    """(6, block) points and directions before the current element."""
    length: Floats
    """(block,) optical path length so far, mm."""
