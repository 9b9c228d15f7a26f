"""Between the axes of the microlens array, those of the lens and those of the sensor, wherever the parts stand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import Assembly, Rigid, assembly, sensor_corners
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats
from plenoptic.optics.lens.elements import is_centred


class ArrayAxes(NamedTuple):
    """A camera's parts seen from its array; *local* axes are those of `Assembly`: z is along the array's normal."""

    camera: PlenopticCamera
    parts: Assembly
    local_to_lens: Rigid
    lens_is_round: bool
    """Whether the local field is the same in all directions from the lens's axis."""

    def local(self, points: Floats) -> Floats:
        """Points (n, 2) of the array, in local axes."""
        return np.asarray(points @ self.parts.array_turn.T + self.parts.array_origin)

    def on_array(self, local: Floats) -> Floats:
        """The other way."""
        return np.asarray((local - self.parts.array_origin) @ self.parts.array_turn)

    def in_lens(self, local: Floats) -> Floats:
        """Local points (n, 2) of the array's front principal plane, in the lens's axes (n, 3)."""
        return self.local_to_lens.points(np.column_stack([local, np.zeros(len(local))]))

    def slopes_of(self, directions: Floats) -> Floats:
        """Local slopes dx/dz, dy/dz (n, 2) of directions (n, 3) in the lens's axes."""
        turned = self.local_to_lens.inverse().directions(directions)
        return np.asarray(turned[:, :2] / turned[:, 2:])

    def on_sensor(self, points: Floats, slopes: Floats) -> Floats:
        """Where rays behind the array meet the sensor: x and y (n, 2) in its own axes, in mm.

        `points` (n, 2) lie on the array's rear principal plane, `slopes` (n, 2) are dx/dz and dy/dz; both local.
        """
        parts = self.parts
        z = np.full(len(points), parts.distance)
        if parts.tilt is not None:
            z = (z + points @ parts.tilt) / (1.0 - slopes @ parts.tilt)
        met = np.column_stack([points + z[:, None] * slopes, z])
        return parts.sensor_to_local.inverse().points(met)[:, :2]

    def sensor_corners(self) -> Floats:
        """(4, 2): corners of the sensor projected onto the array, local."""
        return sensor_corners(self.camera, self.parts)[:, :2]


def array_axes(camera: PlenopticCamera) -> ArrayAxes:
    """The axes of a camera with microlenses."""
    parts = assembly(camera)
    if parts.frame is None:
        to_lens = Rigid(np.eye(3), np.array([0.0, 0.0, parts.z_plane]))
    else:
        to_lens = Rigid(parts.frame[:9].reshape(3, 3), parts.frame[9:])
    centred = all(map(is_centred, camera.lens.elements))
    return ArrayAxes(camera, parts, to_lens, parts.frame is None and centred)
