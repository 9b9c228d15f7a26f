"""From a point to the sensor: the stages that rays pass, one task after the other.

Dust, the openings of pixels and their response to directions count where the record comes from `measuring_record`; the
stages are then those of the renderer, in the opposite order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.diffraction import IrisRecord, bend_record, iris_record
from plenoptic.camera.dust import BETWEEN, PlacedDust, fill_dimmed_at_lens, placed_dust
from plenoptic.camera.psf.forward_array import ForwardArray, fill_through_array_forward, forward_array
from plenoptic.camera.record import response_record
from plenoptic.camera.sampling.through_array import fill_dimmed_before_array
from plenoptic.camera.units import metres_guess
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.diffraction.far_field import FarField
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.entrance_pupil import Entrance, entering_polygon, entrance
from plenoptic.optics.lens.record import LensRecord, lens_record
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.microlens_record import ResponseRecord

BUNDLE = 1 << 13
"""Rays that go through the stages together."""
CHUNK = 1 << 17
"""Rays of a point and replicate that one thread takes at a time; they take some 7 MB."""


HIT = np.dtype(
    [("x", "f8"), ("y", "f8"), ("weight", "f8"), ("first", "i8"), ("second", "i8"), ("row", "i8"), ("column", "i8")],
    align=True,
)
"""A ray that arrives: where on the sensor in mm, its weight, the lattice index of its microlens, and its pixel."""


class Bends(NamedTuple):
    """Diffraction deflections on the way to the sensor."""

    field: FarField
    distance: float
    """From the array's rear principal plane to the sensor's centre along the local axis, in mm."""
    tilt: Floats
    """(2,): how it grows with x and y on the sensor."""
    by: Floats
    """(2, 2): from spatial frequencies to x and y on the sensor, for each mm of the distance."""


class ForwardRecord(NamedTuple):
    """A camera forwards, as numbers."""

    camera: PlenopticCamera
    lens: LensRecord
    ideal: bool
    """Whether an ideal lens stands for the main lens."""
    facing: Floats | None
    """(3,) the camera's axis, along which emitters face, in the lens's axes; None where it is the lens's."""
    entrance: Entrance
    array: ForwardArray
    opening: Floats | None = None
    """(2,) half the height and half the width of what is open of a pixel, over the pitch; None: all of it."""
    response: ResponseRecord | None = None
    dust: tuple[PlacedDust, ...] = ()
    bends: Bends | None = None
    iris: IrisRecord | None = None

    @property
    def dims_by_aim(self) -> bool:
        """True if something between array and sensor dims light."""
        return self.response is not None or any(part.site in BETWEEN for part in self.dust)


class Task(NamedTuple):
    """Rays first ... first + n - 1 of a replicate of a point, which enter the lens through a polygon."""

    point: Floats
    polygon: Floats
    """(2, k): corners, counter-clockwise."""
    number: int
    replicate: int
    first: int
    n: int


class Landed(NamedTuple):
    """Rows (n,) of HIT of the rays that land, rays by status code, those beside sensor and openings."""

    rows: NDArray[np.void]
    counts: NDArray[np.int64]
    beside: int
    shut: int


def forward_record(camera: PlenopticCamera) -> ForwardRecord:
    """Compile a camera for light that travels forwards, whatever its dust and its pixels make of it."""
    lens, parts = camera.lens, assembly(camera)
    placed = parts.lens_to_camera
    return ForwardRecord(
        camera,
        lens_record(lens, camera.wavelength, reverse=False),
        lens.model in (LensModel.THIN, LensModel.PARAXIAL),
        None if placed is None or placed.turn[2, 2] == 1.0 else placed.turn[2].copy(),
        entrance(lens, camera.wavelength),
        forward_array(camera, parts),
    )


def measuring_record(camera: PlenopticCamera) -> ForwardRecord:
    """Compile also the losses that `render` measures: dust, openings of pixels, their angular response."""
    record, sensor = forward_record(camera), camera.sensor
    parts = record.array.parts
    return record._replace(
        opening=None if sensor.fill_factor == 1 else 0.5 * np.array(sensor.pixel_aperture[::-1]),
        response=response_record(camera, parts),
        dust=placed_dust(camera, parts),
    )


def bending_record(camera: PlenopticCamera) -> ForwardRecord:
    """Compile also how light bends at iris and microlenses, where the camera has that."""
    record = measuring_record(camera)._replace(iris=iris_record(camera, (camera.wavelength,)))
    parts = record.array.parts
    bend = bend_record(camera, parts, (camera.wavelength,))
    if bend is None:
        return record
    if bend.field.opening is not None:
        raise InvalidValueError(
            "light bends in one way through the openings of microlenses and in another one beside them, and points are "
            "not traced forwards through both: render the point, or take diffraction=None"
        )
    turn, tilt = parts.sensor_to_local.turn[:2, :2], np.zeros(2) if parts.tilt is None else parts.tilt
    middle = parts.distance + float(tilt @ parts.sensor_to_local.shift[:2])
    by = float(bend.wavelengths[0]) * np.linalg.inv(turn)
    return record._replace(bends=Bends(bend.field, middle, turn.T @ tilt, np.ascontiguousarray(by)))


