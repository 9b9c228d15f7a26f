"""Record of a microlens array for kernels, in the axes in which it is traced."""

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

MAX_LISTED = 4_000_000
"""Limit of the lenses with imperfections of a camera: each takes 1.1 kB and 5 us."""


MAX_SIDES = 40
"""Limit of the sides of a cell: the outline of a pupil, of 16 sides, may clip it, and there is room for 64."""

MICROLENS = np.dtype(
    [
        *((name, "f8") for name in ("power", "centre_x", "centre_y", "cell_x", "cell_y", "clip", "transmission")),
        *(("row", "i8"), ("axis_x", "f8"), ("axis_y", "f8")),
    ],
    align=True,
)
"""Lenslet parameters: 1 / focal length in 1/mm; centre of the opening; centre of the cell; 1 for paths that must pass
the opening, -1 for those that must pass the gap, 0 for untested ones; transmission; row of the lens table, or -1;
optical axis."""


class BinsRecord(NamedTuple):
    """A grid of bins for looking up points."""

    x: float
    y: float
    """Corner of the grid in mm."""
    width: float
    """Side of a bin in mm."""
    rows: int
    columns: int
    """Bins along x and along y."""
    first: NDArray[np.int64]
    members: NDArray[np.int64]
    """Points in the order of bins: those of bin b are members[first[b]] to members[first[b + 1]]."""


class LatticeIndex(NamedTuple):
    """Rows of the lens table by lattice index."""

    corner: NDArray[np.int64]
    """(2,) smallest indices."""
    rows: NDArray[np.int64]
    """(p, q) row of the lens corner + (i, j); -1 if it is not in the table."""


class LensTable(NamedTuple):
    """Table of individual lenses, and grids to look them up."""

    bins: BinsRecord
    offset: float
    """Largest distance in mm of an optical axis from the centre of its cell."""
    lenses: NDArray[np.void]
    """(n,) of MICROLENS."""
    corners: Floats
    """(n, parts, k, 2): opening and, if gaps are clear, the cell, relative to the cell's centre."""
    counts: NDArray[np.int64]
    """(n, parts) number of corners of each."""
    cells: Floats | None
    """(n, k, 3) edges of the cells of FREE lenses; None if all cells are the lattice's."""
    lattice_index: LatticeIndex | None = None
    """For light that travels forwards; None for FREE lenses."""


class LatticeRecord(NamedTuple):
    """Positions and types of microlenses."""

    origin: Floats
    """(2,) centre of the lattice."""
    basis: Floats
    inverse: Floats
    powers: Floats
    """1 / focal length of each type in 1/mm, or with a lens table, the least and the greatest."""
    pattern: NDArray[np.int64] | None
    """(p, q) types on the lattice; None if there is one type."""
    extent: Floats | None = None
    """(3, 2) lattice vectors in the array's own axes, and largest |x| and |y| of centres there; None if unlimited."""


class OpeningRecord(NamedTuple):
    """Opening of a cell."""

    corners: Floats
    """(parts, k, 2): the opening and, if gaps are clear, the cell; widened by the margin."""
    radius: float
    """Radius of openings and cells about their centre, including the margin."""
    edges: Floats
    """(k, 3) edges of an opening; empty for a round one."""
    radius2: float
    """Squared radius of a round opening, inf otherwise."""
    clip: float
    """1 if paths must be tested against the opening, otherwise 0."""
    clear: bool
    """True if light passes the gaps."""
    fills: bool
    """True if only cells limit the lenses."""


class EdgesRecord(NamedTuple):
    """Edges that limit lenses with thickness."""

    cell: Floats
    """(k, 3) edges of a cell."""
    cells: Floats | None
    """(n, k, 3) edges of the cell of each lens of the table; None if all cells are equal."""
    opening: Floats
    """(k, 3) edges of an opening."""
    radius2: float
    """Squared radius of a round opening, inf otherwise."""


class SensorPlane(NamedTuple):
    """The sensor behind the plane of aim points, z = 0."""

    distance: float
    """Along the axis in mm."""
    tilt: Floats | None
    """(2,) derivatives of the distance with respect to x and y; None for a sensor parallel to the array."""
    axes: Floats | None = None
    """For light that travels forwards, (2, 3) from x, y, 1 to the sensor's axes; None if they are the same."""


