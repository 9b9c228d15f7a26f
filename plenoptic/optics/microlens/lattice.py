"""Arrangement of microlenses on their plane: lattices, their cells, and patterns of types."""

from __future__ import annotations

import enum
import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, length_in_mm
from plenoptic.errors import InvalidValueError


class Lattice(enum.IntEnum):
    """Arrangement of the microlenses; except for FREE one is at the array's centre. See `MicrolensArray`."""

    HEXAGONAL = 0
    """Nearest neighbours along y; columns pitch sqrt(3)/2 apart along x."""
    SQUARE = 1
    """Neighbours along x and y."""
    RECTANGULAR = 2
    """Neighbours along x and y at two distances: pitch is (x, y)."""
    FREE = 3
    """Listed centres; a cell holds all points nearer to its centre than to any other, and within the pitch along x and
    y."""


def checked_pitch(pitch: float | tuple[float, float], lattice: Lattice) -> float | tuple[float, float]:
    """Pitch as one number, or two for RECTANGULAR, or an error."""
    if lattice is not Lattice.RECTANGULAR:
        if isinstance(pitch, tuple | list):
            raise InvalidValueError(f"pitch is {pitch}; only Lattice.RECTANGULAR has two: give one number in mm")
        return length_in_mm(pitch, "pitch")
    try:
        x, y = pitch  # type: ignore[misc]
    except (TypeError, ValueError):
        raise InvalidValueError(f"pitch is {pitch!r}; Lattice.RECTANGULAR needs two in mm, along x and y") from None
    return length_in_mm(x, "pitch along x"), length_in_mm(y, "pitch along y")


def checked_extent(extent: tuple[float, float], lattice: Lattice) -> tuple[float, float]:
    """Width and height in mm, or an error."""
    if lattice is Lattice.FREE:
        raise InvalidValueError("extent is given for the lattice FREE, which lists its lenses; leave it out")
    try:
        x, y = extent
    except (TypeError, ValueError):
        raise InvalidValueError(f"extent is {extent!r}; it must be two lengths in mm, along x and y") from None
    return length_in_mm(x, "extent along x"), length_in_mm(y, "extent along y")


def lattice_basis(lattice: Lattice, pitch: tuple[float, float]) -> Floats:
    """(2, 2) lattice vectors in mm as rows, for pitches along x and y (the same except for RECTANGULAR)."""
    if lattice is Lattice.HEXAGONAL:
        return np.array([[pitch[1] * math.sqrt(3) / 2, pitch[1] / 2], [0.0, pitch[1]]])
    return np.array([[pitch[0], 0.0], [0.0, pitch[1]]])


def neighbour_steps(lattice: Lattice) -> NDArray[np.int64]:
    """(k, 2) steps from a lens to its neighbours, in lattice indices: six in a hexagonal lattice, four in others."""
    steps = [[1, 0], [0, 1], [-1, 0], [0, -1]]
    return np.array([*steps, [1, -1], [-1, 1]] if lattice is Lattice.HEXAGONAL else steps, dtype=np.int64)


def cell_polygon(lattice: Lattice, pitch: tuple[float, float]) -> Floats:
    """(k, 2) corners of the cell around a lattice point in mm, counter-clockwise; for FREE the largest cell."""
    if lattice is Lattice.HEXAGONAL:
        return regular_polygon(6, pitch[1] / math.sqrt(3), 0.0)
    x, y = pitch if lattice is Lattice.FREE else (pitch[0] / 2, pitch[1] / 2)
    return np.array([[x, y], [-x, y], [-x, -y], [x, -y]])


def regular_polygon(sides: int, radius: float, first: float) -> Floats:
    """(sides, 2) corners of a regular polygon, counter-clockwise, the first one at an angle in radians from +x."""
    angle = first + 2 * math.pi * np.arange(sides) / sides
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def polygon_edges(corners: Floats) -> Floats:
    """(k, 3) outward normal x, y and distance from the origin of the edges of a counter-clockwise polygon."""
    along = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    return np.column_stack([normals, np.einsum("ij,ij->i", normals, corners)])


def polygon_area(corners: Floats) -> float:
    """Area of a counter-clockwise polygon in mm^2."""
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def polygon_moments(corners: Floats) -> tuple[Floats, Floats, Floats]:
    """Areas (n,), centroids (n, 2) and variances along x and y (n, 2) of counter-clockwise polygons (n, k, 2)."""
    start, end = corners, np.roll(corners, -1, axis=1)
    # Moments of triangles that have a corner in the origin.
    cross = start[..., 0] * end[..., 1] - start[..., 1] * end[..., 0]
    total = cross.sum(axis=1)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = np.einsum("ij,ijk->ik", cross, start + end) / (3.0 * total)
        second = np.einsum("ij,ijk->ik", cross, (start**2 + start * end + end**2) / 6) / total
    return 0.5 * total[:, 0], middle, second - middle**2


def default_pattern(types: int) -> NDArray[np.int64]:
    """(types, types) pattern of types: lens (i, j) has the type (i - j) mod types.

    On the hexagonal lattice with three types, all six neighbours of a lens are of the other two types, as in the
    multi-focus cameras of Perwass and Wietzke 2012 (doi 10.1117/12.909882); on the square one with two, it is a
    checkerboard.
    """
    i, j = np.meshgrid(np.arange(types), np.arange(types), indexing="ij")
    return np.asarray((i - j) % types, dtype=np.int64)


def rows_of(index: NDArray[np.int64], nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows in `index` (n, 2) of lattice points (..., 2); -1 if it does not hold them."""
    low, high = index.min(axis=0), index.max(axis=0)
    table = np.full(tuple(high - low + 1), -1, dtype=np.int64)
    table[tuple((index - low).T)] = np.arange(len(index))
    inside = ((nodes >= low) & (nodes <= high)).all(axis=-1)
    i, j = np.moveaxis(np.clip(nodes, low, high) - low, -1, 0)
    return np.where(inside, table[i, j], -1)