def _fill_dimmed_behind_array(blocks: Floats, aims: Floats, record: ForwardRecord) -> None:
    """Rays that have landed, dimmed as the renderer dims samples before the array; `aims` is room for them."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
    from plenoptic.optics.microlens.kernels.to_sensor import fill_aims

    parts, sensor = record.array.parts, record.array.sensor._replace(axes=None)
    placed = None
    if record.array.sensor.axes is not None:
        placed = np.column_stack([parts.sensor_to_local.turn[:2, :2], parts.sensor_to_local.shift[:2]])
    fill_aims(aims, blocks, sensor, placed)
    fill_dimmed_before_array(aims, sensor, record.response, record.dust)
    weights = np.s_[:, WEIGHT : WEIGHT + BLOCK]
    blocks.reshape(-1, RAY)[weights] = aims.reshape(-1, RAY)[weights]


def in_lens_axes(record: ForwardRecord, points: Floats) -> Floats:
    """World points in the lens's axes, or an error where one does not lie in front of the lens."""
    pose, placed = record.camera.pose, record.array.parts.lens_to_camera
    local = points if pose is None else pose.to_camera(points)
    local = local if placed is None else placed.inverse().points(local)
    behind = np.flatnonzero(~(local[:, 2] < record.entrance.z))
    if len(behind):
        z, limit = float(local[behind[0], 2]), record.entrance.z
        raise InvalidValueError(
            f"point {behind[0]} lies at z = {z:g} mm of the lens's axes, and the lens begins at z = {limit:g} mm; "
            f"points must lie in front of it, at smaller z{metres_guess(z, limit)}"
        )
    return local


def tasks_of(record: ForwardRecord, points: Floats, replicates: int, each: int) -> list[Task]:
    """All there is to trace from points (n, 3) in the lens's axes, in the order of points, replicates and rays.

    Points out of sight have no tasks.
    """
    tasks = []
    for number, point in enumerate(points):
        corners = entering_polygon(record.entrance, point)
        if corners is None:
            continue
        polygon = np.ascontiguousarray(corners.T)
        tasks += [
            Task(point, polygon, number, replicate, first, min(CHUNK, each - first))
            for replicate in range(replicates)
            for first in range(0, each, CHUNK)
        ]
    return tasks


def landed(record: ForwardRecord, task: Task, seed: np.uint64) -> Landed:
    """One task through all stages: a pure function of its arguments."""
    from plenoptic.camera.psf.kernels import source_rays
    from plenoptic.core.kernels.bundles import fill_status_counts
    from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, RAY
    from plenoptic.optics.lens.kernels.trace import fill_traced
    from plenoptic.optics.microlens.kernels import to_sensor

    sensor, dust = record.camera.sensor, record.dust
    rows = np.empty(task.n, HIT)
    counts = np.zeros(CAUSES * (len(record.camera.lens.elements) + 1), dtype=np.int64)
    blocks = np.empty(-(-min(BUNDLE, task.n) // BLOCK) * RAY)
    aims = np.empty(blocks.size if record.dims_by_aim else 0)
    arrived = missed_sensor = shut = 0
    for start in range(0, task.n, BUNDLE):
        n = min(BUNDLE, task.n - start)
        bundle = blocks[: -(-n // BLOCK) * RAY]
        source_rays.fill_source_rays(bundle, start, n, seed, task, record.entrance.z, record.ideal, record.facing)
        if record.iris is not None:
            source_rays.fill_bent_at_iris(bundle, start, n, seed, task, record.iris)
        fill_dimmed_at_lens(bundle, dust, BlemishSite.LENS_FRONT)
        fill_traced(bundle, record.lens, None)
        if record.ideal:
            to_sensor.fill_ideal_weights(bundle)
        fill_dimmed_at_lens(bundle, dust, BlemishSite.LENS_REAR)
        fill_through_array_forward(bundle, record.array)
        if record.dims_by_aim:
            _fill_dimmed_behind_array(bundle, aims[: bundle.size], record)
        if record.bends is not None:
            source_rays.fill_bent(bundle, start, n, seed, task, record.bends)
        fill_status_counts(counts, bundle, n)
        hits, missed, between = source_rays.fill_landed(
            rows[arrived:], bundle, n, *sensor.shape, sensor.pixel_pitch, record.opening
        )
        arrived, missed_sensor, shut = arrived + hits, missed_sensor + missed, shut + between
    return Landed(rows[:arrived], counts, missed_sensor, shut)
