"""From a point to the sensor: the stages that rays pass, one task after the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.entrance import Entrance, entering_polygon, entrance
from plenoptic.optics.microlenses import ConvexSide, MicrolensModel
from plenoptic.optics.models import LensModel
from plenoptic.optics.tables import LensTables, lens_tables

BUNDLE = 1 << 13
"""Rays that go through the stages together."""
CHUNK = 1 << 17
"""Rays of a point and replicate that one thread takes at a time; they take some 7 MB."""


class ForwardTables(NamedTuple):
    """A camera forwards, as numbers."""

    camera: PlenopticCamera
    lens: LensTables
    ideal: bool
    """Whether an ideal lens stands for the main lens."""
    entrance: Entrance
    inverse: NDArray[np.float64] | None
    """Of the lattice's basis; None without microlenses."""


class Task(NamedTuple):
    """Rays first ... first + n - 1 of a replicate of a point, which enter the lens through `triangles`."""

    point: NDArray[np.float64]
    triangles: NDArray[np.float64]
    number: int
    replicate: int
    first: int
    n: int


class Landed(NamedTuple):
    """Rows of the rays that land (see `_forward.LANDED`), rays by status code, and rays beside the sensor."""

    rows: NDArray[np.float64]
    counts: NDArray[np.int64]
    beside: int


def forward_tables(camera: PlenopticCamera) -> ForwardTables:
    """Compile a camera for light that travels forwards."""
    lens = camera.lens
    return ForwardTables(
        camera,
        lens_tables(lens, camera.wavelength, reverse=False),
        lens.model in (LensModel.THIN, LensModel.PARAXIAL),
        entrance(lens, camera.wavelength),
        None if camera.microlenses is None else np.asarray(np.linalg.inv(camera.microlenses.basis), dtype=np.float64),
    )


def tasks_of(tables: ForwardTables, points: NDArray[np.float64], replicates: int, each: int) -> list[Task]:
    """All there is to trace from points (n, 3) of the camera's frame, in the order of points, replicates and rays.

    Points out of sight have no tasks.
    """
    tasks = []
    for number, point in enumerate(points):
        corners = entering_polygon(tables.entrance, point)
        if corners is None:
            continue
        triangles = _fan(corners)
        tasks += [
            Task(point, triangles, number, replicate, first, min(CHUNK, each - first))
            for replicate in range(replicates)
            for first in range(0, each, CHUNK)
        ]
    return tasks


def _fan(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """A convex polygon (counter-clockwise) as triangles, in the form that `_sample.aim` reads."""
    edges = corners[1:] - corners[0]
    areas = 0.5 * (edges[:-1, 0] * edges[1:, 1] - edges[:-1, 1] * edges[1:, 0])
    kept = areas > 1e-12 * areas.sum()
    triangles = np.zeros((int(kept.sum()), 9))
    triangles[:, :2] = corners[0]
    triangles[:, 2:4], triangles[:, 4:6] = edges[:-1][kept], edges[1:][kept]
    triangles[:, 6] = np.cumsum(areas[kept])
    return triangles


def landed(tables: ForwardTables, task: Task, seed: np.uint64) -> Landed:
    """One task through all stages: a pure function of its arguments."""
    from plenoptic.camera import _forward
    from plenoptic.camera._sample import fill_status_counts
    from plenoptic.optics._blocks import BLOCK, CAUSES, RAY
    from plenoptic.optics._trace import fill_traced

    sensor = tables.camera.sensor
    rows = np.empty((task.n, _forward.LANDED))
    counts = np.zeros(CAUSES * (len(tables.camera.lens.elements) + 1), dtype=np.int64)
    blocks = np.empty(-(-min(BUNDLE, task.n) // BLOCK) * RAY)
    arrived = beside = 0
    for start in range(0, task.n, BUNDLE):
        n = min(BUNDLE, task.n - start)
        bundle = blocks[: -(-n // BLOCK) * RAY]
        first, z = task.first + start, tables.entrance.z
        _forward.fill_source_rays(
            bundle, first, n, seed, task.number, task.replicate, task.triangles, task.point, z, tables.ideal
        )
        fill_traced(bundle, *tables.lens)
        _fill_through_array(bundle, tables)
        fill_status_counts(counts, bundle, n)
        found, missed = _forward.fill_landed(rows[arrived:], bundle, n, *sensor.shape, sensor.pixel_pitch)
        arrived, beside = arrived + found, beside + missed
    return Landed(rows[:arrived], counts, beside)


def _fill_through_array(blocks: NDArray[np.float64], tables: ForwardTables) -> None:
    """Rays behind the lens become points on the sensor; see `_lattice_forward`."""
    from plenoptic.optics import _lattice_forward

    camera, array = tables.camera, tables.camera.microlenses
    if tables.ideal:
        _lattice_forward.fill_ideal_weights(blocks)
    if array is None:
        _lattice_forward.fill_straight_forward(blocks, camera.z_sensor)
        return
    basis, inverse = array.basis, tables.inverse
    z_array, distance = camera.stop_to_microlenses, camera.microlenses_to_sensor
    if array.model is MicrolensModel.THIN:
        _lattice_forward.fill_thin_forward(blocks, z_array, distance, 1.0 / array.focal_length, basis, inverse)
        return
    curved_first = array.convex_side is ConvexSide.SCENE
    z_front = z_array - (0.0 if curved_first else array.thickness / array.index)
    _lattice_forward.fill_plano_convex_forward(
        blocks,
        z_front,
        curved_first,
        array.model is MicrolensModel.FLAT_HIGH_INDEX,
        (1.0 if curved_first else -1.0) / array.radius,
        array.thickness,
        array.index,
        camera.z_sensor - z_front,
        basis,
        inverse,
        array.cell_edges,
    )
