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
    from plenoptic.scene.compile import SceneRecord


class OpenShutter(NamedTuple):
    """An exposure in which something moves."""

    shutter: Shutter
    rows: int
    """Of the sensor."""
    columns: int
    camera: Motion | None
    """None where it stands still meanwhile, as the next ones."""
    motions: tuple[Motion | None, ...]
    """Those of the scene."""

    def times(self, pixels: NDArray[np.int64], share: Floats) -> Floats:
        """(n,), s: when paths of pixels with these numbers are, at shares (n,) of their row's exposure."""
        below = pixels // self.columns - 0.5 * (self.rows - 1)
        return np.asarray(below * self.shutter.row_time + (share - 0.5) * self.shutter.duration)


def open_shutter(camera: PlenopticCamera, record: SceneRecord | None) -> OpenShutter | None:
    """Motion during the exposure of a scene; None where nothing moves. Raises an error where it cannot be rendered."""
    shutter = camera.shutter
    if shutter is None or record is None:
        return None
    rows, columns = camera.sensor.shape
    half = 0.5 * (shutter.duration + abs(shutter.row_time) * (rows - 1))
    found = [
        motion if motion is not None and motion.moves(-half, half) else None
        for motion in (shutter.motion, *(record.motions or ()))
    ]
    if not any(motion is not None for motion in found):
        return None
    _check(record, found[1:])
    return OpenShutter(shutter, rows, columns, found[0], tuple(found[1:]))


def _check(record: SceneRecord, motions: list[Motion | None]) -> None:
    """Raise where objects move that shine, or in a scene of which paths pass some surfaces by chance."""
    instances, geometry = record.instances, record.geometry
    moved = [number for number, motion in enumerate(motions) if motion is not None]
    if not moved or instances is None or instances.moving is None or geometry is None:
        return
    rows = np.isin(instances.moving, moved)
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
