"""One path from the sensor through microlens and lens, with what it meets there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.dust import fill_dimmed_at_lens
from plenoptic.camera.paths import CameraPaths, fill_through_lens
from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.pixel_regions import fed_pixels, pixel_centres
from plenoptic.camera.sampling.record import Batch
from plenoptic.core.rays import RayStatus
from plenoptic.core.values import Floats
from plenoptic.optics.lens.record import LensRecord
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.listed import lattice_types
from plenoptic.replaying.camera_events import CameraEvent, ElementKind, ElementPassage, MicrolensPassage, SensorPoint
from plenoptic.truth.microlenses import listed_numbers

_NOWHERE = (RayStatus.MISSED, RayStatus.NOT_FINITE, RayStatus.NOT_CONVERGED)
"""Where a path is lost by these, it has no point on the element."""


class CameraWay(NamedTuple):
    """A path through the camera."""

    events: tuple[CameraEvent, ...]
    bundle: Floats
    """A block with one ray, behind the lens."""
    waves: NDArray[np.int64] | None
    """(BLOCK,): the first is the number of the path's wavelength. None where all paths have the camera's."""
    number: NDArray[np.int64]
    """(1,): of the pixel on the sensor."""
    batch: Batch
    """Of one path."""

    @property
    def weight(self) -> float:
        """Projected solid angle that the path stands for, sr."""
        return _row(self.bundle).weight


class _Row(NamedTuple):
    """The first ray of a block."""

    point: Floats
    direction: Floats
    weight: float
    status: float


def _row(bundle: Floats) -> _Row:
    numbers = bundle.reshape(8, -1)[:, 0].copy()
    return _Row(numbers[:3], numbers[3:6], float(numbers[6]), float(numbers[7]))


def trace_camera(tables: CameraRecord, pixel: tuple[int, int], batch: Batch) -> CameraWay | None:
    """Follow the one path of a batch of one, as `tile.render_tile` does; None where no light reaches the pixel."""
    row, column = pixel
    centres = pixel_centres(tables, (row, row + 1), (column, column + 1))
    fed = fed_pixels(tables, centres, np.array([row * tables.sensor.columns + column]))
    if not fed.place.size:
        return None
    ways = CameraPaths(tables, fed, batch, 1)
    bundle = ways.started(0, 1)
    aimed = _row(bundle)
    ways.fill_through_array(bundle)
    events: list[CameraEvent] = [
        SensorPoint(pixel, _fixed(_in_camera(tables, _sensor_point(tables, aimed)))),
        _array_event(tables, aimed, ways.own, _row(bundle)),
    ]
    before = bundle.copy()
    fill_dimmed_at_lens(before, tables.dust, BlemishSite.LENS_REAR)
    events += _lens_events(tables, ways.lens, before, ways.waves)
    ways.fill_through_lens(bundle)
    return CameraWay(tuple(events), bundle, ways.waves, fed.number, batch)


def _behind(tables: CameraRecord) -> float:
    """From the array's front principal plane to the rear one, in mm."""
    return 0.0 if tables.microlenses is None else tables.microlenses.principal_separation


def _sensor_point(tables: CameraRecord, aimed: _Row) -> Floats:
    """Where an aimed sample starts, in local axes; see `optics.microlens.kernels.to_lens` for its fields."""
    x, y = aimed.point[:2] - aimed.direction[:2]
    plane = tables.sensor.plane
    farther = 0.0 if plane.tilt is None else float(plane.tilt @ (x, y))
    return np.array([x, y, plane.distance + farther + _behind(tables)])


def _in_camera(tables: CameraRecord, point: Floats) -> Floats:
    """A point in local axes, z from the array's front principal plane, in the camera's."""
    frame = tables.frame
    if frame is None:
        in_lens = np.array([point[0], point[1], point[2] + tables.z_plane])
    else:
        in_lens = frame[:9].reshape(3, 3) @ point + frame[9:]
    moved = tables.parts.lens_to_camera
    return in_lens if moved is None else moved.points(in_lens)


def _array_event(tables: CameraRecord, aimed: _Row, own: NDArray[np.void] | None, after: _Row) -> MicrolensPassage:
    aim = np.array([*aimed.point[:2], _behind(tables)])
    microlens, kind = _microlens(tables, aimed, own)
    lost = after.status != 0
    return MicrolensPassage(
        aim=_fixed(_in_camera(tables, aim)),
        microlens=microlens,
        type=kind,
        status=RayStatus(int(after.status)),
        point=None if lost else _moved_point(tables, after.point),
        direction=None if lost else _moved_direction(tables, after.direction),
        weight=after.weight,
    )


def _microlens(
    tables: CameraRecord, aimed: _Row, own: NDArray[np.void] | None
) -> tuple[tuple[int, int] | None, int | None]:
    """Indices and type of the microlens that a sample is aimed at."""
    array, cells = tables.microlenses, tables.array
    if array is None or cells is None:
        return None, None
    numbers = listed_numbers(tables)
    if numbers is not None and own is not None:
        number = int(numbers[own[0]["row"]])
        return (number, 0), 0 if array.types is None else int(np.asarray(array.types)[number])
    # The aimed sample holds its optical axis, which imperfections may move; the cell stays.
    centre = (
        np.array([aimed.point[2], aimed.direction[2]])
        if own is None
        else np.array([own[0]["cell_x"], own[0]["cell_y"]])
    )
    index = np.rint((centre - cells.lattice.origin) @ cells.lattice.inverse).astype(np.int64)
    return (int(index[0]), int(index[1])), int(lattice_types(array, index[None])[0])


def _lens_events(
    tables: CameraRecord, lens: LensRecord, bundle: Floats, waves: NDArray[np.int64] | None
) -> list[CameraEvent]:
    """Passages through the elements, up to the one where the path ends."""
    events: list[CameraEvent] = []
    before = _row(bundle)
    if before.status != 0:
        return events
    for last in range(len(lens.rows)):
        # From the beginning each time: the rays that a whole trace has there, to the bit.
        part = bundle.copy()
        fill_through_lens(part, lens.first(last + 1), waves)
        after = _row(part)
        lost = after.status != 0
        status = RayStatus(int(after.status) % 8)
        events.append(
            ElementPassage(
                element=int(lens.rows[last]["surface_index"]),
                kind=ElementKind(int(lens.rows[last]["kind"])),
                status=status,
                point=None if status in _NOWHERE else _moved_point(tables, after.point),
                before=_moved_direction(tables, before.direction),
                after=None if lost else _moved_direction(tables, after.direction),
            )
        )
        if lost:
            break
        before = after
    return events


def _moved_point(tables: CameraRecord, point: Floats) -> Floats:
    """From the lens's axes to the camera's."""
    moved = tables.parts.lens_to_camera
    return _fixed(point if moved is None else moved.points(point))


def _moved_direction(tables: CameraRecord, direction: Floats) -> Floats:
    moved = tables.parts.lens_to_camera
    return _fixed(direction if moved is None else moved.directions(direction))


def _fixed(array: Floats) -> Floats:
    array.flags.writeable = False
    return array
