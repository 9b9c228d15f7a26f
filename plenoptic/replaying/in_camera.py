"""One path from the sensor through microlens and lens, with its events."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_rays import CameraRays
from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.dust import fill_dust_at_lens
from plenoptic.camera.sampling.aperture_regions import illuminated_pixels, kernel_source_pixels
from plenoptic.camera.sampling.sampling_records import Batch, IlluminatedPixels
from plenoptic.core.rays import RayStatus
from plenoptic.core.values import Floats
from plenoptic.optics.element_record import ElementKind
from plenoptic.optics.lens.lens_record import LensRecord
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.lenslets import types_of
from plenoptic.rendering.tile import Tile
from plenoptic.replaying.events import ElementPassage, Event, MicrolensPassage, SensorPoint
from plenoptic.truth.truth_stages import lattice_indices, lens_numbers

_NOWHERE = (RayStatus.MISSED, RayStatus.NOT_FINITE, RayStatus.NOT_CONVERGED)
"""Causes for which a lost path has no point on the element."""


class CameraPath(NamedTuple):
    """A path through the camera."""

    events: tuple[Event, ...]
    bundle: Floats
    """A block with one ray, behind the lens."""
    waves: NDArray[np.int64] | None
    """(BLOCK,): the first is the index of the path's wavelength. None if all paths have the camera's."""
    pixel: IlluminatedPixels
    weight: float
    """Projected solid angle that the path stands for, sr."""
    core_weight: float
    """Projected solid angle of the unvignetted core, sr, which the weight in the bundle includes."""


class _Ray(NamedTuple):
    """The first ray of a block."""

    point: Floats
    direction: Floats
    weight: float
    status: float


def _first_ray(bundle: Floats) -> _Ray:
    numbers = bundle.reshape(8, -1)[:, 0].copy()
    return _Ray(numbers[:3], numbers[3:6], float(numbers[6]), float(numbers[7]))


def trace_camera(camera: CameraRecord, pixel: tuple[int, int], batch: Batch, *, with_core: bool) -> CameraPath | None:
    """Trace the one path of a batch of one, as `tile.render_tile` does; None if no light reaches the pixel."""
    tile = Tile(*pixel, 1, 1)
    illuminated = illuminated_pixels(camera, tile.centres(camera), tile.numbers(camera), with_core=with_core)
    if camera.diffraction_kernel is not None:
        illuminated, _ = kernel_source_pixels(camera, illuminated, camera.diffraction_kernel.table)
    if not illuminated.place.size:
        return None
    rays = CameraRays(camera, illuminated, batch, 1)
    bundle = rays.sample(0, 1)
    aimed = _first_ray(bundle)
    rays.fill_through_array(bundle)
    before = bundle.copy()
    fill_dust_at_lens(before, camera.dust, BlemishSite.LENS_REAR)
    events = (
        SensorPoint(pixel, _in_camera(camera, _sensor_point(camera, aimed))),
        _array_event(camera, aimed, rays.lenslets, _first_ray(bundle)),
        *_lens_events(camera, rays.lens, before, rays.waves),
    )
    rays.fill_through_lens(bundle)
    rays.fill_iris_deflections(bundle, 0, 1)
    core_weight = 0.0 if rays.core is None else _first_ray(rays.core).weight
    weight = _first_ray(bundle).weight - core_weight
    return CameraPath(events, bundle, rays.waves, illuminated, weight, core_weight)


def _behind(camera: CameraRecord) -> float:
    """Distance of the array's rear principal plane behind the front one, mm."""
    return 0.0 if camera.microlenses is None else camera.microlenses.principal_separation


def _sensor_point(camera: CameraRecord, aimed: _Ray) -> Floats:
    """Start of an aimed ray, in local axes; see `optics.microlens.kernels.to_lens` for its fields."""
    x, y = aimed.point[:2] - aimed.direction[:2]
    plane = camera.sensor.plane
    farther = 0.0 if plane.tilt is None else float(plane.tilt @ (x, y))
    return np.array([x, y, plane.distance + farther + _behind(camera)])


def _in_camera(camera: CameraRecord, point: Floats) -> Floats:
    """A point in local axes, z from the array's front principal plane, in the camera's."""
    frame = camera.frame
    if frame is None:
        return _moved_point(camera, np.array([point[0], point[1], point[2] + camera.parts.z_plane]))
    return _moved_point(camera, frame[:9].reshape(3, 3) @ point + frame[9:])


def _array_event(camera: CameraRecord, aimed: _Ray, lenslets: NDArray[np.void] | None, after: _Ray) -> MicrolensPassage:
    microlens, kind = _microlens(camera, aimed, lenslets)
    lost = after.status != 0
    return MicrolensPassage(
        aim=_in_camera(camera, np.array([*aimed.point[:2], _behind(camera)])),
        microlens=microlens,
        type=kind,
        status=RayStatus(int(after.status)),
        point=None if lost else _moved_point(camera, after.point),
        direction=None if lost else _moved_direction(camera, after.direction),
        weight=after.weight,
    )


def _microlens(
    camera: CameraRecord, aimed: _Ray, lenslets: NDArray[np.void] | None
) -> tuple[tuple[int, int] | None, int | None]:
    """Indices and type of the microlens that a sample is aimed at."""
    if camera.microlenses is None or camera.array is None:
        return None, None
    # The aimed sample holds its optical axis, which imperfections may move; the cell stays.
    cell = aimed.point[2], aimed.direction[2], -1
    if lenslets is not None:
        cell = lenslets[0][["cell_x", "cell_y", "row"]].tolist()
    index = lattice_indices(camera, np.array([cell]), lens_numbers(camera))
    return (int(index[0, 0]), int(index[0, 1])), int(types_of(camera.microlenses, index)[0])


def _lens_events(
    camera: CameraRecord, lens: LensRecord, bundle: Floats, waves: NDArray[np.int64] | None
) -> list[Event]:
    """Passages through the elements, up to the one where the path ends."""
    from plenoptic.optics.lens.kernels.trace import fill_traced

    events: list[Event] = []
    before = _first_ray(bundle)
    for last in range(len(lens.rows)):
        if before.status != 0:
            break
        # From the beginning each time: the rays that a whole trace has there, to the bit.
        part = bundle.copy()
        fill_traced(part, lens.part(0, last + 1), waves)
        after = _first_ray(part)
        lost = after.status != 0
        status = RayStatus(int(after.status) % 8)
        events.append(
            ElementPassage(
                element=int(lens.rows[last]["surface_index"]),
                kind=ElementKind(int(lens.rows[last]["kind"])),
                status=status,
                point=None if status in _NOWHERE else _moved_point(camera, after.point),
                before=_moved_direction(camera, before.direction),
                after=None if lost else _moved_direction(camera, after.direction),
            )
        )
        before = after
    return events


def _moved_point(camera: CameraRecord, point: Floats) -> Floats:
    """From the lens's axes to the camera's."""
    moved = camera.parts.lens_to_camera
    return point if moved is None else moved.points(point)


def _moved_direction(camera: CameraRecord, direction: Floats) -> Floats:
    moved = camera.parts.lens_to_camera
    return direction if moved is None else moved.directions(direction)
