"""What part of the microlens plane feeds each pixel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.record import TRIANGLE, FedPixels, Regions
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.record import MICROLENS


def pixel_centres(camera: CameraRecord, rows: tuple[int, int], columns: tuple[int, int]) -> Floats:
    """(n, 2): centres of the pixels of a rectangle (first and end row and column), row by row: local x and y in mm."""
    sensor, placed = camera.sensor, camera.parts.sensor_to_local
    x = -(np.arange(*columns) + 0.5 - sensor.columns / 2) * sensor.pitch
    y = (np.arange(*rows) + 0.5 - sensor.rows / 2) * sensor.pitch
    on_sensor = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.ascontiguousarray(on_sensor @ placed.turn[:2, :2].T + placed.shift[:2])


MOST_CELLS = 100_000
"""Microlenses that may feed one pixel; beyond it, a render would not end."""


def cells_per_pixel(camera: CameraRecord) -> float:
    """About how many microlenses are looked at for each pixel, at least 1; an InvalidValueError for far too many."""
    array, pupil = camera.array, camera.pupil
    if array is None:
        return 1.0
    distance = camera.z_plane - pupil.z
    ratio = distance / camera.sensor.plane.distance
    bend = 0.0 if pupil.pinhole else float(np.abs(1.0 + ratio - distance * array.lattice.powers).max())
    reach = float(pupil.reach.max()) + pupil.margin + bend * array.opening.radius
    search = (reach + ratio * camera.sensor.pitch) / (1.0 + ratio) + array.opening.radius
    area, listed = abs(float(np.linalg.det(array.lattice.basis))), array.listed
    if listed is not None:
        area = float(listed.bins.width**2 * (len(listed.bins.first) - 1) / max(len(listed.lenses), 1))
    count = 1.0 + np.pi * search**2 / area
    if count > MOST_CELLS:
        raise InvalidValueError(
            f"each pixel sees about {count:.3g} microlenses, and the limit is {MOST_CELLS}; their pitch is too small, "
            "or their images overlap too much: check the units, close the stop or reduce microlenses_to_sensor"
        )
    return count


def feeding_regions(camera: CameraRecord, pixels: Floats, margin: float) -> Regions:
    """Triangles that cover what feeds each pixel's points up to `margin` mm from its centre; see `cells_per_pixel`."""
    from plenoptic.camera.sampling.kernels import pixel_regions

    cells_per_pixel(camera)
    array, plane = camera.array, camera.sensor.plane
    first, room = np.zeros(len(pixels) + 1, dtype=np.int64), 16 * len(pixels)
    while True:
        details = np.empty(room, MICROLENS) if array is not None and array.differs else None
        regions = Regions(np.empty(room, TRIANGLE), first, details)
        if array is None:
            needed = pixel_regions.fill_pupil_regions(regions, pixels, camera.pupil)
        else:
            needed = pixel_regions.fill_cell_regions(regions, pixels, margin, plane, array, camera.pupil)
        if needed <= room:
            return Regions(regions.triangles[:needed], first, None if details is None else details[:needed])
        room = needed


def fed_pixels(camera: CameraRecord, pixels: Floats, number: NDArray[np.int64]) -> FedPixels:
    """What feeds pixels whose centres (n, 2) and numbers (n,) on the sensor are given."""
    triangles, first, details = feeding_regions(camera, pixels, 0.5 * math.sqrt(2) * camera.sensor.pitch)
    fed = np.flatnonzero(np.diff(first))
    regions = Regions(triangles, np.append(first[fed], first[-1]), details)
    return FedPixels(fed, number[fed], np.ascontiguousarray(pixels[fed]), regions)
