"""Compiled records of the camera that was rendered last, for the next call with the same one."""

from __future__ import annotations

import copy
import dataclasses
import operator
from collections.abc import Hashable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.record import CameraRecord, camera_record, world_of
from plenoptic.camera.sampling.pixel_regions import fed_pixels
from plenoptic.camera.sampling.record import FedPixels, Regions
from plenoptic.core.last_result import LastResultCache
from plenoptic.core.values import Floats
from plenoptic.optics.sensor.sensor import Sensor

MOST_BYTES = 1 << 28
"""Of what feeds pixels, some 500 bytes each: what has no room is found again whenever it is needed."""


class Pixels(Hashable, Protocol):
    """Some pixels, such as a tile."""

    def centres(self, camera: CameraRecord) -> Floats:
        """(n, 2): see `pixel_regions.pixel_centres`."""

    def numbers(self, camera: CameraRecord) -> NDArray[np.int64]:
        """(n,): on the whole sensor."""


class PreparedCamera:
    """Camera record with the aperture regions of the tiles into which its sensor was cut last.

    That is kept from the second time on that they are cut, or where there are several steps: new memory takes a third
    of the time in which it is found.

    There is no lock, for which a process that is forked off meanwhile would wait for ever: two threads may both find
    the same.
    """

    def __init__(self, record: CameraRecord) -> None:
        self.record = record
        self._tiles: tuple[Pixels, ...] = ()
        self._keeps = False
        self._fed: dict[tuple[Pixels, bool], FedPixels] = {}
        self._bytes = 0

    @property
    def kept_bytes(self) -> int:
        """Bytes of the regions of illuminated pixels."""
        return self._bytes

    def posed(self, camera: PlenopticCamera) -> PreparedCamera:
        """Prepared camera for another pose: both share the aperture regions."""
        other, world = copy.copy(self), world_of(camera, self.record.parts)
        other.record = self.record._replace(
            rotation=None if world is None else world.turn, position=None if world is None else world.shift
        )
        return other

    def cut_into(self, tiles: tuple[Pixels, ...], *, steps: bool) -> None:
        """Drop the aperture regions of all tiles but these, which are rendered in several steps or at once."""
        self._keeps = steps or self._tiles == tiles
        if self._tiles != tiles:
            self._tiles, self._fed, self._bytes = tiles, {}, 0

    def fed_pixels(self, tile: Pixels, *, certain: bool = False) -> FedPixels:
        """Aperture regions of the pixels of a tile; see `pixel_regions.fed_pixels`."""
        regions = self._fed.get((tile, certain))
        if regions is not None:
            return regions
        regions = fed_pixels(self.record, tile.centres(self.record), tile.numbers(self.record), certain=certain)
        if self._keeps:
            regions = _trim(regions)
            arrays = (*regions[:3], *regions.regions, *(regions.around or ()))
            size = sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))
            if self._bytes + size <= MOST_BYTES:
                self._fed[tile, certain], self._bytes = regions, self._bytes + size
        return regions


def _trim(fed: FedPixels) -> FedPixels:
    """The same in arrays without room for more."""
    pieces, first, corners, planes, details = fed.regions
    last = pieces[: first[-1]][-1:]
    ends = [int((last[f"first_{name}"] + last[f"{name}s"]).sum()) for name in ("corner", "plane")]
    details = None if details is None else details[: first[-1]].copy()
    fitted = pieces[: first[-1]].copy(), first, corners[:, : ends[0]].copy(), planes[: ends[1]].copy(), details
    return fed._replace(regions=Regions(*fitted))


class _Kept:
    """Compiled records that cameras share which differ in their pose only: those of the last sensor."""

    def __init__(self, sensor: Sensor) -> None:
        self._parts: tuple[object, ...] = ()
        self._prepared: PreparedCamera | None = None

    def prepared(self, camera: PlenopticCamera) -> PreparedCamera:
        """A camera of the parts of the last one stands elsewhere; any other is compiled."""
        parts = tuple(getattr(camera, field.name) for field in dataclasses.fields(camera) if field.name not in _APART)
        if self._prepared is not None and all(map(operator.is_, parts, self._parts)):
            self._prepared = self._prepared.posed(camera)
        else:
            self._parts, self._prepared = parts, PreparedCamera(camera_record(camera))
        return self._prepared


_APART = ("sensor", "pose", "shutter")
"""Fields of a camera that are not compared: that of which what is kept is kept, and what may differ."""


def prepared_camera(camera: PlenopticCamera) -> PreparedCamera:
    """Compile a camera, unless it is the very one that was compiled last and still exists: cameras do not change.

    Of one with the same parts and another pose only the pose is compiled.
    """
    return _last(camera)


_kept: LastResultCache[Sensor, _Kept] = LastResultCache(_Kept)
_last: LastResultCache[PlenopticCamera, PreparedCamera] = LastResultCache(
    lambda camera: _kept(camera.sensor).prepared(camera)
)
"""Of one camera only."""
