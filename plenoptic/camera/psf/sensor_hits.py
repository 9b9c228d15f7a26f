"""Forward tracing from points to the sensor: the stages that rays pass, and the tasks into which they are divided.

Dust, the openings of pixels and their angular response are included in records of `radiometric_record`; the stages are
then those of the renderer, in the opposite order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import assembly
from plenoptic.camera.camera_record import response_record
from plenoptic.camera.diffraction import IrisRecord, deflection_record, iris_record
from plenoptic.camera.dust import BETWEEN, PlacedDust, fill_dust_at_lens, placed_dust
from plenoptic.camera.psf.forward_array import ForwardArray, fill_through_array_forward, forward_array
from plenoptic.camera.sampling.through_array import fill_losses_before_array
from plenoptic.camera.units import metres_hint
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.diffraction.far_field import FarField
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.entrance_pupil import Entrance, entering_polygon, entrance
from plenoptic.optics.lens.record import LensRecord, lens_record
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.microlens_record import ResponseRecord

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

BUNDLE = 1 << 13
"""Rays that go through the stages together."""
CHUNK = 1 << 17
"""Rays of a point and replicate in one task; they take some 7 MB."""


HIT = np.dtype(
    [("x", "f8"), ("y", "f8"), ("weight", "f8"), ("first", "i8"), ("second", "i8"), ("row", "i8"), ("column", "i8")],
    align=True,
)
"""Ray that reaches the sensor: intersection in mm, weight, lattice indices of its microlens, and pixel."""


class SensorDeflection(NamedTuple):
    """Diffraction deflection between array and sensor, for forward tracing."""

    field: FarField
    distance: float
    """From the array's rear principal plane to the sensor's centre along the local axis, in mm."""
    tilt: Floats
    """(2,): slope of the distance along x and y on the sensor."""
    to_sensor_axes: Floats
    """(2, 2): from spatial frequencies to x and y on the sensor, per mm of distance."""


class ForwardRecord(NamedTuple):
    """Record of a camera for forward tracing."""

    camera: PlenopticCamera
    lens: LensRecord
    ideal: bool
    """True if the main lens is ideal."""
    facing: Floats | None
    """(3,): the camera's axis, the normal of emitters, in the lens's axes; None if it is the lens's axis."""
    entrance: Entrance
    array: ForwardArray
    opening: Floats | None = None
    """(2,): half height and half width of a pixel's sensitive area, over the pitch; None: the whole pixel."""
    response: ResponseRecord | None = None
    dust: tuple[PlacedDust, ...] = ()
    deflection: SensorDeflection | None = None
    iris: IrisRecord | None = None

    @property
    def has_losses_before_array(self) -> bool:
        """True if dust or the pixels' angular response attenuate light between array and sensor."""
        return self.response is not None or any(part.site in BETWEEN for part in self.dust)


class Task(NamedTuple):
    """Rays first ... first + n - 1 of a replicate of a point, aimed at a polygon of the entrance plane."""

    point: Floats
    polygon: Floats
    """(2, k): corners, counter-clockwise."""
    number: int
    replicate: int
    first: int
    n: int


class LandedRays(NamedTuple):
    """Rays of a task that reach the sensor, (n,) of HIT; number of rays by status, and beside sensor and openings."""

    rows: NDArray[np.void]
    counts: NDArray[np.int64]
    beside_sensor: int
    beside_opening: int


def forward_record(camera: PlenopticCamera) -> ForwardRecord:
    """Compile a camera for forward tracing, without dust, diffraction and the response of pixels."""
    lens, parts = camera.lens, assembly(camera)
    lens_pose = parts.lens_to_camera
    return ForwardRecord(
        camera,
        lens_record(lens, camera.wavelength, reverse=False),
        lens.model in (LensModel.THIN, LensModel.PARAXIAL),
        None if lens_pose is None or lens_pose.turn[2, 2] == 1.0 else lens_pose.turn[2].copy(),
        entrance(lens, camera.wavelength),
        forward_array(camera, parts),
    )


def radiometric_record(camera: PlenopticCamera) -> ForwardRecord:
    """Compile a camera for forward tracing with the losses of `render`: dust, openings and response of pixels."""
    record, sensor = forward_record(camera), camera.sensor
    parts = record.array.parts
    return record._replace(
        opening=None if sensor.fill_factor == 1 else 0.5 * np.array(sensor.pixel_aperture[::-1]),
        response=response_record(camera, parts),
        dust=placed_dust(camera, parts),
    )


def diffraction_record(camera: PlenopticCamera) -> ForwardRecord:
    """Compile a camera for forward tracing with losses and, if enabled, diffraction at iris and microlenses."""
    record = radiometric_record(camera)._replace(iris=iris_record(camera, (camera.wavelength,)))
    parts = record.array.parts
    diffraction_at_array = deflection_record(camera, parts, (camera.wavelength,))
    if diffraction_at_array is None:
        return record
    if diffraction_at_array.field.opening is not None:
        raise InvalidValueError(
            "light diffracts differently at the openings of microlenses and at the gaps between them, and points are "
            "not traced forwards through both: render the point, or take diffraction=None"
        )
    turn, tilt = parts.sensor_to_local.turn[:2, :2], np.zeros(2) if parts.tilt is None else parts.tilt
    distance = parts.distance + float(tilt @ parts.sensor_to_local.shift[:2])
    to_sensor_axes = float(diffraction_at_array.wavelengths[0]) * np.linalg.inv(turn)
    deflection = SensorDeflection(
        diffraction_at_array.field, distance, turn.T @ tilt, np.ascontiguousarray(to_sensor_axes)
    )
    return record._replace(deflection=deflection)


