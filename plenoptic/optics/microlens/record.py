"""A microlens array as the numbers that kernels read, in the axes in which it is traced."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.aperture import Gaps, Opening, Walls
from plenoptic.optics.microlens.array import MicrolensArray, MicrolensModel
from plenoptic.optics.microlens.imperfections import largest_factor, least_factor
from plenoptic.optics.microlens.lattice import Lattice, polygon_edges

MOST_LISTED = 4_000_000
"""Lenses with imperfections that a camera may need: each takes 1.1 kB and 5 us."""


class ListedLenses(NamedTuple):
    """Lenses one by one, and a grid of bins to find them."""

    bins: NDArray[np.float64]
    """Corner x, y of the grid and width of a bin in mm; bins along x and y; how far axes lie from cells' centres."""
    bin_first: NDArray[np.int64]
    members: NDArray[np.int64]
    """Lenses, bin after bin: those of bin b from bin_first[b] on."""
    lenses: NDArray[np.float64]
    """(n, LANE + 2): what a path keeps of its lens (see `to_lens`), and the optical axis."""
    corners: NDArray[np.float64]
    """(n, parts, k, 2): opening, and what lies beside it where that is clear, relative to the cell's centre."""
    counts: NDArray[np.int64]
    """(n, parts): corners of each."""
    cells: NDArray[np.float64] | None
    """(n, k, 3): edges of the cells of FREE lenses; None where all cells are the lattice's."""


class ArrayTables(NamedTuple):
    """Lengths in mm, in the axes in which the array is traced."""

    origin: NDArray[np.float64]
    """(2,) centre of the lattice."""
    basis: NDArray[np.float64]
    inverse: NDArray[np.float64]
    corners: NDArray[np.float64]
    """(parts, k, 2): the opening, and the cell where what lies beside openings is clear; widened by strays."""
    cell: NDArray[np.float64]
    """(k, 3) edges of a cell."""
    opening: NDArray[np.float64]
    """(k, 3) edges of an opening; none of a round one."""
    radius2: float
    """Squared radius of a round opening, inf otherwise."""
    clip: float
    """1 where paths must be tested against the opening, otherwise 0."""
    powers: NDArray[np.float64]
    """1 / focal length of each type in 1/mm, or with listed lenses, the least and the greatest."""
    pattern: NDArray[np.int64] | None
    """(p, q) types on the lattice; None where there is one."""
    listed: ListedLenses | None
    """None where lenses differ by type only."""
    radius: float
    """How far openings and cells reach from their centre, strays included."""
    model: MicrolensModel
    walls: bool
    """Whether walls separate the spaces behind the cells."""

    @property
    def differs(self) -> bool:
        """Whether paths must keep what is individual about their microlens."""
        return (
            self.listed is not None or self.pattern is not None or self.clip > 0 or len(self.corners) > 1 or self.walls
        )


def possible_powers(array: MicrolensArray) -> NDArray[np.float64]:
    """Powers of which bounds must know, in 1/mm.

    Those of the types, of the strongest and the weakest lens that imperfections make, and 0 where light passes unbent.
    """
    powers = 1.0 / np.asarray(array.focal_lengths)
    found = [powers]
    if array.imperfections is not None:
        found.append(powers / least_factor(array.imperfections))
        found.append(powers / largest_factor(array.imperfections))
    if array.aperture is not None and array.aperture.gaps is Gaps.CLEAR:
        found.append(np.zeros(1))
    return np.unique(np.concatenate(found))


def array_tables(
    array: MicrolensArray, *, turn: NDArray[np.float64], origin: NDArray[np.float64], reach: float, stray: float
) -> ArrayTables:
    """Compile an array whose axes are turned by `turn` (2, 2) and whose centre lies at `origin` (2,).

    Lenses up to `reach` from the origin of the axes matter; `stray` is how far rays may stray sideways between the
    principal plane and the curved side, by which openings are widened for drawing.
    """
    opening, clear = array.opening, array.aperture is not None and array.aperture.gaps is Gaps.CLEAR
    round_one = math.isfinite(opening.radius)
    parts = [opening.corners, array.cell_corners] if clear else [opening.corners]
    basis = array.basis @ turn.T
    several = len(set(array.focal_lengths)) > 1 and array.lattice is not Lattice.FREE
    listed = None
    powers = 1.0 / np.asarray(array.focal_lengths)
    if array.lattice is Lattice.FREE or array.imperfections is not None:
        listed = listed_lenses(array, turn=turn, origin=origin, reach=reach, stray=stray)
        found = listed.lenses[:, 0] if len(listed.lenses) else powers
        powers = np.unique([found.min(), found.max()])
    tested = array.aperture is not None and (round_one or (array.is_plate and array.aperture.fill_factor < 1))
    return ArrayTables(
        origin=origin,
        basis=basis,
        inverse=np.asarray(np.linalg.inv(basis), dtype=np.float64),
        corners=_padded([_widened(part, stray) @ turn.T for part in parts]),
        cell=polygon_edges(array.cell_corners @ turn.T),
        opening=_turned_edges(opening, turn),
        radius2=opening.radius**2,
        clip=1.0 if tested or (listed is not None and array.is_plate and array.aperture is not None) else 0.0,
        powers=np.append(powers, 0.0) if clear else powers,
        pattern=np.ascontiguousarray(array.type_pattern) if several and listed is None else None,
        listed=listed,
        radius=array.cell_radius + stray,
        model=array.model,
        walls=array.walls is Walls.OPAQUE,
    )