class ResponseRecord(NamedTuple):
    """Angular response of pixels; see `AngularResponse`."""

    well_depth: float
    refractive_index: float
    inverse_pupil: float
    exponent: float
    frame: Floats | None
    """(12,) rotation, row by row, and shift from the sensor's axes to the local ones; None if the sensor is centred and
    parallel to the array."""


class WellsRecord(NamedTuple):
    """Wells of dual pixels that are read; see `DualPixels`. Lengths are in pitches."""

    depth: float
    inverse_pupil: float
    columns: Floats
    rows: Floats
    """(n, 2) ends of the wells along x and along -y."""
    table: Floats | None
    """(n, 2) angles along x in radians and responses; None: from the geometry."""
    frame: Floats | None
    """As in `ResponseRecord`."""


class ArrayRecord(NamedTuple):
    """A microlens array; lengths in mm, in the axes in which the array is traced."""

    lattice: LatticeRecord
    cell: Floats
    """(k, 3) edges of a cell."""
    opening: OpeningRecord
    lens_table: LensTable | None
    """None if lenses differ by type only."""
    walls: Floats | None
    """Edges of a cell if walls separate the spaces behind the cells."""
    model: tuple[Any, ...] | None
    """Record of the model for its kernels, such as a `PlateRecord`; None for ideal lenses."""
    power_factors: Floats | None
    """Power of ideal lenses over that at 587.6 nm, at the camera's wavelength, then at those sampled by paths; None
    if it is 1."""

    @property
    def differs(self) -> bool:
        """True if paths must keep lenslet parameters."""
        several = self.lattice.pattern is not None or len(self.opening.corners) > 1
        return self.lens_table is not None or several or self.opening.clip > 0 or self.walls is not None

    @property
    def cells(self) -> Floats | None:
        """(n, k, 3) edges of the cells of FREE lenses; None if all cells are the lattice's."""
        return None if self.lens_table is None else self.lens_table.cells

    @property
    def edges(self) -> EdgesRecord:
        """Edges that limit lenses with thickness."""
        return EdgesRecord(self.cell, self.cells, self.opening.edges, self.opening.radius2)

    @property
    def power(self) -> float:
        """1 / focal length of the first type in 1/mm; that of all lenses if they do not differ."""
        return float(self.lattice.powers[0])


def possible_powers(array: MicrolensArray) -> Floats:
    """Powers in 1/mm that bounds must cover.

    These are the powers of the types, of the strongest and the weakest lens with imperfections, and 0 for clear gaps.
    """
    powers = 1.0 / np.asarray(array.focal_lengths)
    smallest, largest = extreme_factors(array.imperfections)
    gap_power = np.zeros(1 if has_clear_gaps(array.aperture) else 0)
    return np.unique(np.concatenate([powers, powers / smallest, powers / largest, gap_power]))


def array_record(
    array: MicrolensArray,
    *,
    turn: Floats,
    origin: Floats,
    reach: float,
    margin: float,
    wavelengths: tuple[float, ...] = (),
) -> ArrayRecord:
    """Compile an array whose axes are rotated by `turn` (2, 2) and whose centre lies at `origin` (2,).

    Lenses up to `reach` from the origin of the axes are included. `margin` is the largest lateral displacement of rays
    between the principal plane and the curved side, by which openings are widened for sampling. `wavelengths` are the
    camera's and those sampled by paths, in nm.
    """
    opening, refraction, clear = array.opening, array.model.refraction, has_clear_gaps(array.aperture)
    parts = [opening.corners, array.cell_corners] if clear else [opening.corners]
    basis, cell = array.basis @ turn.T, polygon_edges(array.cell_corners @ turn.T)
    several = len(set(array.focal_lengths)) > 1 and array.lattice is not Lattice.FREE
    lens_table = None
    powers = 1.0 / np.asarray(array.focal_lengths)
    if array.lattice is Lattice.FREE or array.imperfections is not None:
        lens_table = lens_table_record(array, turn=turn, origin=origin, reach=reach, margin=margin)
        lens_powers = lens_table.lenses["power"] if len(lens_table.lenses) else powers
        powers = np.unique([lens_powers.min(), lens_powers.max()])
    is_tested = array.aperture is not None and (
        math.isfinite(opening.radius)
        or (refraction.is_plate and (array.aperture.fill_factor < 1 or lens_table is not None))
    )
    return ArrayRecord(
        LatticeRecord(
            origin=origin,
            basis=basis,
            inverse=np.asarray(np.linalg.inv(basis), dtype=np.float64),
            powers=np.append(powers, 0.0) if clear else powers,
            pattern=np.ascontiguousarray(array.type_pattern) if several and lens_table is None else None,
            extent=None if array.extent is None else np.vstack([array.basis, array.half_extent]),
        ),
        cell,
        OpeningRecord(
            corners=_pad([_widen(part, margin) @ turn.T for part in parts]),
            radius=array.cell_radius + margin,
            edges=np.column_stack([opening.edges[:, :2] @ turn.T, opening.edges[:, 2]]),
            radius2=opening.radius**2,
            clip=1.0 if is_tested else 0.0,
            clear=clear,
            fills=array.aperture is None,
        ),
        lens_table,
        cell if array.walls is Walls.OPAQUE else None,
        refraction.record(array, wavelengths),
        _power_factors(array, wavelengths) if refraction.is_thin else None,
    )


