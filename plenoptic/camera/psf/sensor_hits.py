"""Forward tracing from points to the sensor: the stages that rays pass, and the tasks into which they are divided.

Dust, the openings of pixels and their angular response are included in records of `radiometric_record`; the stages are
then those of the renderer, in the opposite order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly, assembly, sensor_corners
from plenoptic.camera.camera_rays import fill_losses_before_array
from plenoptic.camera.camera_record import response_record
from plenoptic.camera.diffraction import IrisRecord, deflection_record, iris_record
from plenoptic.camera.dust import BETWEEN, PlacedDust, fill_dust_at_lens, placed_dust
from plenoptic.camera.ghosts.array_reflection import Detour, fill_detour
from plenoptic.camera.units import metres_hint
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.diffraction.far_field import FarField
from plenoptic.optics.lens.lens_record import LensRecord, radiometric_lens_record
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.entrance_pupil import Entrance, entrance, entrance_polygon, rim_polygons
from plenoptic.optics.lens.pupil.exit_pupil import rear_reach
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.forward_record import differs_forward
from plenoptic.optics.microlens.forward_record import forward_record as array_forward_record
from plenoptic.optics.microlens.imperfections import extreme_factors, largest_offset
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.microlens_record import ArrayRecord, ResponseRecord, SensorPlane, WellsRecord
from plenoptic.optics.microlens.model_records import ArrayCrossing
from plenoptic.optics.microlens.plate_losses import add_losses

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
_REACH_FACTOR = 1.25
"""Factor on the distance from the axis up to which microlenses are listed, for thick ones."""


def _to_sensor(parts: Assembly) -> Floats | None:
    """Matrix from points x, y, 1 of the sensor in local axes to its own; None if they are the same."""
    turn, shift = parts.sensor_to_local.turn[:2, :2], parts.sensor_to_local.shift[:2]
    if np.array_equal(turn, np.eye(2)) and not shift.any():
        return None
    back = np.linalg.inv(turn)
    return np.column_stack([back, -back @ shift])


def _reach(camera: PlenopticCamera, parts: Assembly, array: MicrolensArray) -> float:
    """Upper bound on the distance from the origin at which light that reaches the sensor passes the array, in mm.

    A ray comes from within a + b rho of the axis, `pupil_distance` in front of the array, and is deviated by at most
    the strongest power times the largest height in a cell. All FREE lenses are listed.
    """
    a, b = rear_reach(camera.lens, parts.z_plane, camera.wavelength)
    last = parts.local_to_lens.inverse().points(np.array([0.0, 0.0, float(camera.lens.vertices[-1])]))
    corners = sensor_corners(camera, parts)
    distance, pupil_distance = float(corners[:, 2].max()), -float(last[2])
    height = array.cell_radius + largest_offset(array.imperfections)
    power = max(1.0 / abs(f) for f in array.focal_lengths) / max(extreme_factors(array.imperfections)[0], 0.1)
    lateral = float(np.hypot(*corners[:, :2].T).max()) + distance * (
        (a + float(np.hypot(*last[:2]))) / pupil_distance + height * power
    )
    reach = _REACH_FACTOR * lateral / max(1.0 + distance * (1.0 - b) / pupil_distance, 0.1) + 2.0 * array.cell_radius
    if array.centres is not None:
        reach = max(reach, 1.01 * float(np.abs(array.centres).max()))
    return reach


def fill_through_array_forward(blocks: Floats, record: ForwardRecord) -> None:
    """Trace rays behind the lens, in its axes, to points on the sensor; see `to_sensor`."""
    from plenoptic.optics.microlens.kernels.to_sensor import fill_in_array_axes, fill_straight_forward

    parts, array, sensor, microlenses = record.parts, record.array, record.sensor, record.camera.microlenses
    z = parts.z_plane
    if array is None or microlenses is None:
        fill_straight_forward(blocks, sensor._replace(distance=z + parts.distance))
        return
    if parts.frame is not None:
        fill_in_array_axes(blocks, parts.frame)
        z = 0.0
    to_sensor = microlenses.model.refraction.to_sensor
    assert to_sensor is not None
    to_sensor(blocks, ArrayCrossing(array, sensor, z), differs_forward(array))


def fill_to_sensor(blocks: Floats, record: ForwardRecord) -> None:
    """Trace rays in front of the lens, in its axes, to points on the sensor; see `to_sensor`."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, Z
    from plenoptic.optics.lens.kernels.trace import fill_through_lens
    from plenoptic.optics.microlens.kernels.to_sensor import fill_ideal_weights

    fill_dust_at_lens(blocks, record.dust, BlemishSite.LENS_FRONT)
    fill_through_lens(blocks, record.lens, None)
    if record.detour is not None:
        fill_detour(blocks, record.detour, None, 0)
    if record.unfolded is not None:
        blocks.reshape(-1, RAY // BLOCK, BLOCK)[:, Z // BLOCK] -= record.unfolded
    if record.ideal:
        fill_ideal_weights(blocks)
    fill_dust_at_lens(blocks, record.dust, BlemishSite.LENS_REAR)
    fill_through_array_forward(blocks, record)


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
    """Record of a camera for forward tracing; lengths in mm, array and sensor in the local axes of `Assembly`."""

    camera: PlenopticCamera
    parts: Assembly
    lens: LensRecord
    ideal: bool
    """True if the main lens is ideal."""
    facing: Floats | None
    """(3,): the camera's axis, the normal of emitters, in the lens's axes; None if it is the lens's axis."""
    entrance: Entrance
    array: ArrayRecord | None
    """None without microlenses."""
    sensor: SensorPlane
    opening: Floats | None = None
    """(2,): half height and half width of a pixel's sensitive area, over the pitch; None: the whole pixel."""
    response: ResponseRecord | WellsRecord | None = None
    dust: tuple[PlacedDust, ...] = ()
    deflection: SensorDeflection | None = None
    iris: IrisRecord | None = None
    unfolded: float | None = None
    """z behind the unfolded stack of a ghost, which is `lens`, minus z in the axes of the camera's lens, mm."""
    detour: Detour | None = None
    """Reflection behind the microlenses, where the stack goes on; None: none."""

    @property
    def has_losses_before_array(self) -> bool:
        """True if dust or the pixels' angular response attenuate light between array and sensor."""
        return self.response is not None or any(part.site in BETWEEN for part in self.dust)


class RayTask(NamedTuple):
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
    lens, array, parts = camera.lens, camera.microlenses, assembly(camera)
    lens_pose, array_record = parts.lens_to_camera, None
    if array is not None:
        differs = array.lattice is Lattice.FREE or array.imperfections is not None
        reach = _reach(camera, parts, array) if differs else 0.0
        array_record = array_forward_record(
            array, turn=parts.array_turn, origin=parts.array_origin, reach=reach, wavelength=camera.wavelength
        )
        array_record = add_losses(array_record, array, (camera.wavelength,), lens.rear_medium)
    return ForwardRecord(
        camera,
        parts,
        radiometric_lens_record(lens, camera.wavelength, reverse=False),
        lens.model in (LensModel.THIN, LensModel.PARAXIAL),
        None if lens_pose is None or lens_pose.turn[2, 2] == 1.0 else lens_pose.turn[2].copy(),
        entrance(lens, camera.wavelength),
        array_record,
        SensorPlane(parts.distance, parts.tilt, _to_sensor(parts)),
    )


def radiometric_record(camera: PlenopticCamera) -> ForwardRecord:
    """Compile a camera for forward tracing with the losses of `render`: dust, openings and response of pixels."""
    record, sensor = forward_record(camera), camera.sensor
    return record._replace(
        opening=None if sensor.fill_factor == 1 else 0.5 * np.array(sensor.pixel_aperture[::-1]),
        response=response_record(camera, record.parts),
        dust=placed_dust(camera, record.parts),
    )


def diffraction_record(camera: PlenopticCamera) -> ForwardRecord:
    """Compile a camera for forward tracing with losses and, if enabled, diffraction at iris and microlenses."""
    record = radiometric_record(camera)._replace(iris=iris_record(camera, (camera.wavelength,)))
    parts = record.parts
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


def fill_losses_behind_array(blocks: Floats, aims: Floats, record: ForwardRecord) -> None:
    """Attenuate rays at the sensor as the renderer attenuates samples before the array; `aims` is a workspace."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
    from plenoptic.optics.microlens.kernels.to_sensor import fill_aims

    parts, sensor = record.parts, record.sensor._replace(axes=None)
    placement = None
    if record.sensor.axes is not None:
        placement = np.column_stack([parts.sensor_to_local.turn[:2, :2], parts.sensor_to_local.shift[:2]])
    fill_aims(aims, blocks, sensor, placement)
    fill_losses_before_array(aims, sensor, record.response, record.dust)
    weights = np.s_[:, WEIGHT : WEIGHT + BLOCK]
    blocks.reshape(-1, RAY)[weights] = aims.reshape(-1, RAY)[weights]


def in_lens_axes(record: ForwardRecord, points: Floats) -> Floats:
    """Transform world points to the lens's axes; raise an InvalidValueError if one is not in front of the lens."""
    pose, lens_pose = record.camera.pose, record.parts.lens_to_camera
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


def ray_tasks(record: ForwardRecord, points: Floats, replicates: int, rays_per_replicate: int) -> list[RayTask]:
    """Tasks for points (n, 3) in the lens's axes, in the order of points, replicates and rays.

    Points outside the field have no tasks.
    """
    tasks = []
    for number, point in enumerate(points):
        if record.unfolded is None:
            corners = entrance_polygon(record.entrance, point)
        else:
            corners = rim_polygons(record.entrance, point[None])[0]
        if corners is None:
            continue
        polygon = np.ascontiguousarray(corners.T)
        tasks += [
            RayTask(point, polygon, number, replicate, first, min(CHUNK, rays_per_replicate - first))
            for replicate in range(replicates)
            for first in range(0, rays_per_replicate, CHUNK)
        ]
    return tasks


def trace_task(record: ForwardRecord, task: RayTask, seed: np.uint64) -> LandedRays:
    """Trace one task through all stages: a pure function of its arguments."""
    from plenoptic.camera.psf.kernels import source_rays
    from plenoptic.core.kernels.bundles import fill_status_counts
    from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, RAY

    sensor = record.camera.sensor
    rows = np.empty(task.n, HIT)
    last = record.lens if record.detour is None else record.detour.lens
    elements = max(len(record.camera.lens.elements), int(last.rows["surface_index"].max()) + 1)  # few of ideal lenses
    counts = np.zeros(CAUSES * (elements + 1), dtype=np.int64)
    blocks = np.empty(-(-min(BUNDLE, task.n) // BLOCK) * RAY)
    aims = np.empty(blocks.size if record.has_losses_before_array else 0)
    n_landed = n_beside_sensor = n_beside_opening = 0
    for start in range(0, task.n, BUNDLE):
        n = min(BUNDLE, task.n - start)
        bundle = blocks[: -(-n // BLOCK) * RAY]
        source_rays.fill_source_rays(bundle, start, n, seed, task, record.entrance.z, record.ideal, record.facing)
        if record.iris is not None:
            source_rays.fill_iris_deflections(bundle, start, n, seed, task, record.iris)
        fill_to_sensor(bundle, record)
        if record.has_losses_before_array:
            fill_losses_behind_array(bundle, aims[: bundle.size], record)
        if record.deflection is not None:
            source_rays.fill_deflections(bundle, start, n, seed, task, record.deflection)
        fill_status_counts(counts, bundle, n)
        landed, beside_sensor, beside_opening = source_rays.fill_sensor_hits(
            rows[n_landed:], bundle, n, *sensor.shape, sensor.pixel_pitch, record.opening
        )
        n_landed, n_beside_sensor = n_landed + landed, n_beside_sensor + beside_sensor
        n_beside_opening += beside_opening
    return LandedRays(rows[:n_landed], counts, n_beside_sensor, n_beside_opening)
