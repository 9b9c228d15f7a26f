"""A lens as the columns of numbers that the kernels in `_trace` read."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.optics.stops import PolygonStop
from plenoptic.optics.surface import Surface

if TYPE_CHECKING:
    from plenoptic.optics.lens import LensStack

SURFACE, CIRCLE, POLYGON = 0, 1, 2


class LensTables(NamedTuple):
    """Columns, one entry an element, in the order in which light meets them."""

    kind: NDArray[np.int64]
    """SURFACE, CIRCLE or POLYGON."""
    z: NDArray[np.float64]
    """Vertices in mm."""
    curvature: NDArray[np.float64]
    """1 / radius in 1/mm; 0 for planes and stops."""
    index_ratio: NDArray[np.float64]
    """Index before over index behind, in the direction of travel."""
    clear: NDArray[np.float64]
    """Squared semi-diameter in mm^2."""
    number: NDArray[np.float64]
    """Index of the element in the lens."""
    edges: NDArray[np.float64]
    """(k, 3): outward normal x, y and distance from the axis of the edges of all polygonal stops."""
    first_edge: NDArray[np.int64]
    """(n + 1,): the edges of element i are first_edge[i] to first_edge[i + 1]."""
    direction: float
    """+1 towards the sensor, -1 towards the scene."""


def lens_tables(lens: LensStack, wavelength: float, *, reverse: bool, round_stops: bool = False) -> LensTables:
    """Tables for one wavelength (nm) and one direction of travel.

    With `round_stops`, polygonal stops become the circles around them: what bounds on pupils are made of.
    """
    order = list(range(len(lens.elements)))
    index = np.asarray(lens.indices(wavelength), dtype=np.float64)
    ratio = index[:-1] / index[1:]
    if reverse:
        order.reverse()
        ratio = 1.0 / ratio
    elements = [lens.elements[i] for i in order]
    edges: list[tuple[float, float, float]] = []
    first_edge = [0]
    kind = []
    for element in elements:
        if isinstance(element, Surface):
            kind.append(SURFACE)
        elif isinstance(element, PolygonStop) and not round_stops:
            kind.append(POLYGON)
            edges.extend((float(nx), float(ny), element.apothem) for nx, ny in element.normals)
        else:
            kind.append(CIRCLE)
        first_edge.append(len(edges))
    return LensTables(
        kind=np.array(kind, dtype=np.int64),
        z=np.ascontiguousarray(lens.vertices[order]),
        curvature=np.array([e.curvature if isinstance(e, Surface) else 0.0 for e in elements]),
        index_ratio=np.ascontiguousarray(ratio[order]),
        clear=np.array([e.semi_diameter**2 for e in elements]),
        number=np.array(order, dtype=np.float64),
        edges=np.array(edges, dtype=np.float64).reshape(-1, 3),
        first_edge=np.array(first_edge, dtype=np.int64),
        direction=-1.0 if reverse else 1.0,
    )
