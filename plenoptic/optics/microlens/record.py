"""A microlens array as the numbers that kernels read, in the axes in which it is traced."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.aperture import Walls, has_clear_gaps
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.imperfections import extreme_factors
from plenoptic.optics.microlens.lattice import Lattice, polygon_edges

MOST_LISTED = 4_000_000
"""Lenses with imperfections that a camera may need: each takes 1.1 kB and 5 us."""


MOST_SIDES = 40
"""Of a cell: the outline of a pupil, of 16 sides, may cut it, and there is room for 64."""

MICROLENS = np.dtype(
    [
        *((name, "f8") for name in ("power", "centre_x", "centre_y", "cell_x", "cell_y", "clip", "transmission")),
        *(("row", "i8"), ("axis_x", "f8"), ("axis_y", "f8")),
    ],
    align=True,
)
"""What is individual about a microlens: 1 / focal length in 1/mm; centre of the opening; that of the cell; 1 for paths
that must pass inside the opening, -1 for those that must pass beside it, 0 for those that need not; what part of the
light passes; row of the list of lenses, or -1; optical axis."""


class BinsRecord(NamedTuple):
    """A grid of bins, in which points are found."""

    x: float
    y: float
    """Corner of the grid in mm."""
    width: float
    """Of a bin in mm."""
    rows: int
    columns: int
    """Bins along x and along y."""
    first: NDArray[np.int64]
    members: NDArray[np.int64]
    """Points, bin after bin: those of bin b are members[first[b]] to members[first[b + 1]]."""


class NumbersRecord(NamedTuple):
    """Rows of listed lenses by their lattice index."""

    corner: NDArray[np.int64]
    """(2,): the least indices."""
    rows: NDArray[np.int64]
    """(p, q): the row of the lens corner + (i, j); -1 where it is not listed."""


class ListedRecord(NamedTuple):
    """Lenses one by one, and how to find them."""

    bins: BinsRecord
    offset: float
    """How far optical axes lie from the centres of cells at most, in mm."""
    lenses: NDArray[np.void]
    """(n,) of MICROLENS."""
    corners: Floats
    """(n, parts, k, 2): opening, and what lies beside it where that is clear, relative to the cell's centre."""
    counts: NDArray[np.int64]
    """(n, parts): corners of each."""
    cells: Floats | None
    """(n, k, 3): edges of the cells of FREE lenses; None where all cells are the lattice's."""
    numbers: NumbersRecord | None = None
    """Made for light that travels forwards; None for FREE lenses."""


class LatticeRecord(NamedTuple):
    """Lattice of microlenses with their types."""

    origin: Floats
    """(2,) centre of the lattice."""
    basis: Floats
    inverse: Floats
    powers: Floats
    """1 / focal length of each type in 1/mm, or with listed lenses, the least and the greatest."""
    pattern: NDArray[np.int64] | None
    """(p, q) types on the lattice; None where there is one."""


class OpeningRecord(NamedTuple):
    """Opening of a microlens within its cell."""

    corners: Floats
    """(parts, k, 2): the opening, and the cell where what lies beside openings is clear; widened by the margin."""
    radius: float
    """How far openings and cells reach from their centre, margin included."""
    edges: Floats
    """(k, 3) edges of an opening; none of a round one."""
    radius2: float
    """Squared radius of a round opening, inf otherwise."""
    clip: float
    """1 where paths must be tested against the opening, otherwise 0."""
    clear: bool
    """Whether light passes beside openings."""
    fills: bool
    """Whether cells alone end the lenses."""


class EdgesRecord(NamedTuple):
    """Edges of lenses with thickness."""

    cell: Floats
    """(k, 3) edges of a cell."""
    cells: Floats | None
    """(n, k, 3): those of each listed lens; None where all cells are alike."""
    opening: Floats
    """(k, 3) edges of an opening."""
    radius2: float
    """Squared radius of a round opening, inf otherwise."""


class SensorPlane(NamedTuple):
    """The sensor behind the plane on which samples are aimed, which lies at z = 0."""

    distance: float
    """Along the axis in mm."""
    tilt: Floats | None
    """(2,): how the distance grows with x and y; None for a sensor parallel to the array."""
    axes: Floats | None = None
    """Forwards, (2, 3) from x, y, 1 to the sensor's own axes; None where they are the same."""


class ResponseRecord(NamedTuple):
    """Angular response of pixels; see `AngularResponse`."""

    well_depth: float
    refractive_index: float
    inverse_pupil: float
    exponent: float
    frame: Floats | None
    """(12,): the rotation, row by row, and the shift from the sensor's axes to the local ones; None where the sensor is
    centred and parallel to the array."""


