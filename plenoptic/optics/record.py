"""Records that descriptions of elements and kernels share: kinds of elements, and rows of their numbers."""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from plenoptic.core.values import Floats


class ElementKind(enum.IntEnum):
    """Kind of an element in a lens. IDEAL_LENS replaces the whole lens in the models THIN and PARAXIAL.

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
    """Numbers of an element; `LensRecord` explains the entries."""

    kind: int
    semi_diameter2: float = math.inf
    curvature: float = 0.0
    max_depth: float = math.inf
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()
    departure: tuple[float, ...] = ()
    edges: tuple[tuple[float, ...], ...] = ()
    cells: Floats | None = None
    """Transmission of the cells of a mask."""
    cells_per_mm: float = 0.0
    z: float = 0.0
    """Here and below, what the lens knows."""
    surface_index: int = 0
    index_ratio: float = 1.0
    frame: tuple[float, ...] = ()
    mirror: tuple[float, ...] = ()

    @property
    def opened(self) -> ElementRow:
        """The circle around a stop; other rows as they are."""
        return self._replace(kind=CIRCLE, edges=(), cells=None) if self.edges or self.cells is not None else self


class PathNotes(NamedTuple):
    """Arrays in which kernels store quantities of a block of rays, from which they find optical paths."""

    indices: Floats
    """(n,): refractive index before each element, in the order of travel."""
    start: Floats
    """(6, block): points and directions before the element at hand."""
    length: Floats
    """(block,), mm: the path so far."""
