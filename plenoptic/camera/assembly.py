"""Positions of lens, array and sensor: from their placements to the axes in which rays are traced.

A placement is the rigid motion from a part's own axes to those of its designed position: a point p of the part lies at
shift + rotation @ p from it. The lens turns about the centre of its iris, the array about the intersection of the axis
with its front principal plane, the sensor about its centre.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.elements import shares_axis
from plenoptic.optics.lens.placement import Placement

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

_NO_TILT = 1e-14
"""Sine of a tilt below which it is rounding error."""


class Rigid(NamedTuple):
    """A rigid motion: p goes to turn @ p + shift."""

    turn: Floats
    shift: Floats

    def of(self, inner: Rigid) -> Rigid:
        """Composition: the motion `inner`, then this one."""
        return Rigid(self.turn @ inner.turn, self.turn @ inner.shift + self.shift)

    def inverse(self) -> Rigid:
        """Inverse motion."""
        return Rigid(self.turn.T, -self.turn.T @ self.shift)

    def points(self, points: Floats) -> Floats:
        """Transform points (..., 3)."""
        return _rotate(points, self.turn) + self.shift

    def directions(self, directions: Floats) -> Floats:
        """Rotate directions (..., 3)."""
        return _rotate(directions, self.turn)


def _rotate(vectors: Floats, turn: Floats) -> Floats:
    """Vectors (..., k) times `turn`; as they are for the identity, where products cost more than all that follows."""
    return vectors if np.array_equal(turn, np.eye(len(turn))) else np.asarray(vectors @ turn.T)


def rigid(placement: Placement | None, z: float) -> Rigid:
    """Rigid motion from a part's own axes to the camera's, for a part designed to stand at (0, 0, z)."""
    if placement is None:
        return Rigid(np.eye(3), np.array([0.0, 0.0, z]))
    return Rigid(np.asarray(placement.rotation), np.asarray(placement.shift) + np.array([0.0, 0.0, z]))


class Assembly(NamedTuple):
    """Parts of a camera in the axes in which its array is traced: the *local* axes.

    Where the array's plane is perpendicular to the lens's axis, the local axes are those of the lens, with z = 0 at the
    array; otherwise they are the array's own.
    """

    lens_to_camera: Rigid | None
    """None if the lens stands as designed."""
    frame: Floats | None
    """(12,) rotation row by row and shift from local to lens axes; None if they differ in
    `z_plane` alone."""
    z_plane: float
    """z in mm of the start of rays towards the lens, in its axes, of the array's front principal plane, at its
    centre if it is tilted; without microlenses, of the last lens vertex."""
    array_turn: Floats
    """(2, 2): the array's axes in the local ones."""
    array_origin: Floats
    """(2,) the array's centre in local axes."""
    sensor_to_local: Rigid
    """z is measured from the array's rear principal plane."""
    distance: float
    """From the rear principal plane to the sensor along the local axis, in mm."""
    tilt: Floats | None
    """(2,): slope of that distance along local x and y; None for a sensor parallel to the array."""

    @property
    def local_to_lens(self) -> Rigid:
        """Rigid motion from local axes to those of the lens."""
        if self.frame is None:
            return Rigid(np.eye(3), np.array([0.0, 0.0, self.z_plane]))
        return Rigid(self.frame[:9].reshape(3, 3), self.frame[9:])


def assembly(camera: PlenopticCamera) -> Assembly:
    """Positions of the parts of a camera; without microlenses, local axes are those of the lens at its last vertex."""
    lens = rigid(camera.lens_placement, 0.0)
    sensor = lens.inverse().of(rigid(camera.sensor_placement, camera.z_sensor))
    frame, turn, origin = None, np.eye(2), np.zeros(2)
    if camera.microlenses is None:
        z_plane = float(camera.lens.vertices[-1])
        local_from_lens, behind = Rigid(np.eye(3), np.array([0.0, 0.0, -z_plane])), 0.0
    else:
        array = lens.inverse().of(rigid(camera.microlenses_placement, camera.stop_to_microlenses))
        z_plane, behind = float(array.shift[2]), camera.microlenses.principal_separation
        if math.hypot(array.turn[0, 2], array.turn[1, 2]) < _NO_TILT:
            local_from_lens = Rigid(np.eye(3), np.array([0.0, 0.0, -z_plane]))
            turn, origin = array.turn[:2, :2].copy(), array.shift[:2].copy()
        else:
            local_from_lens = array.inverse()
            frame = np.concatenate([array.turn.ravel(), array.shift])
    sensor = local_from_lens.of(sensor)
    sensor = sensor._replace(shift=sensor.shift - np.array([0.0, 0.0, behind]))
    distance, tilt = plane_coefficients(sensor)
    return Assembly(
        None if camera.lens_placement is None else lens, frame, z_plane, turn, origin, sensor, distance, tilt
    )