class ArrayRecord(NamedTuple):
    """Lengths in mm, in the axes in which the array is traced."""

    lattice: LatticeRecord
    cell: Floats
    """(k, 3) edges of a cell."""
    opening: OpeningRecord
    listed: ListedRecord | None
    """None where lenses differ by type only."""
    walls: Floats | None
    """The edges of a cell where walls separate the spaces behind the cells."""
    model: tuple[Any, ...] | None
    """What the kernels of the model read beside all this, such as a `PlateRecord`; None for ideal lenses."""
    power_factors: Floats | None
    """Power of ideal lenses over that at 587.6 nm, at the camera's wavelength, then at those that paths draw; None
    where it is 1."""

    @property
    def differs(self) -> bool:
        """True if paths must store individual parameters of their microlens."""
        several = self.lattice.pattern is not None or len(self.opening.corners) > 1
        return self.listed is not None or several or self.opening.clip > 0 or self.walls is not None

    @property
    def cells(self) -> Floats | None:
        """(n, k, 3) edges of the cells of FREE lenses; None where all cells are the lattice's."""
        return None if self.listed is None else self.listed.cells

    @property
    def edges(self) -> EdgesRecord:
        """Edges of lenses with thickness."""
        return EdgesRecord(self.cell, self.cells, self.opening.edges, self.opening.radius2)

    @property
    def power(self) -> float:
        """1 / focal length of the first type in 1/mm; that of all lenses where they do not differ."""
        return float(self.lattice.powers[0])

    def own(self, n: int) -> NDArray[np.void] | None:
        """Arrays for the microlens parameters of n paths; None where microlenses do not differ."""
        return np.zeros(n, MICROLENS) if self.differs else None


def possible_powers(array: MicrolensArray) -> Floats:
    """Powers of which bounds must know, in 1/mm.

    Those of the types, of the strongest and the weakest lens that imperfections make, and 0 where light passes unbent.
    """
    powers = 1.0 / np.asarray(array.focal_lengths)
    least, largest = extreme_factors(array.imperfections)
    unbent = np.zeros(1 if has_clear_gaps(array.aperture) else 0)
    return np.unique(np.concatenate([powers, powers / least, powers / largest, unbent]))


def array_record(
    array: MicrolensArray,
    *,
    turn: Floats,
    origin: Floats,
    reach: float,
    margin: float,
    wavelengths: tuple[float, ...] = (),
) -> ArrayRecord:
    """Compile an array whose axes are turned by `turn` (2, 2) and whose centre lies at `origin` (2,).

    Lenses up to `reach` from the origin of the axes matter; `margin` is how far rays may run sideways between the
    principal plane and the curved side, by which openings are widened for drawing. `wavelengths` are the camera's and
    those that paths draw, in nm.
    """
    opening, rules, clear = array.opening, array.model.rules, has_clear_gaps(array.aperture)
    parts = [opening.corners, array.cell_corners] if clear else [opening.corners]
    basis, cell = array.basis @ turn.T, polygon_edges(array.cell_corners @ turn.T)
    several = len(set(array.focal_lengths)) > 1 and array.lattice is not Lattice.FREE
    listed = None
    powers = 1.0 / np.asarray(array.focal_lengths)
    if array.lattice is Lattice.FREE or array.imperfections is not None:
        listed = listed_record(array, turn=turn, origin=origin, reach=reach, margin=margin)
        found = listed.lenses["power"] if len(listed.lenses) else powers
        powers = np.unique([found.min(), found.max()])
    tested = array.aperture is not None and (
        math.isfinite(opening.radius) or (rules.is_plate and (array.aperture.fill_factor < 1 or listed is not None))
    )
    return ArrayRecord(
        LatticeRecord(
            origin=origin,
            basis=basis,
            inverse=np.asarray(np.linalg.inv(basis), dtype=np.float64),
            powers=np.append(powers, 0.0) if clear else powers,
            pattern=np.ascontiguousarray(array.type_pattern) if several and listed is None else None,
        ),
        cell,
        OpeningRecord(
            corners=_padded([_widened(part, margin) @ turn.T for part in parts]),
            radius=array.cell_radius + margin,
            edges=np.column_stack([opening.edges[:, :2] @ turn.T, opening.edges[:, 2]]),
            radius2=opening.radius**2,
            clip=1.0 if tested else 0.0,
            clear=clear,
            fills=array.aperture is None,
        ),
        listed,
        cell if array.walls is Walls.OPAQUE else None,
        rules.record(array, wavelengths),
        _power_factors(array, wavelengths) if rules.is_thin else None,
    )


def lone_lens(array: MicrolensArray, power: float, wavelength: float) -> ArrayRecord:
    """A lens of the array's model and another power, about the origin, which nothing ends."""
    none, nowhere = np.zeros((0, 3)), np.zeros((0, 0, 2))
    opening = OpeningRecord(nowhere, math.inf, none, math.inf, clip=0.0, clear=False, fills=True)
    lattice = LatticeRecord(np.zeros(2), np.eye(2), np.eye(2), np.array([power]), None)
    return ArrayRecord(lattice, none, opening, None, None, array.model.rules.record(array, (wavelength,)), None)


def _power_factors(array: MicrolensArray, wavelengths: tuple[float, ...]) -> Floats | None:
    factors = np.array([array.power_factor(wavelength) for wavelength in wavelengths])
    return factors if (factors != 1.0).any() else None


def _widened(corners: Floats, margin: float) -> Floats:
    apothem = float(polygon_edges(corners)[:, 2].min())
    return np.asarray(corners * (1.0 + margin / apothem))


