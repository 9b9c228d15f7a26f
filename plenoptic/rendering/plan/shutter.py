"""Motion while the shutter is open."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.shutter import Shutter
from plenoptic.core.motions.motion import Motion
from plenoptic.core.values import Floats
from plenoptic.errors import SceneError

if TYPE_CHECKING:
    from plenoptic.scene.scene_record import SceneRecord


class OpenShutter(NamedTuple):
    """An exposure with motion of camera or objects."""

    shutter: Shutter
    rows: int
    """Rows of the sensor."""
    columns: int
    camera: Motion | None
    """Motion of the camera; None if it is at rest."""
    motions: tuple[Motion | None, ...]
    """Motions of the scene; None for those at rest during the exposure."""

    def times(self, pixels: NDArray[np.int64], fraction: Floats) -> Floats:
        """(n,), s: times of paths of given pixel numbers, at fractions (n,) of their row's exposure."""
        row_offset = pixels // self.columns - 0.5 * (self.rows - 1)
        return np.asarray(row_offset * self.shutter.row_time + (fraction - 0.5) * self.shutter.duration)


def open_shutter(camera: PlenopticCamera, record: SceneRecord | None) -> OpenShutter | None:
    """Motion during an exposure of a scene; None without motion. Raises SceneError if it cannot be rendered."""
    shutter = camera.shutter
    if shutter is None or record is None:
        return None
    rows, columns = camera.sensor.shape
    half = 0.5 * (shutter.duration + abs(shutter.row_time) * (rows - 1))
    motions = [
        motion if motion is not None and motion.moves(-half, half) else None
        for motion in (shutter.motion, *(record.motions or ()))
    ]
    if not any(motion is not None for motion in motions):
        return None
    _check(record, motions[1:])
    return OpenShutter(shutter, rows, columns, motions[0], tuple(motions[1:]))


def _check(record: SceneRecord, motions: list[Motion | None]) -> None:
    """Raise SceneError if emitters move, or any mesh moves in a scene with alpha masks."""
    instances, geometry = record.instances, record.geometry
    moving = [number for number, motion in enumerate(motions) if motion is not None]
    if not moving or instances is None or instances.moving is None or geometry is None:
        return
    rows = np.isin(instances.moving, moving)
    materials = geometry.triangle_material[instances.first[rows]]
    if record.emission is not None and np.any(record.emission.radiance[materials] > 0):
        raise SceneError(
            "a mesh that emits moves while the shutter is open; let it stand still meanwhile, render single frames "
            "without a shutter, or light the scene by what stands still"
        )
    if record.alpha is not None:
        raise SceneError(
            "a mesh moves while the shutter is open, in a scene with materials that are not opaque everywhere; make "
            "them opaque, or render single frames without a shutter"
        )
