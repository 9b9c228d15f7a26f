"""Forward tracing from the main lens to the sensor: records of array and sensor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import Assembly, sensor_corners
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats
from plenoptic.optics.lens.pupil.exit_pupil import rear_reach
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.forward_record import differs_forward, forward_record
from plenoptic.optics.microlens.imperfections import extreme_factors, largest_offset
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.microlens_record import ArrayRecord, SensorPlane
from plenoptic.optics.microlens.model_records import ArrayCrossing

_REACH_FACTOR = 1.25
"""Factor on the distance from the axis up to which microlenses are listed, for thick ones."""


class ForwardArray(NamedTuple):
    """Array and sensor for forward tracing; lengths in mm, in the local axes of `Assembly`."""

    parts: Assembly
    microlenses: MicrolensArray | None
    array: ArrayRecord | None
    differs: bool
    """True if microlenses differ or do not fill their cells."""
    sensor: SensorPlane


def forward_array(camera: PlenopticCamera, parts: Assembly) -> ForwardArray:
    """Compile array and sensor for forward tracing."""
    array, sensor = camera.microlenses, SensorPlane(parts.distance, parts.tilt, _to_sensor(parts))
    if array is None:
        return ForwardArray(parts, None, None, False, sensor)
    reach = 0.0 if array.lattice is not Lattice.FREE and array.imperfections is None else _reach(camera, parts, array)
    record = forward_record(
        array, turn=parts.array_turn, origin=parts.array_origin, reach=reach, wavelength=camera.wavelength
    )
    return ForwardArray(parts, array, record, differs_forward(record), sensor)


def _to_sensor(parts: Assembly) -> Floats | None:
    """Matrix from points x, y, 1 of the sensor in local axes to its own; None if they are the same."""
    turn, shift = parts.sensor_to_local.turn[:2, :2], parts.sensor_to_local.shift[:2]
    if np.array_equal(turn, np.eye(2)) and not shift.any():
        return None
    back = np.linalg.inv(turn)
    return np.column_stack([back, -back @ shift])


def _reach(camera: PlenopticCamera, parts: Assembly, array: MicrolensArray) -> float:
    """Upper bound on the distance from the origin at which light that reaches the sensor passes the array, in mm.

    A ray comes from within a + b rho of the axis, `pupil_distance` in front of the array, and is deviated by at most
    the strongest power times the largest height in a cell. All FREE lenses are listed.
    """
    a, b = rear_reach(camera.lens, parts.z_plane, camera.wavelength)
    last = parts.local_to_lens.inverse().points(np.array([0.0, 0.0, float(camera.lens.vertices[-1])]))
    corners = sensor_corners(camera, parts)
    distance, pupil_distance = float(corners[:, 2].max()), -float(last[2])
    height = array.cell_radius + largest_offset(array.imperfections)
    power = max(1.0 / abs(f) for f in array.focal_lengths) / max(extreme_factors(array.imperfections)[0], 0.1)
    lateral = float(np.hypot(*corners[:, :2].T).max()) + distance * (
        (a + float(np.hypot(*last[:2]))) / pupil_distance + height * power
    )
    reach = _REACH_FACTOR * lateral / max(1.0 + distance * (1.0 - b) / pupil_distance, 0.1) + 2.0 * array.cell_radius
    if array.centres is not None:
        reach = max(reach, 1.01 * float(np.abs(array.centres).max()))
    return reach


def fill_through_array_forward(blocks: Floats, forward: ForwardArray) -> None:
    """Trace rays behind the lens, in its axes, to points on the sensor; see `to_sensor`."""
    from plenoptic.optics.microlens.kernels.to_sensor import fill_in_array_axes, fill_straight_forward

    parts, array, sensor = forward.parts, forward.array, forward.sensor
    z = parts.z_plane
    if array is None or forward.microlenses is None:
        fill_straight_forward(blocks, sensor._replace(distance=z + parts.distance))
        return
    if parts.frame is not None:
        fill_in_array_axes(blocks, parts.frame)
        z = 0.0
    forward.microlenses.model.refraction.to_sensor(blocks, ArrayCrossing(array, sensor, z), forward.differs)
