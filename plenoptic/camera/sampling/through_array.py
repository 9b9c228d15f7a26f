"""Aimed samples on their way from the sensor to behind the array."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.dust import BETWEEN, PlacedDust
from plenoptic.camera.record import CameraRecord
from plenoptic.core.values import Floats
from plenoptic.optics.microlens.kernels import to_lens
from plenoptic.optics.microlens.microlens_record import ResponseRecord, SensorPlane
from plenoptic.optics.microlens.model_rules import ArrayCrossing


def fill_dimmed_before_array(
    blocks: Floats, sensor: SensorPlane, response: ResponseRecord | None, dust: tuple[PlacedDust, ...]
) -> None:
    """Pixels dim aimed samples by their direction, and dust between sensor and array does."""
    if response is not None:
        to_lens.fill_pixel_response(blocks, sensor, response)
    for placed in dust:
        if placed.site in BETWEEN:
            from plenoptic.optics.microlens.kernels.dust_transmission import fill_aim_transmission

            fill_aim_transmission(blocks, sensor, placed.height, placed.axes, placed.record)


def fill_through_array(
    blocks: Floats, own: NDArray[np.void] | None, camera: CameraRecord, waves: NDArray[np.int64] | None = None
) -> None:
    """Aimed samples (see `to_lens`) become rays on their way to the lens, in its axes.

    `waves` are the numbers of the wavelengths that they have drawn; None for the camera's.
    """
    array, sensor = camera.array, camera.sensor.plane
    z_plane = camera.z_plane if camera.frame is None else 0.0
    if array is None or camera.microlenses is None:
        to_lens.fill_straight(blocks, sensor, z_plane)
        return
    if array.walls is not None and own is not None:
        to_lens.fill_walls(blocks, own, array.cell, array.cells)
    camera.microlenses.model.rules.to_lens(blocks, own, ArrayCrossing(array, sensor, z_plane), waves)
    if camera.frame is not None:
        to_lens.fill_in_lens_axes(blocks, camera.frame)
