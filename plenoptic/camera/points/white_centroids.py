"""Centroids of microlens images in a white image."""

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
"""Pixels that are summed together: what stays in the cache."""


def white_centroids(
    axes: ArrayAxes, array: MicrolensArray, white: Exposure, design: Floats, centres: Floats, apart: float
) -> Floats:
    """Centroids (n, 2) on the sensor of the pixels around each of `centres` (n, 2); nan where the image holds not all.

    The pixels are those in the cell of the microlens with the designed centre `design` (n, 2), enlarged by `apart`:
    each belongs to one microlens, but for rounding.
    """
    sensor = axes.camera.sensor
    image, first = _white_plane(sensor.shape, white)
    reach = int(np.ceil(apart * array.cell_radius / sensor.pixel_pitch))
    pixel = sensor.pixel_of(centres)
    finite = np.asarray(np.isfinite(pixel).all(axis=1))
    middle = np.rint(np.where(finite[:, None], pixel, -1e6)).astype(np.int64) - first
    whole = (middle >= reach).all(axis=1) & (middle + reach < np.array(image.shape)).all(axis=1)
    steps = np.arange(-reach, reach + 1)
    rows, columns = (g.ravel() for g in np.meshgrid(steps, steps, indexing="ij"))
    centroids, chosen = np.full(centres.shape, np.nan), np.flatnonzero(finite & whole)
    turn = axes.parts.sensor_to_local.turn[:2, :2].T @ axes.parts.array_turn
    each = max(1, _PIXELS // rows.size)
    for k in range(0, len(chosen), each):
        these = chosen[k : k + each]
        row, column = middle[these, :1] + rows, middle[these, 1:] + columns
        place = sensor.centre_of(row + first[0], column + first[1])
        offset = (place - centres[these, None]) @ turn / apart
        light = image[row, column] * _in_cell(array, design[these], offset)
        with np.errstate(invalid="ignore", divide="ignore"):
            centroids[these] = np.einsum("ij,ijk->ik", light, place) / light.sum(axis=1)[:, None]
    return centroids


def _in_cell(array: MicrolensArray, design: Floats, offset: Floats) -> NDArray[np.bool_]:
    """True for offsets (n, k, 2) from microlenses, in mm, that lie in their cells."""
    if array.lattice is not Lattice.FREE:
        # Cells are their own mirror image: one of two opposite edges tells of both.
        half = array.cell_edges[: len(array.cell_edges) // 2]
        inside = np.ones(offset.shape[:-1], dtype=bool)
        for a, b, distance in half.tolist():
            inside &= np.abs(a * offset[..., 0] + b * offset[..., 1]) <= distance
        return inside
    nearest = array.nearest((design[:, None] + offset).reshape(-1, 2)).reshape(offset.shape)
    return np.asarray((nearest == design[:, None]).all(axis=-1))


def _white_plane(shape: tuple[int, int], white: Exposure) -> tuple[Floats, NDArray[np.int64]]:
    """A white image as one plane, and the row and column of the sensor at which it begins."""
    # By what it has, since cameras know no exposures.
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