def lone_lens(array: MicrolensArray, power: float, wavelength: float) -> ArrayRecord:
    """A lens of the array's model and another power, about the origin, of infinite extent."""
    no_edges, no_corners = np.zeros((0, 3)), np.zeros((0, 0, 2))
    opening = OpeningRecord(no_corners, math.inf, no_edges, math.inf, clip=0.0, clear=False, fills=True)
    lattice = LatticeRecord(np.zeros(2), np.eye(2), np.eye(2), np.array([power]), None)
    return ArrayRecord(
        lattice, no_edges, opening, None, None, array.model.refraction.record(array, (wavelength,)), None
    )


def _power_factors(array: MicrolensArray, wavelengths: tuple[float, ...]) -> Floats | None:
    factors = np.array([array.power_factor(wavelength) for wavelength in wavelengths])
    return factors if (factors != 1.0).any() else None


def _widen(corners: Floats, margin: float) -> Floats:
    apothem = float(polygon_edges(corners)[:, 2].min())
    return np.asarray(corners * (1.0 + margin / apothem))


def _pad(parts: list[Floats]) -> Floats:
    """Polygons as one array; the last corner of shorter ones is repeated."""
    max_corners = max(map(len, parts))
    return np.stack([np.concatenate([part, np.repeat(part[-1:], max_corners - len(part), axis=0)]) for part in parts])


class Outlines(NamedTuple):
    """Cells and openings of listed lenses about their design centres: corners (n, k, 2), and how many are valid."""

    bins: BinsRecord
    cells: Floats
    cell_counts: NDArray[np.int64]
    wide: Floats
    """The cells, widened by a margin."""
    wide_counts: NDArray[np.int64]
    openings: Floats
    """Openings, displaced and widened, clipped by the widened cells."""
    counts: NDArray[np.int64]


def outlines(array: MicrolensArray, points: Floats, shifts: Floats, *, turn: Floats, margin: float) -> Outlines:
    """Outlines of the lenses with design centres at points (n, 2) and openings displaced by shifts (n, 2).

    For a FREE lattice the points must be complete, since each lens limits the cells of its neighbours.
    """
    from plenoptic.optics.microlens.kernels.lens_table import fill_bins, fill_cells, fill_openings

    bins = _grid(points, array)
    fill_bins(bins, points)
    base = np.asarray(array.cell_corners) @ turn.T
    opening = _widen(array.opening.corners, margin) @ turn.T
    if array.aperture is None:
        opening = 4.0 * base  # only the cell limits the lens
    cell_counts, wide_counts, counts = np.empty((3, len(points)), np.int64)
    # A lens limits cells at up to twice the cell's radius.
    widest = float(np.hypot(*base.T).max())
    room, neighbours = 12, bins if array.lattice is Lattice.FREE else None
    while True:
        cells, wide, corners = np.zeros((3, len(points), room, 2))
        max_corners = max(
            fill_cells(cells, cell_counts, points, base, 0.0, 2.0 * widest, neighbours),
            fill_cells(wide, wide_counts, points, base, margin, 2.0 * (widest + margin), neighbours),
        )
        if max_corners <= min(room, MAX_SIDES):
            max_corners = fill_openings(corners, counts, wide, wide_counts, opening, shifts)
        if max_corners > MAX_SIDES:
            raise InvalidValueError(
                f"a cell of the FREE lattice has {max_corners} sides or more, and the limit is {MAX_SIDES}; spread its "
                "neighbours, which stand around it in a circle"
            )
        if max_corners <= room:
            return Outlines(bins, cells, cell_counts, wide, wide_counts, corners, counts)
        room = max_corners


