"""One path from the sensor through microlens and lens, with what it meets there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.record import CameraTables, fill_before_array, fill_dimmed_at_lens, fill_through_array, lanes_for
from plenoptic.camera.sampling.pixel_regions import pixel_centres
from plenoptic.core.rays import RayStatus
from plenoptic.optics.lens.record import LensRecord
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.listed import lattice_types
from plenoptic.rendering.integrator.path import Batch
from plenoptic.rendering.tile import (
    FedPixels,
    Tile,
    fed_pixels,
    fill_aimed,
    fill_drawn_waves,
    fill_through_lens,
    wave_guide,
)
from plenoptic.replaying.camera_events import (
    CameraEvent,
    ElementKind,
    ElementPassage,
    MicrolensPassage,
    SensorPoint,
    Vector,
)
from plenoptic.truth.microlenses import listed_numbers

_NOWHERE = (RayStatus.MISSED, RayStatus.NOT_FINITE, RayStatus.NOT_CONVERGED)
"""Where a path is lost by these, it has no point on the element."""


class CameraWay(NamedTuple):
    """A path through the camera."""

    events: tuple[CameraEvent, ...]
    bundle: NDArray[np.float64]
    """A block with one ray, behind the lens."""
    waves: NDArray[np.int64] | None
    """(BLOCK,): the first is the number of the path's wavelength. None where all paths have the camera's."""
    number: NDArray[np.int64]
    """(1,): of the pixel on the sensor."""

    @property
    def weight(self) -> float:
        """Projected solid angle that the path stands for, sr."""
        return _row(self.bundle).weight


class _Row(NamedTuple):
    """The first ray of a block."""

    point: Vector
    direction: Vector
    weight: float
    status: float


def _row(bundle: NDArray[np.float64]) -> _Row:
    numbers = bundle.reshape(8, -1)[:, 0].copy()
    return _Row(numbers[:3], numbers[3:6], float(numbers[6]), float(numbers[7]))


def trace_camera(tables: CameraTables, pixel: tuple[int, int], batch: Batch, seed: np.uint64) -> CameraWay | None:
    """Follow the one path of a batch of one, as `tiles.render_tile` does; None where no light reaches the pixel."""
    from plenoptic.core.kernels import sobol
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY

    row, column = pixel
    centres = pixel_centres(tables, (row, row + 1), (column, column + 1))
    fed = fed_pixels(tables, Tile(row, column, 1, 1), centres)
    if not fed.place.size:
        return None
    net = np.empty((sobol.DIMENSIONS, 1), dtype=np.uint32)
    sobol.fill_net(net, batch.first_index)
    bundle, lanes = np.empty(RAY), lanes_for(tables, BLOCK)
    fill_aimed(bundle, lanes, 0, 1, batch, seed, net, fed, tables)
    aimed = _row(bundle)
    fill_before_array(bundle, tables)
    fill_through_array(bundle, lanes, tables)
    events: list[CameraEvent] = [
        SensorPoint(pixel, _fixed(_in_camera(tables, _sensor_point(tables, aimed)))),
        _array_event(tables, aimed, lanes, _row(bundle)),
    ]
    if tables.blemishes:
        fill_dimmed_at_lens(bundle, tables, BlemishSite.LENS_REAR)
    lens, waves = tables.lens, None
    if tables.colour is not None and tables.dispersed is not None:
        lens, waves = tables.dispersed, _wave(tables, batch, seed, fed)
    events += _lens_events(tables, lens, bundle, waves)
    fill_through_lens(bundle, lens, waves)
    if tables.blemishes:
        fill_dimmed_at_lens(bundle, tables, BlemishSite.LENS_FRONT)
    return CameraWay(tuple(events), bundle, waves, fed.number)


def _wave(tables: CameraTables, batch: Batch, seed: np.uint64, fed: FedPixels) -> NDArray[np.int64]:
    from plenoptic.core.kernels.ray_blocks import BLOCK

    assert tables.colour is not None
    waves, cdf = np.empty(BLOCK, dtype=np.int64), tables.colour.cdf
    fill_drawn_waves(waves, 0, 1, batch, seed, fed.number, cdf, wave_guide(cdf))
    return waves


def _behind(tables: CameraTables) -> float:
    """From the array's front principal plane to the rear one, in mm."""
    return 0.0 if tables.array is None else tables.array.principal_separation


def _sensor_point(tables: CameraTables, aimed: _Row) -> Vector:
    """Where an aimed sample starts, in local axes; see `optics.microlens.kernels.to_lens` for its fields."""
    x, y = aimed.point[:2] - aimed.direction[:2]
    lean = 0.0 if tables.lean is None else float(tables.lean @ (x, y))
    return np.array([x, y, tables.distance + lean + _behind(tables)])


def _in_camera(tables: CameraTables, point: Vector) -> Vector:
    """A point in local axes, z from the array's front principal plane, in the camera's."""
    frame = tables.frame
    if frame is None:
        in_lens = np.array([point[0], point[1], point[2] + tables.z_plane])
    else:
        in_lens = frame[:9].reshape(3, 3) @ point + frame[9:]
    moved = tables.parts.lens_to_camera
    return in_lens if moved is None else moved.points(in_lens)


def _array_event(tables: CameraTables, aimed: _Row, lanes: NDArray[np.float64] | None, after: _Row) -> MicrolensPassage:
    aim = np.array([*aimed.point[:2], _behind(tables)])
    microlens, kind = _microlens(tables, aimed, lanes)
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
    tables: CameraTables, aimed: _Row, lanes: NDArray[np.float64] | None
) -> tuple[tuple[int, int] | None, int | None]:
    """Indices and type of the microlens that a sample is aimed at."""
    from plenoptic.optics.microlens.kernels.to_lens import CELL_X, CELL_Y, NUMBER

    array, cells = tables.array, tables.cells
    if array is None or cells is None:
        return None, None
    numbers = listed_numbers(tables)
    if numbers is not None and lanes is not None:
        number = int(numbers[int(lanes[0, NUMBER])])
        return (number, 0), 0 if array.types is None else int(np.asarray(array.types)[number])
    # The aimed sample holds its optical axis, which imperfections may move; the cell stays.
    centre = np.array([aimed.point[2], aimed.direction[2]]) if lanes is None else lanes[0, [CELL_X, CELL_Y]]
    index = np.rint((centre - cells.origin) @ cells.inverse).astype(np.int64)
    return (int(index[0]), int(index[1])), int(lattice_types(array, index[None])[0])


def _lens_events(
    tables: CameraTables, lens: LensRecord, bundle: NDArray[np.float64], waves: NDArray[np.int64] | None
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


def _moved_point(tables: CameraTables, point: Vector) -> Vector:
    """From the lens's axes to the camera's."""
    moved = tables.parts.lens_to_camera
    return _fixed(point if moved is None else moved.points(point))


def _moved_direction(tables: CameraTables, direction: Vector) -> Vector:
    moved = tables.parts.lens_to_camera
    return _fixed(direction if moved is None else moved.directions(direction))


def _fixed(array: Vector) -> Vector:
    array.flags.writeable = False
    return array
