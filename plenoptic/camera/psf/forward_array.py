"""From behind the main lens to the sensor, for light that travels forwards: the array and the sensor as numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly, sensor_corners
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.optics.lens.pupil.exit_pupil import rear_reach
from plenoptic.optics.microlens.aperture import Gaps
from plenoptic.optics.microlens.array import ConvexSide, MicrolensArray, MicrolensModel
from plenoptic.optics.microlens.imperfections import MicrolensImperfections, largest_offset
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.record import ArrayTables, array_tables

_GENEROUS = 1.25
"""How much farther from the axis lenses are listed than thin lenses need it."""


class ForwardArray(NamedTuple):
    """Lengths in mm, in the axes in which the array is traced (see `Assembly`)."""

    parts: Assembly
    array: MicrolensArray | None
    cells: ArrayTables | None
    lattice: tuple[object, ...] | None
    """Arguments of `cell_lookup.own_lens` after x and y; None where all lenses are equal and fill their cells."""
    edges: NDArray[np.float64] | None
    """(k, 3) edges of the openings; None where the cells alone end the lenses."""
    sensor: NDArray[np.float64] | None
    """(2, 3): from x, y, 1 to the sensor's own axes; None where they are the same."""


def forward_array(camera: PlenopticCamera, parts: Assembly) -> ForwardArray:
    """Compile what lies behind the lens for light that travels forwards."""
    array, sensor = camera.microlenses, _to_sensor(parts)
    if array is None:
        return ForwardArray(parts, None, None, None, None, sensor)
    reach = 0.0 if array.lattice is not Lattice.FREE and array.imperfections is None else _reach(camera, parts, array)
    cells = array_tables(array, turn=parts.array_turn, origin=parts.array_origin, reach=reach, stray=0.0)
    edges = None if array.aperture is None else cells.opening
    plain = edges is None and cells.pattern is None and cells.listed is None and not cells.walls
    return ForwardArray(parts, array, cells, None if plain else _lattice(array, cells), edges, sensor)


def _to_sensor(parts: Assembly) -> NDArray[np.float64] | None:
    """From points x, y, 1 of the sensor in local axes to its own; None where they are the same."""
    turn, shift = parts.sensor_to_local.turn[:2, :2], parts.sensor_to_local.shift[:2]
    if np.array_equal(turn, np.eye(2)) and not shift.any():
        return None
    back = np.linalg.inv(turn)
    return np.column_stack([back, -back @ shift])


def _reach(camera: PlenopticCamera, parts: Assembly, array: MicrolensArray) -> float:
    """How far from the origin light can pass the array and still land on the sensor, generously, in mm.

    A ray comes from within a + b rho of the axis, `gap` in front of the array, and bends by at most the strongest power
    times the largest height in a cell. All FREE lenses are listed.
    """
    a, b = rear_reach(camera.lens, parts.z_plane, camera.wavelength)
    z_last = float(camera.lens.vertices[-1])
    last = np.array([0.0, 0.0, z_last - parts.z_plane])
    if parts.frame is not None:
        last = parts.frame[:9].reshape(3, 3).T @ (np.array([0.0, 0.0, z_last]) - parts.frame[9:])
    corners = sensor_corners(camera, parts)
    distance, gap = float(corners[:, 2].max()), -float(last[2])
    height, power = array.cell_radius, max(1.0 / abs(f) for f in array.focal_lengths)
    if array.imperfections is not None:
        height += largest_offset(array.imperfections)
        power /= _least_factor(array)
    aside = float(np.hypot(*corners[:, :2].T).max()) + distance * (
        (a + float(np.hypot(*last[:2]))) / gap + height * power
    )
    reach = _GENEROUS * aside / max(1.0 + distance * (1.0 - b) / gap, 0.1) + 2.0 * array.cell_radius
    if array.centres is not None:
        reach = max(reach, 1.01 * float(np.abs(array.centres).max()))
    return reach


def _least_factor(array: MicrolensArray) -> float:
    """The shortest focal length of a lens over that of its design, at least a tenth."""
    found = array.imperfections
    if isinstance(found, MicrolensImperfections):
        least = 1.0 - 4.0 * found.focal_length_spread
    else:
        factors = None if found is None else found.focal_length_factor
        least = 1.0 if factors is None or not len(factors) else float(factors.min())
    return min(max(least, 0.1), 1.0)


def _lattice(array: MicrolensArray, cells: ArrayTables) -> tuple[object, ...]:
    """How the lens of a point is found; see `optics.microlens.kernels.cell_lookup.own_lens`."""
    base = (cells.origin, cells.basis, cells.inverse, cells.powers, cells.pattern)
    listed = cells.listed
    if listed is None:
        return (*base, None, None, 0.0, None, None, None, None)
    if array.lattice is Lattice.FREE:
        reach = float(np.hypot(*array.pitches))
        return (*base, None, None, reach, listed.bins, listed.bin_first, listed.members, listed.lenses)
    index = np.rint((listed.lenses[:, 3:5] - cells.origin) @ cells.inverse).astype(np.int64)
    corner = index.min(axis=0)
    rows = np.full(index.max(axis=0) - corner + 1, -1, dtype=np.int64)
    rows[tuple((index - corner).T)] = np.arange(len(index))
    return (*base, corner, rows, 0.0, None, None, None, listed.lenses)


def fill_through_array_forward(blocks: NDArray[np.float64], made: ForwardArray) -> None:
    """Rays behind the lens, in its axes, become points on the sensor; see `to_sensor`."""
    from plenoptic.optics.microlens.kernels import to_sensor

    parts, array, cells = made.parts, made.array, made.cells
    z = parts.z_plane
    if array is None or cells is None:
        to_sensor.fill_straight_forward(blocks, z + parts.distance, parts.lean, made.sensor)
        return
    if parts.frame is not None:
        to_sensor.fill_in_array_axes(blocks, parts.frame)
        z = 0.0
    equal = (float(cells.powers[0]), cells.origin, cells.basis, cells.inverse)
    clear = array.aperture is not None and array.aperture.gaps is Gaps.CLEAR
    listed = cells.listed
    different = (
        clear,
        made.edges,
        cells.radius2,
        None if listed is None else listed.cells,
        None if listed is None else listed.lenses,
        made.lattice,
        made.lattice if cells.walls else None,
    )
    if array.model is MicrolensModel.THIN:
        to_sensor.fill_thin_forward(blocks, z, parts.distance, parts.lean, made.sensor, *equal, *different)
        return
    curved_first = array.convex_side is ConvexSide.SCENE
    # The principal planes lie at the vertex of the curved side and thickness / index from it.
    inside = array.thickness / array.index
    to_sensor.fill_plano_convex_forward(
        blocks,
        z - (0.0 if curved_first else inside),
        parts.distance - (inside if curved_first else 0.0),
        parts.lean,
        made.sensor,
        curved_first,
        array.model is MicrolensModel.FLAT_HIGH_INDEX,
        array.thickness,
        array.index,
        cells.cell,
        *equal,
        *different,
    )
