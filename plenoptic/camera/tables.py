"""A camera as the numbers that the kernels between sensor and scene read, and the stages it needs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.strays import fill_plates, strays
from plenoptic.optics.microlenses import MicrolensArray, MicrolensModel
from plenoptic.optics.pupil import PupilBounds, pupil_bounds, rear_reach
from plenoptic.optics.tables import LensTables, lens_tables


class CellTables(NamedTuple):
    """What the microlenses add to `CameraTables`."""

    basis: NDArray[np.float64]
    inverse: NDArray[np.float64]
    corners: NDArray[np.float64]
    """Corners of a cell, widened by how far rays stray between the principal plane and the curved side."""
    edges: NDArray[np.float64]
    bend: float
    """How far a ray moves on the plane of the outlines when its point in the cell moves by 1."""
    slack: float
    """How far a real microlens's rays stray there from an ideal one's, in mm."""


class CameraTables(NamedTuple):
    """Numbers only; lengths in mm in the camera's frame."""

    rows: int
    columns: int
    pitch: float
    distance: float
    """From the sensor to the plane on which its samples are aimed."""
    z_plane: float
    """Where rays start towards the lens: the front principal plane, or the last lens vertex."""
    ratio: float
    """Distance from the array to the plane of the outlines over that from the array to the sensor."""
    bounds: PupilBounds
    lens: LensTables
    cells: CellTables | None
    """None without microlenses."""
    array: MicrolensArray | None
    rotation: NDArray[np.float64] | None
    """Camera to world; None where the world is the camera's frame."""
    position: NDArray[np.float64] | None
    elements: int
    """Lens elements, for counting lost rays."""


def camera_tables(camera: PlenopticCamera) -> CameraTables:
    """Compile a camera: tables for the kernels, with bounds on the exit pupil found by tracing."""
    lens = camera.lens
    array = camera.microlenses
    z_last = float(lens.vertices[-1])
    reverse = lens_tables(lens, camera.wavelength, reverse=True)
    corner = camera.sensor.half_diagonal
    if array is None:
        distance, z_plane, ratio = camera.z_sensor - z_last, z_last, 0.0
        half_pixel = camera.sensor.pixel_pitch / math.sqrt(2)
        bounds = pupil_bounds(
            lens,
            z_plane=camera.z_sensor,
            largest_radius=corner,
            cell_radius=half_pixel,
            wavelength=camera.wavelength,
        )
        cells = None
    else:
        distance, z_plane = camera.microlenses_to_sensor, camera.stop_to_microlenses
        ratio = (z_plane - z_last) / distance
        bend = 1.0 + (z_plane - z_last) * (1.0 / distance - 1.0 / array.focal_length)
        if array.model is MicrolensModel.PINHOLE:
            bend = 0.0
        bounds, slack, stray = _cell_bounds(camera, array, ratio, bend)
        cells = CellTables(
            basis=array.basis,
            inverse=np.asarray(np.linalg.inv(array.basis), dtype=np.float64),
            corners=array.cell_corners * (1.0 + stray / (array.pitch / 2)),
            edges=array.cell_edges,
            bend=bend,
            slack=slack,
        )
    return CameraTables(
        rows=camera.sensor.shape[0],
        columns=camera.sensor.shape[1],
        pitch=camera.sensor.pixel_pitch,
        distance=distance,
        z_plane=z_plane,
        ratio=ratio,
        bounds=bounds,
        lens=reverse,
        cells=cells,
        array=array,
        rotation=None if camera.pose is None else camera.pose.rotation,
        position=None if camera.pose is None else camera.pose.position,
        elements=len(lens.elements),
    )


def fill_through_array(blocks: NDArray[np.float64], tables: CameraTables) -> None:
    """Aimed samples (see `_lattice`) become rays on their way to the lens."""
    from plenoptic.optics import _lattice

    array = tables.array
    if array is None or tables.cells is None:
        _lattice.fill_straight(blocks, tables.distance, tables.z_plane)
    elif array.model is MicrolensModel.PINHOLE:
        _lattice.fill_pinholes(blocks, tables.distance, tables.z_plane)
    elif array.model is MicrolensModel.THIN:
        _lattice.fill_thin(blocks, tables.distance, 1.0 / array.focal_length, tables.z_plane)
    else:
        fill_plates(blocks, array, tables.distance, tables.z_plane, tables.cells.edges)


def _cell_bounds(
    camera: PlenopticCamera, array: MicrolensArray, ratio: float, bend: float
) -> tuple[PupilBounds, float, float]:
    """Outlines of the pupil for all cells that matter, and how far the rays of real microlenses stray.

    A ray from the sensor at s crosses the plane of the outlines at c + ratio (c - s) + bend d, to within the slack,
    and passes the lens no farther from the axis than a + b |c| there.
    """
    a, b = rear_reach(camera.lens, camera.stop_to_microlenses, camera.wavelength)
    slack = stray = 0.0
    rounds = 2 if array.is_plate else 1
    while True:
        farthest = ratio * camera.sensor.half_diagonal + a + abs(bend) * array.cell_radius + slack
        widest = 1.02 * farthest / max(1.0 + ratio - b, 0.1 * (1.0 + ratio)) + array.cell_radius + stray
        bounds = pupil_bounds(
            camera.lens,
            z_plane=camera.stop_to_microlenses,
            largest_radius=widest,
            cell_radius=array.cell_radius + stray,
            wavelength=camera.wavelength,
        )
        rounds -= 1
        if rounds == 0:
            return bounds, slack, stray
        slack, stray = strays(camera, array, ratio, bend, float(bounds.reach.max()) + widest)
