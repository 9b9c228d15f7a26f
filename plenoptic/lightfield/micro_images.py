"""Micro images of a raw image, and the pairs that see the same points."""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.plane_sweep import Images, Pairs, extrapolate_border, noise_variance
from plenoptic.lightfield.raw_arrays import RawArrays
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import neighbour_steps, rows_of

_MAX_DISTANCE = 3.05
"""Largest distance between compared microlenses, in pitches."""
_MARGIN = 2
"""Margin around a micro image for interpolation, in pixels."""


class MicroImages(NamedTuple):
    """Images of k microlenses, each with as many pixels."""

    images: Images
    pairs: Pairs
    corner: NDArray[np.int64]
    """(k, 2): first pixel of each micro image in the raw image."""
    centre: Floats
    """(k, 2): centre of the micro image, where the chief ray meets the sensor."""
    orthogonal: Floats
    """(k, 2): orthogonal projection of the microlens centre onto the sensor, pixels."""
    on_array: Floats
    """(k, 2): optical centre on the array, mm."""
    index: NDArray[np.int64]  # type: ignore[assignment]
    """(k, 2): lattice indices."""
    type: NDArray[np.int64]
    """(k,)"""
    steps: NDArray[np.int64]
    """Steps from a microlens to its neighbours, in lattice indices."""
    pitch: float
    """Smaller pitch of the microlenses over that of the pixels."""

    def neighbours(self, lens: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n, 4 or 6): microlenses around given ones (n,); -1 for a missing one."""
        return np.stack([rows_of(self.index, self.index[lens] + step) for step in self.steps], axis=1)

    def rows_and_columns(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows (k, n, 1) and columns (k, 1, n) of all pixels in the raw image."""
        side = np.arange(self.images.values.shape[1])
        return self.corner[:, :1, None] + side[:, None], self.corner[:, 1:, None] + side

    def radius(self) -> Floats:
        """Distance of all pixels from the centre of their micro image, (k, n, n), over the pitch."""
        rows, columns = self.rows_and_columns()
        return np.asarray(np.hypot(rows - self.centre[:, :1, None], columns - self.centre[:, 1:, None]) / self.pitch)


def micro_images(camera: PlenopticCamera, array: MicrolensArray, raw: RawArrays) -> MicroImages:
    """Cut a devignetted raw image into micro images."""
    pitch = min(array.pitches) / camera.sensor.pixel_pitch
    centres = microlens_centres(camera, CentreMethod.CHIEF_RAY)
    first, shape = np.array(raw.first), raw.shot.shape[:2]
    inside_image = ((centres.pixel >= first) & (centres.pixel <= first + np.array(shape) - 1)).all(axis=1)
    if np.count_nonzero(inside_image) < 3:
        raise InvalidValueError("the image holds fewer than three microlens images; take a larger region")
    index = centres.index[inside_image]
    # In pixels of the sensor, so that a region has the same bits as the whole.
    centre, orthogonal = centres.pixel[inside_image], _orthogonal_centres(camera, index)
    half = math.ceil(0.5 * pitch) + _MARGIN
    corner = np.rint(centre).astype(np.int64) - half
    side = np.arange(2 * half + 1)
    rows, columns = corner[:, :1, None] + side[:, None], corner[:, 1:, None] + side
    in_circle = np.hypot(rows - centre[:, :1, None], columns - centre[:, 1:, None]) < 0.5 * pitch
    pairs = _pairs(array, index, orthogonal, corner, pitch)
    rows, columns = rows - first[0], columns - first[1]
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    pixel = np.clip(rows, 0, shape[0] - 1), np.clip(columns, 0, shape[1] - 1)
    values, variance = _radiance(raw)
    radiance = values[pixel]
    mask = inside & in_circle & np.isfinite(radiance)
    images = Images(
        extrapolate_border(radiance, mask), mask.astype(np.uint8), noise_variance(radiance, variance[pixel], mask)
    )
    return MicroImages(
        images=images,
        pairs=pairs,
        corner=corner - first,
        centre=centre - first,
        orthogonal=orthogonal - first,
        on_array=centres.on_array[inside_image],
        index=index,
        type=centres.type[inside_image],
        steps=neighbour_steps(array.lattice),
        pitch=pitch,
    )


def _orthogonal_centres(camera: PlenopticCamera, index: NDArray[np.int64]) -> Floats:
    """Orthogonal projections of microlens centres onto the sensor, in pixels."""
    centres = microlens_centres(camera, CentreMethod.ORTHOGONAL, margin=0.5 * max(camera.sensor.size))
    return np.asarray(centres.pixel[rows_of(centres.index, index)])


def _radiance(raw: RawArrays) -> tuple[Floats, Floats]:
    """Mean radiance over the channels, and the variance of its error or 0; nan in the dark."""
    with np.errstate(invalid="ignore", divide="ignore"):
        light = np.where(raw.white >= raw.least, raw.white, np.nan)
        radiance = (raw.shot / light).mean(axis=2)
        if raw.variance is None:
            return radiance, np.zeros_like(radiance)
        return radiance, (raw.variance / light**2).mean(axis=2) / raw.shot.shape[2]


def _pairs(
    array: MicrolensArray, index: NDArray[np.int64], orthogonal: Floats, corner: NDArray[np.int64], pitch: float
) -> Pairs:
    """Pairs of each microlens with those up to three pitches away, nearest first."""
    steps = np.array([step for step in product(range(-4, 5), repeat=2) if step != (0, 0)])
    distance = np.hypot(*(steps @ array.basis).T)
    order = np.argsort(distance, kind="stable")
    steps = steps[order][distance[order] <= _MAX_DISTANCE * min(array.pitches)]
    other = np.stack([rows_of(index, index + step) for step in steps], axis=1)
    lens, step_index = np.nonzero(other >= 0)
    neighbour = other[lens, step_index]
    baseline = orthogonal[neighbour] - orthogonal[lens]
    first = np.concatenate([[0], np.cumsum((other >= 0).sum(axis=1))]).astype(np.int64)
    return Pairs(first, neighbour, baseline + corner[lens] - corner[neighbour], baseline / pitch)