def _fill_losses_behind_array(blocks: Floats, aims: Floats, record: ForwardRecord) -> None:
    """Attenuate rays at the sensor as the renderer attenuates samples before the array; `aims` is a workspace."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
    from plenoptic.optics.microlens.kernels.to_sensor import fill_aims

    parts, sensor = record.array.parts, record.array.sensor._replace(axes=None)
    placement = None
    if record.array.sensor.axes is not None:
        placement = np.column_stack([parts.sensor_to_local.turn[:2, :2], parts.sensor_to_local.shift[:2]])
    fill_aims(aims, blocks, sensor, placement)
    fill_losses_before_array(aims, sensor, record.response, record.dust)
    weights = np.s_[:, WEIGHT : WEIGHT + BLOCK]
    blocks.reshape(-1, RAY)[weights] = aims.reshape(-1, RAY)[weights]


def in_lens_axes(record: ForwardRecord, points: Floats) -> Floats:
    """Transform world points to the lens's axes; raise an InvalidValueError if one is not in front of the lens."""
    pose, lens_pose = record.camera.pose, record.array.parts.lens_to_camera
    in_lens = points if pose is None else pose.to_camera(points)
    in_lens = in_lens if lens_pose is None else lens_pose.inverse().points(in_lens)
    behind = np.flatnonzero(~(in_lens[:, 2] < record.entrance.z))
    if len(behind):
        z, limit = float(in_lens[behind[0], 2]), record.entrance.z
        raise InvalidValueError(
            f"point {behind[0]} lies at z = {z:g} mm of the lens's axes, and the lens begins at z = {limit:g} mm; "
            f"points must lie in front of it, at smaller z{metres_hint(z, limit)}"
        )
    return in_lens


def ray_tasks(record: ForwardRecord, points: Floats, replicates: int, rays_per_replicate: int) -> list[Task]:
    """Tasks for points (n, 3) in the lens's axes, in the order of points, replicates and rays.

    Points outside the field have no tasks.
    """
    tasks = []
    for number, point in enumerate(points):
        corners = entering_polygon(record.entrance, point)
        if corners is None:
            continue
        polygon = np.ascontiguousarray(corners.T)
        tasks += [
            Task(point, polygon, number, replicate, first, min(CHUNK, rays_per_replicate - first))
            for replicate in range(replicates)
            for first in range(0, rays_per_replicate, CHUNK)
        ]
    return tasks


def trace_task(record: ForwardRecord, task: Task, seed: np.uint64) -> LandedRays:
    """Trace one task through all stages: a pure function of its arguments."""
    from plenoptic.camera.psf.kernels import source_rays
    from plenoptic.core.kernels.bundles import fill_status_counts
    from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, RAY
    from plenoptic.optics.lens.kernels.trace import fill_traced
    from plenoptic.optics.microlens.kernels import to_sensor

    sensor, dust = record.camera.sensor, record.dust
    rows = np.empty(task.n, HIT)
    counts = np.zeros(CAUSES * (len(record.camera.lens.elements) + 1), dtype=np.int64)
    blocks = np.empty(-(-min(BUNDLE, task.n) // BLOCK) * RAY)
    aims = np.empty(blocks.size if record.has_losses_before_array else 0)
    n_landed = n_beside_sensor = n_beside_opening = 0
    for start in range(0, task.n, BUNDLE):
        n = min(BUNDLE, task.n - start)
        bundle = blocks[: -(-n // BLOCK) * RAY]
        source_rays.fill_source_rays(bundle, start, n, seed, task, record.entrance.z, record.ideal, record.facing)
        if record.iris is not None:
            source_rays.fill_iris_deflections(bundle, start, n, seed, task, record.iris)
        fill_dust_at_lens(bundle, dust, BlemishSite.LENS_FRONT)
        fill_traced(bundle, record.lens, None)
        if record.ideal:
            to_sensor.fill_ideal_weights(bundle)
        fill_dust_at_lens(bundle, dust, BlemishSite.LENS_REAR)
        fill_through_array_forward(bundle, record.array)
        if record.has_losses_before_array:
            _fill_losses_behind_array(bundle, aims[: bundle.size], record)
        if record.deflection is not None:
            source_rays.fill_deflections(bundle, start, n, seed, task, record.deflection)
        fill_status_counts(counts, bundle, n)
        landed, beside_sensor, beside_opening = source_rays.fill_landed(
            rows[n_landed:], bundle, n, *sensor.shape, sensor.pixel_pitch, record.opening
        )
        n_landed, n_beside_sensor = n_landed + landed, n_beside_sensor + beside_sensor
        n_beside_opening += beside_opening
    return LandedRays(rows[:n_landed], counts, n_beside_sensor, n_beside_opening)
