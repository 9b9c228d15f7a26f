"""What is compiled of the camera that was rendered last, for the next call with the same one."""

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
from plenoptic.core.last_result import LastResult
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
    """A camera as a record, and what feeds the pixels of the tiles into which its sensor was cut last.

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
        """Of what feeds pixels."""
        return self._bytes

    def posed(self, camera: PlenopticCamera) -> PreparedCamera:
        """The same for a camera that differs in its pose: what feeds pixels is theirs together."""
        other, world = copy.copy(self), world_of(camera, self.record.parts)
        other.record = self.record._replace(
            rotation=None if world is None else world.turn, position=None if world is None else world.shift
        )
        return other

    def cut_into(self, tiles: tuple[Pixels, ...], *, steps: bool) -> None:
        """Let go of what feeds the pixels of other tiles than these, which are rendered in several steps or at once."""
        self._keeps = steps or self._tiles == tiles
        if self._tiles != tiles:
            self._tiles, self._fed, self._bytes = tiles, {}, 0

    def fed_pixels(self, tile: Pixels, *, certain: bool = False) -> FedPixels:
        """What feeds the pixels of a tile; see `pixel_regions.fed_pixels`."""
        found = self._fed.get((tile, certain))
        if found is not None:
            return found
        found = fed_pixels(self.record, tile.centres(self.record), tile.numbers(self.record), certain=certain)
        if self._keeps:
            found = _fitted(found)
            arrays = (*found[:3], *found.regions, *(found.around or ()))
            size = sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))
            if self._bytes + size <= MOST_BYTES:
                self._fed[tile, certain], self._bytes = found, self._bytes + size
        return found


def _fitted(fed: FedPixels) -> FedPixels:
    """The same in arrays without room for more."""
    pieces, first, corners, planes, details = fed.regions
    last = pieces[: first[-1]][-1:]
    ends = [int((last[f"first_{name}"] + last[f"{name}s"]).sum()) for name in ("corner", "plane")]
    details = None if details is None else details[: first[-1]].copy()
    fitted = pieces[: first[-1]].copy(), first, corners[:, : ends[0]].copy(), planes[: ends[1]].copy(), details
    return fed._replace(regions=Regions(*fitted))


class _Kept:
    """What cameras of a sensor share that differ in their pose: what the last one was compiled into."""

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


_kept: LastResult[Sensor, _Kept] = LastResult(_Kept)
_last: LastResult[PlenopticCamera, PreparedCamera] = LastResult(lambda camera: _kept(camera.sensor).prepared(camera))
"""Of one camera only."""
