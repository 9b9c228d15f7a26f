"""Centroids of micro images in a white image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.camera.points.window_moments import window_moments
from plenoptic.core.values import Floats, check_has
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice

if TYPE_CHECKING:
    from plenoptic.rendering.exposure import Exposure


def white_centroids(
    axes: ArrayAxes, array: MicrolensArray, white: Exposure, design: Floats, centres: Floats, spacing: float
) -> Floats:
    """Centroids (n, 2) on the sensor of the pixels around each of `centres` (n, 2); nan if some are outside the image.

    The pixels are those in the cell of the microlens with the designed centre `design` (n, 2), scaled by `spacing`:
    each belongs to one microlens, except for rounding.
    """
    sensor = axes.camera.sensor
    image, first = _white_plane(sensor.shape, white)
    reach = int(np.ceil(spacing * array.cell_radius / sensor.pixel_pitch))
    turn = axes.parts.sensor_to_local.turn[:2, :2].T @ axes.parts.array_turn

    def in_cell(part: slice, offset: Floats) -> Floats:
        # Columns run towards -x, see `Sensor.centre_of`.
        from_centre = sensor.pixel_pitch * offset[..., ::-1] * (-1.0, 1.0)
        return _in_cell(array, design[part], from_centre @ turn / spacing).astype(np.float64)

    centroid = first + window_moments(image, sensor.pixel_of(centres) - first, reach, in_cell).centroid
    return sensor.centre_of(centroid[:, 0], centroid[:, 1])


def _in_cell(array: MicrolensArray, design: Floats, offset: Floats) -> NDArray[np.bool_]:
    """True for offsets (n, k, 2) from microlenses, in mm, that lie in their cells."""
    if array.lattice is not Lattice.FREE:
        # Cells are point-symmetric: one of two opposite edges is enough.
        half = array.cell_edges[: len(array.cell_edges) // 2]
        inside = np.ones(offset.shape[:-1], dtype=bool)
        for a, b, distance in half.tolist():
            inside &= np.abs(a * offset[..., 0] + b * offset[..., 1]) <= distance
        return inside
    nearest = array.nearest((design[:, None] + offset).reshape(-1, 2)).reshape(offset.shape)
    return np.asarray((nearest == design[:, None]).all(axis=-1))


def _white_plane(shape: tuple[int, int], white: Exposure) -> tuple[Floats, NDArray[np.int64]]:
    """A white image as one plane, and its first row and column on the sensor."""
    # By its attributes, since cameras do not import exposures.
    check_has(white, "white", "Exposure", "pl.render_white(camera, samples=64)", "image")
    image = np.asarray(white.image, dtype=np.float64).mean(axis=2)
    if white.region is not None:
        return image, np.array([white.region[0], white.region[2]])
    if image.shape != shape:
        raise InvalidValueError(
            f"the white image has {image.shape[0]} x {image.shape[1]} pixels and no region, and the sensor "
            f"{shape[0]} x {shape[1]}; render it with this camera"
        )
    return image, np.zeros(2, dtype=np.int64)
