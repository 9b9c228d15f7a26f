"""A camera as the numbers that the kernels between sensor and scene read, and the stages it needs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.optics.microlenses import ConvexSide, MicrolensArray, MicrolensModel
from plenoptic.optics.pupil import PupilBounds, pupil_bounds
from plenoptic.optics.tables import LensTables, lens_tables

_NO_EDGES = np.zeros((0, 3))
_SAFETY = 1.25
"""Margins found on a grid of rays are widened by this factor."""


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
        # Rays that pass the rear rim and end on the sensor's corner cross the array no farther out than this.
        rim = 1.2 * lens.elements[-1].semi_diameter
        bend = 1.0 + (z_plane - z_last) * (1.0 / distance - 1.0 / array.focal_length)
        widest = (ratio * corner + rim + abs(bend) * array.cell_radius) / (1.0 + ratio) + array.cell_radius
        bounds = pupil_bounds(
            lens,
            z_plane=z_plane,
            largest_radius=widest,
            cell_radius=array.cell_radius,
            wavelength=camera.wavelength,
        )
        slack, stray = _strays(array, distance, z_plane, z_last, ratio, bend, float(bounds.reach.max()), widest)
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
    elif array.model is MicrolensModel.THIN:
        _lattice.fill_thin(blocks, tables.distance, 1.0 / array.focal_length, tables.z_plane)
    else:
        _fill_spherical(blocks, array, tables.distance, tables.z_plane, tables.cells.edges)


def _fill_spherical(
    blocks: NDArray[np.float64], array: MicrolensArray, distance: float, z_plane: float, edges: NDArray[np.float64]
) -> None:
    from plenoptic.optics import _lattice

    curved_first = array.convex_side is ConvexSide.SENSOR
    curvature = (-1.0 if curved_first else 1.0) / array.radius
    _lattice.fill_plano_convex(blocks, distance, z_plane, curved_first, curvature, array.thickness, array.index, edges)


def _strays(
    array: MicrolensArray,
    distance: float,
    z_plane: float,
    z_last: float,
    ratio: float,
    bend: float,
    reach: float,
    widest: float,
) -> tuple[float, float]:
    """How far real rays stray from ideal ones on the plane of the outlines, and on the curved side.

    Found by tracing a grid of aims over a cell from a grid of sensor points that can see the pupil through it.
    """
    if array.model is MicrolensModel.THIN:
        return 0.0, 0.0
    from plenoptic.optics._trace import BLOCK

    offset = (reach + widest + abs(bend) * array.cell_radius) / ratio
    aims = np.linspace(-array.cell_radius, array.cell_radius, 13)
    points = np.linspace(-offset, offset, 13)
    dx, dy, sx, sy = (g.ravel() for g in np.meshgrid(aims, aims, points, points, indexing="ij"))
    fields = np.zeros((8, -(-dx.size // BLOCK) * BLOCK))
    for row, column in enumerate((dx, dy, None, dx - sx, dy - sy)):
        if column is not None:
            fields[row, : dx.size] = column
    blocks = np.ascontiguousarray(fields.reshape(8, -1, BLOCK).transpose(1, 0, 2))
    _fill_spherical(blocks.reshape(-1), array, distance, z_plane, _NO_EDGES)
    x, y, z, u, v, w, _, status = blocks.transpose(1, 0, 2).reshape(8, -1)[:, : dx.size]
    inside = (np.hypot(dx, dy) <= array.cell_radius) & (status == 0)
    ideal_x, ideal_y = -ratio * sx + bend * dx, -ratio * sy + bend * dy
    seen = inside & (np.hypot(ideal_x, ideal_y) <= reach + widest)
    if not seen.any():
        seen = inside
    t = (z_last - z) / w
    slack = float(np.hypot(x + t * u - ideal_x, y + t * v - ideal_y)[seen].max())
    if array.convex_side is ConvexSide.SCENE:
        stray = float(np.hypot(x - dx, y - dy)[seen].max())
    else:
        slope = float((np.hypot(dx - sx, dy - sy) / distance)[seen].max())
        sag = array.radius - math.sqrt(array.radius**2 - array.cell_radius**2)
        stray = slope * sag
    return _SAFETY * slack, _SAFETY * stray