def _padded(parts: list[Floats]) -> Floats:
    """Polygons as one array; the last corner of the shorter ones is repeated."""
    most = max(map(len, parts))
    return np.stack([np.concatenate([part, np.repeat(part[-1:], most - len(part), axis=0)]) for part in parts])


class Outlines(NamedTuple):
    """Cells and openings of listed lenses about their designed centres: corners (n, k, 2), and how many count."""

    bins: BinsRecord
    cells: Floats
    cell_counts: NDArray[np.int64]
    wide: Floats
    """The cells, widened by a margin."""
    wide_counts: NDArray[np.int64]
    openings: Floats
    """Those of the design, displaced and widened, as far as they lie in the widened cells."""
    counts: NDArray[np.int64]


def outlines(array: MicrolensArray, points: Floats, shifts: Floats, *, turn: Floats, margin: float) -> Outlines:
    """Outlines of the lenses with designed centres at points (n, 2) and openings displaced by shifts (n, 2).

    Those of FREE lattices must be all there are, since each ends the cells of its neighbours.
    """
    from plenoptic.optics.microlens.kernels.listed import fill_bins, fill_cells, fill_openings

    bins = _grid(points, array)
    fill_bins(bins, points)
    base = np.asarray(array.cell_corners) @ turn.T
    opening = _widened(array.opening.corners, margin) @ turn.T
    if array.aperture is None:
        opening = 4.0 * base  # the cell alone ends the lens
    cell_counts, wide_counts, counts = np.empty((3, len(points)), np.int64)
    # Cells have edges with those of lenses up to twice as far away.
    widest = float(np.hypot(*base.T).max())
    room, neighbours = 12, bins if array.lattice is Lattice.FREE else None
    while True:
        cells, wide, corners = np.zeros((3, len(points), room, 2))
        most = max(
            fill_cells(cells, cell_counts, points, base, 0.0, 2.0 * widest, neighbours),
            fill_cells(wide, wide_counts, points, base, margin, 2.0 * (widest + margin), neighbours),
        )
        if most <= min(room, MOST_SIDES):
            most = fill_openings(corners, counts, wide, wide_counts, opening, shifts)
        if most > MOST_SIDES:
            raise InvalidValueError(
                f"a cell of the FREE lattice has {most} sides or more, and the limit is {MOST_SIDES}; spread its "
                "neighbours, which stand around it in a circle"
            )
        if most <= room:
            return Outlines(bins, cells, cell_counts, wide, wide_counts, corners, counts)
        room = most


def listed_record(array: MicrolensArray, *, turn: Floats, origin: Floats, reach: float, margin: float) -> ListedRecord:
    """The lenses up to `reach` from the origin of the axes, one by one; dark ones are left out."""
    far = reach + float(np.hypot(*origin)) + array.cell_radius
    if array.lattice is not Lattice.FREE and (2 * far) ** 2 / array.cell_area > MOST_LISTED:
        raise InvalidValueError(
            f"some {(2 * far) ** 2 / array.cell_area:.3g} microlenses have imperfections, and the limit is "
            f"{MOST_LISTED}; list deviations of single lenses, or increase the pitch"
        )
    found = array.lenses((-far, -far), (far, far))
    points = np.ascontiguousarray(found.design @ turn.T + origin)
    shifts = np.ascontiguousarray((found.centre - found.design) @ turn.T)
    bins, cells, cell_counts, wide, wide_counts, corners, counts = outlines(
        array, points, shifts, turn=turn, margin=margin
    )
    lenses = np.empty(len(points), MICROLENS)
    lenses["power"], lenses["transmission"] = found.power, found.transmission
    lenses["centre_x"], lenses["centre_y"] = (found.centre @ turn.T + origin).T
    lenses["cell_x"], lenses["cell_y"] = points.T
    lenses["clip"], lenses["row"] = 0.0, np.arange(len(points))
    lenses["axis_x"], lenses["axis_y"] = (found.axis @ turn.T + origin).T
    counts[found.transmission == 0] = 0
    both = has_clear_gaps(array.aperture)
    return ListedRecord(
        bins=bins,
        offset=float(np.hypot(*(found.axis - found.design).T).max(initial=0.0)),
        lenses=lenses,
        corners=np.stack([corners, wide] if both else [corners], axis=1),
        counts=np.stack([counts, wide_counts] if both else [counts], axis=1),
        cells=_cell_edges(cells, cell_counts) if array.lattice is Lattice.FREE else None,
    )


def _grid(points: Floats, array: MicrolensArray) -> BinsRecord:
    """A grid of empty bins, for some lenses in each."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    width = max(2.0 * min(array.pitches), math.sqrt(4.0 * float((high - low).prod()) / max(len(points), 1)))
    rows, columns = (np.floor((high - low) / width) + 1).astype(int).tolist()
    first, members = np.zeros(rows * columns + 1, np.int64), np.empty(len(points), np.int64)
    return BinsRecord(float(low[0]), float(low[1]), width, rows, columns, first, members)


def _cell_edges(cells: Floats, counts: NDArray[np.int64]) -> Floats:
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