def lens_to_world(camera: PlenopticCamera, parts: Assembly) -> Rigid | None:
    """Rigid motion from the lens's axes to the world; None if they are the same."""
    if camera.pose is None:
        return parts.lens_to_camera
    pose = Rigid(np.asarray(camera.pose.rotation), np.asarray(camera.pose.position))
    return pose if parts.lens_to_camera is None else pose.of(parts.lens_to_camera)


def plane_coefficients(sensor: Rigid) -> tuple[float, Floats | None]:
    """Plane of the sensor as distance and slopes: z = distance + tilt . (x, y)."""
    normal = sensor.turn[:, 2]
    slopes = -normal[:2] / normal[2]
    if float(np.hypot(*slopes)) < _NO_TILT:
        return float(sensor.shift[2]), None
    return float(sensor.shift[2] - slopes @ sensor.shift[:2]), np.ascontiguousarray(slopes)


def sensor_corners(camera: PlenopticCamera, parts: Assembly, beyond: float = 0.0) -> Floats:
    """Corners (4, 3) of the sensor, enlarged by `beyond` mm on each side, in local axes, in mm."""
    height, width = camera.sensor.size
    x, y = 0.5 * width + beyond, 0.5 * height + beyond
    corners = np.array([[i, j, 0.0] for i in (-x, x) for j in (-y, y)])
    return parts.sensor_to_local.points(corners)


def check_assembly(camera: PlenopticCamera) -> None:
    """Raise an InvalidValueError if a corner of the sensor touches the array, or either is inside the lens."""
    parts = assembly(camera)
    clearance = float(sensor_corners(camera, parts)[:, 2].min())
    if parts.sensor_to_local.turn[2, 2] <= 0 or not clearance > 0:
        raise InvalidValueError(
            f"as built, a corner of the sensor is {clearance:g} mm behind the part in front of it; it must be "
            "above 0: reduce tilts and shifts, or give them in radians and mm"
        )
    z_last = float(camera.lens.vertices[-1])
    if camera.microlenses is not None and not parts.z_plane > z_last:
        raise InvalidValueError(
            f"as built, the array is at z = {parts.z_plane:g} mm of the lens, whose last vertex is at {z_last:g}; "
            "reduce the shift along the axis"
        )


class ArrayAxes(NamedTuple):
    """Transforms between array, lens and sensor of points on the array and slopes, in the local axes of `Assembly`."""

    camera: PlenopticCamera
    parts: Assembly

    @property
    def lens_is_centred(self) -> bool:
        """True if all elements are centred, and the local axes are those of the lens."""
        return self.parts.frame is None and all(map(shares_axis, self.camera.lens.elements))

    def local(self, points: Floats) -> Floats:
        """Transform points (n, 2) of the array to local axes."""
        return _rotate(points, self.parts.array_turn) + self.parts.array_origin

    def on_array(self, local: Floats) -> Floats:
        """Transform local points (n, 2) to the array's axes."""
        return _rotate(local - self.parts.array_origin, self.parts.array_turn.T)

    def in_lens(self, local: Floats) -> Floats:
        """Transform local points (n, 2) of the array's front principal plane to the lens's axes (n, 3)."""
        return self.parts.local_to_lens.points(np.column_stack([local, np.zeros(len(local))]))

    def slopes_of(self, directions: Floats) -> Floats:
        """Local slopes dx/dz, dy/dz (n, 2) of directions (n, 3) in the lens's axes."""
        turned = self.parts.local_to_lens.inverse().directions(directions)
        return np.asarray(turned[:, :2] / turned[:, 2:])

    def on_sensor(self, points: Floats, slopes: Floats) -> Floats:
        """Intersections of rays behind the array with the sensor: x and y (n, 2) in its own axes, in mm.

        `points` (n, 2) lie on the array's rear principal plane, `slopes` (n, 2) are dx/dz and dy/dz; both local.
        """
        parts = self.parts
        z = np.full(len(points), parts.distance)
        if parts.tilt is not None:
            z = (z + points @ parts.tilt) / (1.0 - slopes @ parts.tilt)
        hits = np.column_stack([points + z[:, None] * slopes, z])
        return parts.sensor_to_local.inverse().points(hits)[:, :2]


def array_axes(camera: PlenopticCamera) -> ArrayAxes:
    """Transforms of a camera with microlenses."""
    return ArrayAxes(camera, assembly(camera))
