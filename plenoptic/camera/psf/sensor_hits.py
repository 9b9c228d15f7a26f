"""From a point to the sensor: the stages that rays pass, one task after the other.

Dust, the openings of pixels and their response to directions count where the tables come from `measuring_tables`; the
stages are then those of the renderer, in the opposite order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly, assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.psf.forward_array import ForwardArray, fill_through_array_forward, forward_array
from plenoptic.camera.record import PlacedBlemishes, fill_before_array, fill_dimmed_at_lens, placed_blemishes
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.entrance_pupil import Entrance, entering_polygon, entrance
from plenoptic.optics.lens.record import LensRecord, lens_record
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.sensor.angular_response import AngularResponse

BUNDLE = 1 << 13
"""Rays that go through the stages together."""
CHUNK = 1 << 17
"""Rays of a point and replicate that one thread takes at a time; they take some 7 MB."""


class Dimming(NamedTuple):
    """What dims light that lens and microlenses let pass; the first five are those of `CameraTables`."""

    parts: Assembly
    distance: float
    lean: NDArray[np.float64] | None
    response: AngularResponse | None
    blemishes: tuple[PlacedBlemishes, ...]
    placed: NDArray[np.float64] | None
    """(2, 3): from x, y, 1 on the sensor to the local axes; None where they are the same."""
    by_aim: bool
    """Whether something of it lies between sensor and array."""


class ForwardTables(NamedTuple):
    """A camera forwards, as numbers."""

    camera: PlenopticCamera
    lens: LensRecord
    ideal: bool
    """Whether an ideal lens stands for the main lens."""
    facing: NDArray[np.float64] | None
    """(3,) the camera's axis, along which emitters face, in the lens's axes; None where it is the lens's."""
    entrance: Entrance
    array: ForwardArray
    opening: NDArray[np.float64] | None = None
    """(2,) half the height and half the width of what is open of a pixel, over the pitch; None: all of it."""
    dimming: Dimming | None = None
    """None where nothing dims."""


class Task(NamedTuple):
    """Rays first ... first + n - 1 of a replicate of a point, which enter the lens through `triangles`."""

    point: NDArray[np.float64]
    triangles: NDArray[np.float64]
    number: int
    replicate: int
    first: int
    n: int


class Landed(NamedTuple):
    """Rows of the rays that land (see `source_rays.LANDED`), rays by status code, those beside sensor and openings."""

    rows: NDArray[np.float64]
    counts: NDArray[np.int64]
    beside: int
    shut: int


def forward_tables(camera: PlenopticCamera) -> ForwardTables:
    """Compile a camera for light that travels forwards, whatever its dust and its pixels make of it."""
    lens, parts = camera.lens, assembly(camera)
    placed = parts.lens_to_camera
    return ForwardTables(
        camera,
        lens_record(lens, camera.wavelength, reverse=False),
        lens.model in (LensModel.THIN, LensModel.PARAXIAL),
        None if placed is None or placed.turn[2, 2] == 1.0 else placed.turn[2].copy(),
        entrance(lens, camera.wavelength),
        forward_array(camera, parts),
    )


def measuring_tables(camera: PlenopticCamera) -> ForwardTables:
    """The same with all that dims what `render` measures: dust, openings of pixels, their response to directions."""
    tables, sensor = forward_tables(camera), camera.sensor
    opening = None if sensor.fill_factor == 1 else 0.5 * np.array(sensor.pixel_aperture[::-1])
    return tables._replace(opening=opening, dimming=_dimming(camera, tables.array.parts))


def _dimming(camera: PlenopticCamera, parts: Assembly) -> Dimming | None:
    response, given = camera.sensor.angular_response, [part for part in camera.blemishes if len(part)]
    if response is None and not given:
        return None
    vertices, turn, shift = camera.lens.vertices, parts.sensor_to_local.turn[:2, :2], parts.sensor_to_local.shift[:2]
    same = np.array_equal(turn, np.eye(2)) and not shift.any()
    return Dimming(
        parts,
        parts.distance,
        parts.lean,
        response,
        tuple(placed_blemishes(part, parts, float(vertices[0]), float(vertices[-1])) for part in given),
        None if same else np.column_stack([turn, shift]),
        response is not None or any(part.site in (BlemishSite.SENSOR, BlemishSite.ARRAY) for part in given),
    )


