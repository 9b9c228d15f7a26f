"""Centroids of micro images in a white image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.core.values import Floats, check_has
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice

if TYPE_CHECKING:
    from plenoptic.rendering.exposure import Exposure

_PIXELS = 1 << 16
"""Pixels that are summed together, within the processor's cache."""


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
    pixel = sensor.pixel_of(centres)
    is_finite = np.asarray(np.isfinite(pixel).all(axis=1))
    centre_pixel = np.rint(np.where(is_finite[:, None], pixel, -1e6)).astype(np.int64) - first
    is_complete = (centre_pixel >= reach).all(axis=1) & (centre_pixel + reach < np.array(image.shape)).all(axis=1)
    steps = np.arange(-reach, reach + 1)
    rows, columns = (g.ravel() for g in np.meshgrid(steps, steps, indexing="ij"))
    centroids, chosen = np.full(centres.shape, np.nan), np.flatnonzero(is_finite & is_complete)
    turn = axes.parts.sensor_to_local.turn[:2, :2].T @ axes.parts.array_turn
    chunk_size = max(1, _PIXELS // rows.size)
    for k in range(0, len(chosen), chunk_size):
        chunk = chosen[k : k + chunk_size]
        row, column = centre_pixel[chunk, :1] + rows, centre_pixel[chunk, 1:] + columns
        position = sensor.centre_of(row + first[0], column + first[1])
        offset = (position - centres[chunk, None]) @ turn / spacing
        light = image[row, column] * _in_cell(array, design[chunk], offset)
        with np.errstate(invalid="ignore", divide="ignore"):
            centroids[chunk] = np.einsum("ij,ijk->ik", light, position) / light.sum(axis=1)[:, None]
    return centroids


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