def lens_table_record(array: MicrolensArray, *, turn: Floats, origin: Floats, reach: float, margin: float) -> LensTable:
    """Lens table of the lenses up to `reach` from the origin of the axes; dark ones have no corners."""
    radius = reach + float(np.hypot(*origin)) + array.cell_radius
    n_lenses = 4.0 * float(np.minimum(radius, array.half_extent).prod()) / array.cell_area
    if array.lattice is not Lattice.FREE and n_lenses > MAX_LISTED:
        raise InvalidValueError(
            f"some {n_lenses:.3g} microlenses have imperfections, and the limit is {MAX_LISTED}; list deviations of "
            "single lenses, or increase the pitch"
        )
    lenslets = array.lenses((-radius, -radius), (radius, radius))
    points = np.ascontiguousarray(lenslets.design @ turn.T + origin)
    shifts = np.ascontiguousarray((lenslets.centre - lenslets.design) @ turn.T)
    bins, cells, cell_counts, wide, wide_counts, corners, counts = outlines(
        array, points, shifts, turn=turn, margin=margin
    )
    lenses = np.empty(len(points), MICROLENS)
    lenses["power"], lenses["transmission"] = lenslets.power, lenslets.transmission
    lenses["centre_x"], lenses["centre_y"] = (lenslets.centre @ turn.T + origin).T
    lenses["cell_x"], lenses["cell_y"] = points.T
    lenses["clip"], lenses["row"] = 0.0, np.arange(len(points))
    lenses["axis_x"], lenses["axis_y"] = (lenslets.axis @ turn.T + origin).T
    counts[lenslets.transmission == 0] = 0
    clear = has_clear_gaps(array.aperture)
    return LensTable(
        bins=bins,
        offset=float(np.hypot(*(lenslets.axis - lenslets.design).T).max(initial=0.0)),
        lenses=lenses,
        corners=np.stack([corners, wide] if clear else [corners], axis=1),
        counts=np.stack([counts, wide_counts] if clear else [counts], axis=1),
        cells=_cell_edges(cells, cell_counts) if array.lattice is Lattice.FREE else None,
    )


def _grid(points: Floats, array: MicrolensArray) -> BinsRecord:
    """A grid of empty bins, each for some lenses."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    width = max(2.0 * min(array.pitches), math.sqrt(4.0 * float((high - low).prod()) / max(len(points), 1)))
    rows, columns = (np.floor((high - low) / width) + 1).astype(int).tolist()
    first, members = np.zeros(rows * columns + 1, np.int64), np.empty(len(points), np.int64)
    return BinsRecord(float(low[0]), float(low[1]), width, rows, columns, first, members)


def _cell_edges(cells: Floats, counts: NDArray[np.int64]) -> Floats:
    """(n, k, 3) edges of polygons (n, k, 2) of which the first `counts` corners are valid; other edges clip nothing."""
    max_corners = cells.shape[1]
    number = np.arange(max_corners)
    following = np.where(number[None] + 1 < counts[:, None], number[None] + 1, 0)
    along = np.take_along_axis(cells, following[..., None], axis=1) - cells
    length = np.hypot(along[..., 0], along[..., 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        nx, ny = along[..., 1] / length, -along[..., 0] / length
    edges = np.stack([nx, ny, nx * cells[..., 0] + ny * cells[..., 1]], axis=-1)
    # Corners that coincide but for rounding have no edge between them: its direction would be noise.
    short = length <= 1e-9 * np.abs(cells).max(axis=(1, 2), initial=0.0)[:, None]
    edges[(number[None] >= counts[:, None]) | short] = (0.0, 0.0, 1.0)
    return edges