def _fill_dimmed_at_lens(blocks: NDArray[np.float64], dimming: Dimming | None, site: BlemishSite) -> None:
    if dimming is not None:
        fill_dimmed_at_lens(blocks, dimming, site)


def _fill_dimmed_behind_array(blocks: NDArray[np.float64], aims: NDArray[np.float64], dimming: Dimming | None) -> None:
    """Rays that have landed, dimmed as the renderer dims samples before the array; `aims` is room for them."""
    from plenoptic.optics.microlens.kernels import to_sensor

    if dimming is not None and dimming.by_aim:
        to_sensor.fill_aims(aims, blocks, dimming.distance, dimming.lean, dimming.placed)
        fill_before_array(aims, dimming)
        to_sensor.fill_weights(blocks, aims)


def in_lens_axes(tables: ForwardTables, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """World points in the lens's axes, or an error where one does not lie in front of the lens."""
    pose, placed = tables.camera.pose, tables.array.parts.lens_to_camera
    seen = points if pose is None else pose.to_camera(points)
    seen = seen if placed is None else placed.inverse().points(seen)
    behind = np.flatnonzero(~(seen[:, 2] < tables.entrance.z))
    if len(behind):
        raise InvalidValueError(
            f"point {behind[0]} lies at z = {seen[behind[0], 2]:g} mm of the lens's axes, and the lens begins at "
            f"z = {tables.entrance.z:g} mm; points must lie in front of it, at smaller z"
        )
    return seen


def tasks_of(tables: ForwardTables, points: NDArray[np.float64], replicates: int, each: int) -> list[Task]:
    """All there is to trace from points (n, 3) in the lens's axes, in the order of points, replicates and rays.

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
    """A convex polygon (counter-clockwise) as triangles, in the form that `paths.aim` reads."""
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
    from plenoptic.camera.psf.kernels import source_rays
    from plenoptic.camera.sampling.kernels.paths import fill_status_counts
    from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, RAY
    from plenoptic.optics.lens.kernels.trace import fill_traced
    from plenoptic.optics.microlens.kernels import to_sensor

    sensor, facing, dimming = tables.camera.sensor, tables.facing, tables.dimming
    rows = np.empty((task.n, source_rays.LANDED))
    counts = np.zeros(CAUSES * (len(tables.camera.lens.elements) + 1), dtype=np.int64)
    blocks = np.empty(-(-min(BUNDLE, task.n) // BLOCK) * RAY)
    aims = np.empty(0 if dimming is None else blocks.size)
    arrived = beside = shut = 0
    for start in range(0, task.n, BUNDLE):
        n = min(BUNDLE, task.n - start)
        bundle = blocks[: -(-n // BLOCK) * RAY]
        first, z = task.first + start, tables.entrance.z
        source_rays.fill_source_rays(
            bundle, first, n, seed, task.number, task.replicate, task.triangles, task.point, z, tables.ideal, facing
        )
        _fill_dimmed_at_lens(bundle, dimming, BlemishSite.LENS_FRONT)
        fill_traced(bundle, tables.lens, None)
        if tables.ideal:
            to_sensor.fill_ideal_weights(bundle)
        _fill_dimmed_at_lens(bundle, dimming, BlemishSite.LENS_REAR)
        fill_through_array_forward(bundle, tables.array)
        _fill_dimmed_behind_array(bundle, aims[: bundle.size], dimming)
        fill_status_counts(counts, bundle, n)
        found, missed, between = source_rays.fill_landed(
            rows[arrived:], bundle, n, *sensor.shape, sensor.pixel_pitch, tables.opening
        )
        arrived, beside, shut = arrived + found, beside + missed, shut + between
    return Landed(rows[:arrived], counts, beside, shut)
