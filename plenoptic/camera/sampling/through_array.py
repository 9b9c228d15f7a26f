"""Trace aimed samples from the sensor through the microlens array."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.dust import BETWEEN, PlacedDust
from plenoptic.core.values import Floats
from plenoptic.optics.microlens.kernels import to_lens
from plenoptic.optics.microlens.microlens_record import ResponseRecord, SensorPlane
from plenoptic.optics.microlens.model_records import ArrayCrossing


def fill_losses_before_array(
    blocks: Floats, sensor: SensorPlane, response: ResponseRecord | None, dust: tuple[PlacedDust, ...]
) -> None:
    """Attenuate aimed samples by the angular response of pixels and by dust between sensor and array."""
    if response is not None:
        to_lens.fill_pixel_response(blocks, sensor, response)
    for blemish in dust:
        if blemish.site in BETWEEN:
            from plenoptic.optics.microlens.kernels.dust_transmission import fill_aim_transmission

            fill_aim_transmission(blocks, sensor, blemish.height, blemish.axes, blemish.record)


def fill_through_array(
    blocks: Floats, lenslets: NDArray[np.void] | None, camera: CameraRecord, waves: NDArray[np.int64] | None = None
) -> None:
    """Trace aimed samples (see `to_lens`) through the array; they become rays towards the lens, in its axes.

    `waves` are the indices of their wavelengths; None for the camera's wavelength.
    """
    array, sensor = camera.array, camera.sensor.plane
    z_plane = camera.z_plane if camera.frame is None else 0.0
    if array is None or camera.microlenses is None:
        to_lens.fill_straight(blocks, sensor, z_plane)
        return
    if array.walls is not None and lenslets is not None:
        to_lens.fill_walls(blocks, lenslets, array.cell, array.cells)
    camera.microlenses.model.refraction.to_lens(blocks, lenslets, ArrayCrossing(array, sensor, z_plane), waves)
    if camera.frame is not None:
        to_lens.fill_in_lens_axes(blocks, camera.frame)