def _turned_edges(opening: Opening, turn: NDArray[np.float64]) -> NDArray[np.float64]:
    edges = np.array(opening.edges)
    edges[:, :2] = edges[:, :2] @ turn.T
    return edges


def _widened(corners: NDArray[np.float64], stray: float) -> NDArray[np.float64]:
    apothem = float(polygon_edges(corners)[:, 2].min())
    return np.asarray(corners * (1.0 + stray / apothem))


def _padded(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Polygons as one array; the last corner of the shorter ones is repeated."""
    most = max(map(len, parts))
    return np.stack([np.concatenate([part, np.repeat(part[-1:], most - len(part), axis=0)]) for part in parts])


def listed_lenses(
    array: MicrolensArray, *, turn: NDArray[np.float64], origin: NDArray[np.float64], reach: float, stray: float
) -> ListedLenses:
    """The lenses up to `reach` from the origin of the axes, one by one; dark ones are left out."""
    from plenoptic.optics.microlens.kernels.listed import fill_bins, fill_openings
    from plenoptic.optics.microlens.kernels.to_lens import LANE

    far = reach + float(np.hypot(*origin)) + array.cell_radius
    if array.lattice is not Lattice.FREE and (2 * far) ** 2 / array.cell_area > MOST_LISTED:
        raise InvalidValueError(
            f"some {(2 * far) ** 2 / array.cell_area:.3g} microlenses have imperfections, and the limit is "
            f"{MOST_LISTED}; list deviations of single lenses, or increase the pitch"
        )
    found = array.lenses((-far, -far), (far, far))
    points = np.ascontiguousarray(found.design @ turn.T + origin)
    offset = float(np.hypot(*(found.axis - found.design).T).max(initial=0.0))
    bins, bin_first = _grid(points, array, offset)
    members = np.empty(len(points), np.int64)
    fill_bins(bin_first, members, points, bins)
    free = array.lattice is Lattice.FREE
    base = np.asarray(array.cell_corners) @ turn.T
    opening = _widened(array.opening.corners, stray) @ turn.T
    if array.aperture is None:
        opening = 4.0 * base  # the cell alone ends the lens
    shifts = np.ascontiguousarray((found.centre - found.design) @ turn.T)
    cell_counts, wide_counts, counts = np.empty((3, len(points)), np.int64)
    room = 12
    while True:
        cells, wide, corners = np.zeros((3, len(points), room, 2))
        most = fill_openings(
            cells,
            cell_counts,
            wide,
            wide_counts,
            corners,
            counts,
            points,
            shifts,
            base,
            opening,
            free,
            stray,
            bins,
            bin_first,
            members,
        )
        if most <= room:
            break
        room = most
    lenses = np.empty((len(points), LANE + 2))
    lenses[:, 0] = found.power
    lenses[:, 1:3] = found.centre @ turn.T + origin
    lenses[:, 3:5] = points
    lenses[:, 5], lenses[:, 6], lenses[:, 7] = 0.0, found.transmission, np.arange(len(points))
    lenses[:, 8:] = found.axis @ turn.T + origin
    counts[found.transmission == 0] = 0
    both = array.aperture is not None and array.aperture.gaps is Gaps.CLEAR
    return ListedLenses(
        bins=bins,
        bin_first=bin_first,
        members=members,
        lenses=lenses,
        corners=np.stack([corners, wide] if both else [corners], axis=1),
        counts=np.stack([counts, wide_counts] if both else [counts], axis=1),
        cells=_cell_edges(cells, cell_counts) if free else None,
    )


def _grid(
    points: NDArray[np.float64], array: MicrolensArray, offset: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A grid of bins with some lenses in each."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    width = max(2.0 * min(array.pitches), math.sqrt(4.0 * float((high - low).prod()) / max(len(points), 1)))
    rows, columns = (np.floor((high - low) / width) + 1).astype(int)
    return np.array([low[0], low[1], width, rows, columns, offset]), np.zeros(rows * columns + 1, np.int64)


def _cell_edges(cells: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, k, 3): edges of polygons (n, k, 2) of which the first `counts` corners count; others shut nothing out."""
    most = cells.shape[1]
    number = np.arange(most)
    following = np.where(number[None] + 1 < counts[:, None], number[None] + 1, 0)
    along = np.take_along_axis(cells, following[..., None], axis=1) - cells
    length = np.hypot(along[..., 0], along[..., 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        nx, ny = along[..., 1] / length, -along[..., 0] / length
    edges = np.stack([nx, ny, nx * cells[..., 0] + ny * cells[..., 1]], axis=-1)
    # Corners that are one but for rounding have no edge between them: its direction would be noise.
    short = length <= 1e-9 * np.abs(cells).max(axis=(1, 2), initial=0.0)[:, None]
    edges[(number[None] >= counts[:, None]) | short] = (0.0, 0.0, 1.0)
    return edges
