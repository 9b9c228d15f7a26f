"""Regions of the plane z = 0 cut into triangles that neither overlap nor leave gaps.

Neighbouring triangles share whole edges: a corner within the edge of another one would open a crack by rounding.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.materials.registry import Material

Faces = NDArray[np.int64]

MOST_SQUARES = 1 << 20
"""Of a board, or facets of a body: some 500 MB while they are made."""


def flat_mesh(corners: ArrayLike, faces: ArrayLike, material: Material, name: str = "") -> Mesh:
    """A mesh in the plane z = 0 of those corners (n, 2) that the faces use."""
    used, renumbered = np.unique(np.asarray(faces), return_inverse=True)
    return Mesh(in_plane(np.asarray(corners)[used]), renumbered.reshape(-1, 3), material, name=name)


def in_plane(places: Floats) -> Floats:
    """Points (n, 2) of the plane z = 0 as points (n, 3) of space."""
    return np.column_stack([places, np.zeros(len(places))])


def grid_corners(x: Floats, y: Floats) -> Floats:
    """(len(y) len(x), 2): where the lines of a grid cross, row by row."""
    return np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1).reshape(-1, 2)


def grid_faces(chosen: NDArray[np.bool_]) -> Faces:
    """Two triangles for each chosen cell (rows, columns) of a grid whose lines ascend; corners as `grid_corners`."""
    row, column = np.nonzero(chosen)
    a = row * (chosen.shape[1] + 1) + column
    c = a + chosen.shape[1] + 1
    return np.concatenate([np.stack([a, a + 1, c + 1], axis=1), np.stack([a, c + 1, c], axis=1)])


def cell_corners(lower_left: NDArray[np.int64], columns: int) -> NDArray[np.int64]:
    """Corners (n, 4) of cells of a grid by the lower left ones, counter-clockwise from the upper right one."""
    return np.add.outer(lower_left, [columns + 2, columns + 1, 0, 1])


def equal_area(sides: int) -> float:
    """Radius of the corners of a regular polygon over that of the circle of its area, n / 2 sin(2 pi / n) = pi."""
    return math.sqrt(2 * math.pi / (sides * math.sin(2 * math.pi / sides)))


def snap(places: Floats, tolerance: float) -> Floats:
    """Coordinates in which neighbours within the tolerance have one value."""
    values, number = np.unique(places, return_inverse=True)
    first = np.concatenate([[True], np.diff(values) > tolerance])
    return np.asarray(values[first][np.cumsum(first) - 1][number].reshape(places.shape))


def free_rectangles(outer: ArrayLike, taken: Floats) -> Floats:
    """Rectangles (x0, y0, x1, y1) that tile the rest of an outer one outside of others, (n, 4), which do not overlap.

    Strips between all their upper and lower edges are cut where the others begin and end, then joined upwards.
    """
    left, bottom, right, top = np.asarray(outer, dtype=np.float64).tolist()
    begun: dict[tuple[float, float], float] = {}
    free = []
    for low, high in itertools.pairwise(np.unique([bottom, top, *taken[:, 1], *taken[:, 3]]).tolist()):
        within = taken[(taken[:, 1] <= low) & (taken[:, 3] >= high)]
        within = within[np.argsort(within[:, 0])]
        starts, ends = [left, *within[:, 2].tolist()], [*within[:, 0].tolist(), right]
        stretches = [(a, b) for a, b in zip(starts, ends, strict=True) if b > a]
        for a, b in [stretch for stretch in begun if stretch not in stretches]:
            free.append((a, begun.pop((a, b)), b, low))
        begun.update({stretch: low for stretch in stretches if stretch not in begun})
    free += [(a, start, b, top) for (a, b), start in begun.items()]
    return np.array(free, dtype=np.float64).reshape(-1, 4)


def joined_rectangles(rectangles: Floats) -> tuple[Floats, list[Faces]]:
    """Corners (m, 2), and the triangles of each rectangle (x0, y0, x1, y1), which share all corners on their edges.

    Edges that touch need the same coordinates bit for bit.
    """
    x0, y0, x1, y1 = rectangles.T
    ends = np.concatenate([np.stack(pair, axis=1) for pair in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))])
    corners = np.unique(ends, axis=0)
    middles = np.stack([0.5 * (x0 + x1), 0.5 * (y0 + y1)], axis=1)
    faces = [_fan(rectangle, corners, len(corners) + k) for k, rectangle in enumerate(rectangles)]
    return np.concatenate([corners, middles]), faces


def _fan(rectangle: Floats, corners: Floats, middle: int) -> Faces:
    """Triangles of a rectangle, around its middle if there are corners of others on its edges."""
    x0, y0, x1, y1 = rectangle
    x, y = corners.T
    touching = np.flatnonzero((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))
    x, y = corners[touching].T
    # Counter-clockwise from the lower left: along the lower, right, upper and left edge. Nothing lies inside.
    edges = [(y == y0) & (x < x1), (x == x1) & (y < y1), (y == y1) & (x > x0), x == x0]
    order = np.lexsort([np.select(edges, [x, y, -x, -y]), np.select(edges, [0, 1, 2, 3])])
    ring = touching[order]
    if len(ring) == 4:
        return ring[[[0, 1, 2], [0, 2, 3]]]
    return np.stack([np.full(len(ring), middle), ring, np.roll(ring, -1)], axis=1)


def faces_around(sides: int) -> Faces:
    """Triangles between a regular polygon and the corners of a rectangle around it.

    Corners 0 ... sides - 1 are those of the polygon, at least 4, counter-clockwise from the direction of x; the next
    four are those of the rectangle, counter-clockwise from its upper right one. Polygon and rectangle have the same
    middle and do not touch.
    """
    # Each edge belongs to the corner of the quadrant that it faces, by the middle of its two corners' angles.
    quadrant = (4 * (2 * np.arange(sides) + 1)) // (2 * sides)
    following = (np.arange(sides) + 1) % sides
    edges = np.stack([following, np.arange(sides), sides + quadrant], axis=1)
    last = np.flatnonzero(quadrant != np.roll(quadrant, -1))
    sideways = np.stack([following[last], sides + quadrant[last], sides + (quadrant[last] + 1) % 4], axis=1)
    return np.concatenate([edges, sideways])


def dot_faces(first: int, sides: int, cells: NDArray[np.int64]) -> tuple[Faces, Faces]:
    """Triangles of polygons, whose corners are numbered from the first one, and those around them in cells (n, 4)."""
    corners = np.concatenate([first + np.arange(len(cells) * sides).reshape(-1, sides), cells], axis=1)
    fan = np.stack([np.zeros(sides - 2, dtype=np.int64), np.arange(1, sides - 1), np.arange(2, sides)], axis=1)
    return corners[:, fan].reshape(-1, 3), corners[:, faces_around(sides)].reshape(-1, 3)


def polygon(sides: int, radius: float) -> Floats:
    """(sides, 2): corners of a regular polygon around the origin, counter-clockwise from the direction of x."""
    angle = 2 * np.pi * np.arange(sides) / sides
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
