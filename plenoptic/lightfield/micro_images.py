"""A raw image taken apart into the images of its microlenses, and which of them show the same points."""

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
from plenoptic.lightfield.plane_sweep import Images, Pairs, extrapolate_border, texture_floor
from plenoptic.lightfield.raw_arrays import RawArrays
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import neighbour_steps, rows_of

_RINGS = 3.05
"""Pitches up to which microlenses are compared."""
_ROOM = 2
"""Pixels around the image of a microlens, for reading between pixels."""


class MicroImages(NamedTuple):
    """The images of k microlenses, each with as many pixels."""

    images: Images
    pairs: Pairs
    corner: NDArray[np.int64]
    """(k, 2): the first pixel of each in the raw image."""
    centre: Floats
    """(k, 2): its middle, where the chief ray falls."""
    straight: Floats
    """(k, 2): the microlens itself, straight onto the sensor."""
    on_array: Floats
    """(k, 2): its optical centre on the array, mm."""
    index: NDArray[np.int64]  # type: ignore[assignment]
    """(k, 2): lattice indices."""
    type: NDArray[np.int64]
    """(k,)"""
    steps: NDArray[np.int64]
    """From a microlens to its neighbours, in lattice indices."""
    pitch: float
    """Of the microlenses, the smaller one, over that of the pixels."""

    def neighbours(self, lens: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n, 4 or 6): the microlenses around some (n,); -1 where one is missing."""
        return np.stack([rows_of(self.index, self.index[lens] + step) for step in self.steps], axis=1)

    def rows_and_columns(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Of all pixels in the raw image, (k, n, 1) and (k, 1, n)."""
        side = np.arange(self.images.values.shape[1])
        return self.corner[:, :1, None] + side[:, None], self.corner[:, 1:, None] + side

    def radius(self) -> Floats:
        """Distance of all pixels from the middle of their microlens's image, (k, n, n), over the pitch."""
        rows, columns = self.rows_and_columns()
        return np.asarray(np.hypot(rows - self.centre[:, :1, None], columns - self.centre[:, 1:, None]) / self.pitch)


def micro_images(camera: PlenopticCamera, array: MicrolensArray, planes: RawArrays) -> MicroImages:
    """Take a devignetted raw image apart."""
    pitch = min(array.pitches) / camera.sensor.pixel_pitch
    centres = microlens_centres(camera, CentreMethod.CHIEF_RAY)
    first, shape = np.array(planes.first), planes.shot.shape[:2]
    near = ((centres.pixel >= first) & (centres.pixel <= first + np.array(shape) - 1)).all(axis=1)
    if np.count_nonzero(near) < 3:
        raise InvalidValueError("the image holds fewer than three microlens images; take a larger region")
    index = centres.index[near]
    # In pixels of the sensor, so that a region has the bits of the whole.
    centre, straight = centres.pixel[near], _straight(camera, index)
    half = math.ceil(0.5 * pitch) + _ROOM
    corner = np.rint(centre).astype(np.int64) - half
    side = np.arange(2 * half + 1)
    rows, columns = corner[:, :1, None] + side[:, None], corner[:, 1:, None] + side
    within = np.hypot(rows - centre[:, :1, None], columns - centre[:, 1:, None]) < 0.5 * pitch
    pairs = _pairs(array, index, straight, corner, pitch)
    rows, columns = rows - first[0], columns - first[1]
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    place = np.clip(rows, 0, shape[0] - 1), np.clip(columns, 0, shape[1] - 1)
    values, variance = _radiance(planes)
    found = values[place]
    known = inside & within & np.isfinite(found)
    images = Images(
        extrapolate_border(found, known), known.astype(np.uint8), texture_floor(found, variance[place], known)
    )
    return MicroImages(
        images=images,
        pairs=pairs,
        corner=corner - first,
        centre=centre - first,
        straight=straight - first,
        on_array=centres.on_array[near],
        index=index,
        type=centres.type[near],
        steps=neighbour_steps(array.lattice),
        pitch=pitch,
    )


def _straight(camera: PlenopticCamera, index: NDArray[np.int64]) -> Floats:
    """Where microlenses lie straight behind the array, in pixels of the sensor."""
    found = microlens_centres(camera, CentreMethod.ORTHOGONAL, margin=0.5 * max(camera.sensor.size))
    return np.asarray(found.pixel[rows_of(found.index, index)])


def _radiance(planes: RawArrays) -> tuple[Floats, Floats]:
    """Radiance of pixels, the mean over channels, and the variance of its error or 0; nan in the dark."""
    with np.errstate(invalid="ignore", divide="ignore"):
        light = np.where(planes.white >= planes.least, planes.white, np.nan)
        radiance = (planes.shot / light).mean(axis=2)
        if planes.variance is None:
            return radiance, np.zeros_like(radiance)
        return radiance, (planes.variance / light**2).mean(axis=2) / planes.shot.shape[2]


def _pairs(
    array: MicrolensArray, index: NDArray[np.int64], straight: Floats, corner: NDArray[np.int64], pitch: float
) -> Pairs:
    """Each microlens with those up to three pitches away, nearest first."""
    steps = np.array([step for step in product(range(-4, 5), repeat=2) if step != (0, 0)])
    apart = np.hypot(*(steps @ array.basis).T)
    order = np.argsort(apart, kind="stable")
    steps = steps[order][apart[order] <= _RINGS * min(array.pitches)]
    other = np.stack([rows_of(index, index + step) for step in steps], axis=1)
    lens, place = np.nonzero(other >= 0)
    chosen = other[lens, place]
    between = straight[chosen] - straight[lens]
    first = np.concatenate([[0], np.cumsum((other >= 0).sum(axis=1))]).astype(np.int64)
    return Pairs(first, chosen, between + corner[lens] - corner[chosen], between / pitch)
