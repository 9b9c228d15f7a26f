"""Last-result cache of compiled cameras and of the illuminated pixels of their tiles."""

from __future__ import annotations

import copy
import dataclasses
import operator
from collections.abc import Hashable
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import lens_to_world
from plenoptic.camera.camera_record import CameraRecord, camera_record, lens_transmission
from plenoptic.camera.sampling.aperture_regions import illuminated_pixels
from plenoptic.camera.sampling.sampling_records import IlluminatedPixels, Regions
from plenoptic.core.last_result import LastResultCache
from plenoptic.core.values import Floats
from plenoptic.optics.sensor.sensor import Sensor

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

MAX_CACHED_BYTES = 1 << 28
"""Size of the cache of illuminated pixels, some 500 bytes each; tiles beyond it are computed again for each use."""


class Pixels(Hashable, Protocol):
    """Set of pixels, such as a tile."""

    def centres(self, camera: CameraRecord) -> Floats:
        """Local centres (n, 2); see `aperture_regions.pixel_centres`."""

    def numbers(self, camera: CameraRecord) -> NDArray[np.int64]:
        """Numbers (n,) on the sensor."""


class PreparedCamera:
    """Record of a camera, and a cache of the illuminated pixels of the last set of tiles.

    Pixels are cached from the second use of the same tiles on, or if tiles are rendered in several steps: allocating
    memory takes a third of the time of computing them.

    There is no lock, since a process forked meanwhile would wait for it for ever: two threads may compute the same.
    """

    def __init__(self, record: CameraRecord) -> None:
        self.record = record
        self._tiles: tuple[Pixels, ...] = ()
        self._caches = False
        self._illuminated: dict[tuple[Pixels, bool], IlluminatedPixels] = {}
        self._bytes = 0

    @property
    def cached_bytes(self) -> int:
        """Size of the cached illuminated pixels in bytes."""
        return self._bytes

    def with_pose(self, camera: PlenopticCamera) -> PreparedCamera:
        """Copy for a camera that differs in its pose alone; both share the cached pixels."""
        other, world = copy.copy(self), lens_to_world(camera, self.record.parts)
        other.record = self.record._replace(
            rotation=None if world is None else world.turn, position=None if world is None else world.shift
        )
        return other

    def set_tiles(self, tiles: tuple[Pixels, ...], *, steps: bool) -> None:
        """Set the tiles to render, in several steps or at once, and clear the cache unless they are those of before."""
        self._caches = steps or self._tiles == tiles
        if self._tiles != tiles:
            self._tiles, self._illuminated, self._bytes = tiles, {}, 0

    def illuminated_pixels(self, tile: Pixels, *, with_core: bool = False) -> IlluminatedPixels:
        """Illuminated pixels of a tile; see `aperture_regions.illuminated_pixels`."""
        cached = self._illuminated.get((tile, with_core))
        if cached is not None:
            return cached
        illuminated = illuminated_pixels(
            self.record, tile.centres(self.record), tile.numbers(self.record), with_core=with_core
        )
        if self._caches:
            illuminated = _trim(illuminated)
            arrays = (*illuminated[:3], *illuminated.regions, *(illuminated.sources or ()))
            size = sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))
            if self._bytes + size <= MAX_CACHED_BYTES:
                self._illuminated[tile, with_core], self._bytes = illuminated, self._bytes + size
        return illuminated


def _trim(illuminated: IlluminatedPixels) -> IlluminatedPixels:
    """Copy with arrays that have no unused capacity."""
    pieces, first, corners, planes, details = illuminated.regions
    last = pieces[: first[-1]][-1:]
    ends = [int((last[f"first_{name}"] + last[f"{name}s"]).sum()) for name in ("corner", "plane")]
    details = None if details is None else details[: first[-1]].copy()
    arrays = pieces[: first[-1]].copy(), first, corners[:, : ends[0]].copy(), planes[: ends[1]].copy(), details
    return illuminated._replace(regions=Regions(*arrays))


_NOT_COMPARED = ("sensor", "pose", "shutter")
"""Fields of a camera that are not compared: the cache's key, and fields without effect here."""
_last_with_sensor: LastResultCache[Sensor, list[tuple[tuple[object, ...], PreparedCamera]]] = LastResultCache(
    lambda _: []
)
"""Parts of the last camera with a sensor, and the compiled camera, until that sensor is gone."""


def _prepare(camera: PlenopticCamera) -> PreparedCamera:
    last = _last_with_sensor(camera.sensor)
    names = (field.name for field in dataclasses.fields(camera) if field.name not in _NOT_COMPARED)
    parts = tuple(getattr(camera, name) for name in names)
    if last and all(map(operator.is_, parts, last[0][0])):
        prepared = last[0][1].with_pose(camera)
    else:
        record = camera_record(camera)
        prepared = PreparedCamera(record._replace(transmission=lens_transmission(record)))
    last[:] = [(parts, prepared)]
    return prepared


prepared_camera = LastResultCache(_prepare)
"""Compile a camera, unless it is the one compiled last; only its pose if its other parts are those of the last one."""
