"""The pixels of a focused camera's raw image as rays: where they pass the array and the pupil."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.model_pupil import model_pupil
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.camera.report.optics import opening_width, paraxial_cone
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.outward_rays import leaving
from plenoptic.lightfield.raw_arrays import RawArrays
from plenoptic.optics.microlens.array import MicrolensArray

_LEAST = 0.25
"""Of the distance between microlens images: the radius of what is used of them at least, however much they overlap."""


class Pupil(NamedTuple):
    """The exit pupil as the array sees it, by Gaussian optics."""

    vergence: float
    """1 over its distance before the array, 1/mm."""
    slope: float
    """Its semi-diameter over that distance; negative where it stands upside down."""


class PixelRays(NamedTuple):
    """Rays of n pixels through the optical centres of their microlenses, in the local axes of the array."""

    shape: tuple[int, int]
    """Of the raw image."""
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    """In the raw image."""
    lens: NDArray[np.int64]
    type: NDArray[np.int64]
    """Of the microlens."""
    through: Floats
    """(n, 2): where the array is passed, mm."""
    pupil: Floats
    """(n, 2): where the pupil is passed, from its middle, over its distance."""
    to_sensor: Floats
    """From the array's rear principal plane, mm."""

    def at(self, plane: NDArray[Any]) -> Floats:
        """What the raw image (H, W) or (H, W, C) has for the rays."""
        return np.asarray(plane[self.row, self.column])

    def on_image(self, of_rays: NDArray[Any], empty: float) -> NDArray[Any]:
        """What the rays (n,) have, on the raw image (H, W)."""
        plane = np.full(self.shape, empty, dtype=of_rays.dtype)
        plane[self.row, self.column] = of_rays
        return plane


def exit_pupil_seen(camera: PlenopticCamera) -> Pupil:
    """The exit pupil of a camera."""
    cone = paraxial_cone(camera.lens, camera.stop_to_microlenses, camera.wavelength)
    z, size = model_pupil(camera)
    upright = not math.isfinite(z) or size * (camera.stop_to_microlenses - z) > 0
    return Pupil(cone.vergence, cone.slope if upright else -cone.slope)


def pixel_rays(axes: ArrayAxes, array: MicrolensArray, planes: RawArrays, pupil: Pupil) -> PixelRays:
    """Of all lit pixels that see one microlens alone."""
    camera, first = axes.camera, np.array(planes.first)
    shape = np.array(planes.shot.shape[:2])
    radius = _radius(camera, array, pupil)
    centres = microlens_centres(camera, CentreMethod.CHIEF_RAY, margin=max(array.pitches))
    near = np.flatnonzero(
        ((centres.pixel >= first - radius) & (centres.pixel <= first + shape - 1 + radius)).all(axis=1)
    )
    middle = centres.pixel[near][:, :, None, None]
    step = np.arange(-math.ceil(radius), math.ceil(radius) + 1)
    # On the sensor, so that a region has the same rounding as the whole.
    pixel = np.rint(middle).astype(np.int64) + np.stack(np.meshgrid(step, step, indexing="ij"))
    within = np.hypot(*np.moveaxis(pixel - middle, 1, 0)) < radius
    row, column = np.moveaxis(pixel - first[:, None, None], 1, 0)
    known = within & (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    known[known] = (planes.white[row[known], column[known]] >= planes.least).all(axis=1)
    if not known.any():
        raise InvalidValueError("the image holds no lit microlens image; take a larger region, or a lower least_light")
    lens = np.nonzero(known)[0]
    through, slopes, to_sensor = leaving(
        axes, array, np.column_stack([row[known], column[known]]) + first, centres.on_array[near][lens]
    )
    return PixelRays(
        (int(shape[0]), int(shape[1])),
        row[known],
        column[known],
        lens,
        centres.type[near][lens],
        through,
        through * pupil.vergence - slopes,
        to_sensor,
    )


def _radius(camera: PlenopticCamera, array: MicrolensArray, pupil: Pupil) -> float:
    """Pixels up to which the image of a microlens is free of its neighbours' light.

    They lie d apart and have the radius b slope, blurred by the opening w to b |V + 1 / b - 1 / f| w / 2 beyond.
    """
    b, focal = camera.microlenses_to_sensor, np.array(array.focal_lengths_at(camera.wavelength))
    apart = abs(1.0 + b * pupil.vergence) * min(array.pitches)
    blur = 0.5 * opening_width(array) * float(np.abs(pupil.vergence + 1.0 / b - 1.0 / focal).max())
    free = apart - b * (abs(pupil.slope) + blur)
    return min(max(free, _LEAST * apart), 0.5 * apart) / camera.sensor.pixel_pitch
