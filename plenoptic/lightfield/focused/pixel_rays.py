"""Pixels of a focused camera's raw image as rays through the array and the pupil."""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import model_pupil, opening_width, paraxial_cone
from plenoptic.camera.points.centres import CentreMethod, MicrolensCentres, microlens_centres
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.camera.report.illumination import clear_pupil
from plenoptic.core.values import Floats, numbers
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.depth_map import DepthMap
from plenoptic.lightfield.grid_camera import NO_DISTANCES, camera_and_white, grid_argument
from plenoptic.lightfield.matching.micro_images import focused_array
from plenoptic.lightfield.outward_rays import rays_at_array
from plenoptic.lightfield.raw_arrays import RawArrays, raw_arrays
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.rendering.exposure import Exposure

_MIN_RADIUS = 0.25
"""Minimum used radius of a micro image, as a fraction of the distance between micro images, at any overlap."""


class Pupil(NamedTuple):
    """The exit pupil as seen from the array, by Gaussian optics."""

    vergence: float
    """Reciprocal of its distance in front of the array, 1/mm."""
    slope: float
    """Its semi-diameter over that distance; negative for an inverted pupil."""


class PixelRays(NamedTuple):
    """Rays from n pixels of a raw image through the optical centres of their microlenses, in the axes of the array."""

    camera: PlenopticCamera
    array: MicrolensArray
    pupil: Pupil
    raw: RawArrays
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    """Position in the raw image."""
    lens: NDArray[np.int64]
    type: NDArray[np.int64]
    """Type of the microlens."""
    through: Floats
    """(n, 2): intersection with the array, mm."""
    at_pupil: Floats
    """(n, 2): intersection with the pupil relative to its centre, over its distance."""
    to_sensor: Floats
    """Distance from the rear principal plane of the array, mm."""
    has_distances: bool
    """False for the ideal camera of a `MicroImageGrid`, whose lengths are pixels."""

    def at(self, plane: NDArray[Any]) -> Floats:
        """Values of an array (H, W) or (H, W, C) of the raw image at the rays."""
        return np.asarray(plane[self.row, self.column])

    def nearness(self, disparity: Floats) -> Floats:
        """A / (1 + a V) of disparities (n,) in pitches: the image lies a behind the array, V is the vergence."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.to_sensor / (disparity + self.to_sensor * self.pupil.vergence))

    def on_image(self, of_rays: NDArray[Any], empty: float) -> NDArray[Any]:
        """Array (H, W) on the raw image with the values of the rays (n,)."""
        plane = np.full(self.raw.shot.shape[:2], empty, dtype=of_rays.dtype)
        plane[self.row, self.column] = of_rays
        return plane


def paraxial_pupil(camera: PlenopticCamera) -> Pupil:
    """The exit pupil of a camera."""
    cone = paraxial_cone(camera.lens, camera.stop_to_microlenses, camera.wavelength)
    z, size = model_pupil(camera)
    upright = not math.isfinite(z) or size * (camera.stop_to_microlenses - z) > 0
    return Pupil(cone.vergence, cone.slope if upright else -cone.slope)


def pixel_rays(
    shot: Exposure,
    white: Exposure | MicroImageGrid,
    camera: PlenopticCamera | MicroImageGrid | None,
    least_light: float,
    disparity: ArrayLike | DepthMap | None = None,
) -> PixelRays:
    """Rays of all lit pixels of a raw image that see one microlens alone.

    A disparity tells on which side of the array the images of a grid's camera lie.
    """
    has_grid, side = grid_argument(white, camera) is not None, 0.0
    if has_grid:
        if disparity is None:
            raise InvalidValueError(NO_DISTANCES)
        measured = disparity.disparity if isinstance(disparity, DepthMap) else numbers(disparity, "disparity")
        side = -1.0 if np.nansum(np.sign(measured)) < 0 else 1.0
    geometry = camera_and_white(shot, white, camera, side)
    raw, camera = raw_arrays(shot, geometry.white, least_light), geometry.camera
    array, pupil = focused_array(camera), paraxial_pupil(camera)
    first, shape = np.array(raw.first), raw.shot.shape[:2]
    radius = _radius(camera, array, pupil)
    centres = _centres(camera, max(array.pitches))
    geometry.check(shot, centres)
    inside_image = np.flatnonzero(raw.near(centres.pixel, radius))
    centre = centres.pixel[inside_image][:, :, None, None]
    step = np.arange(-math.ceil(radius), math.ceil(radius) + 1)
    # In sensor pixels, so that a region has the same rounding as the whole.
    pixel = np.rint(centre).astype(np.int64) + np.stack(np.meshgrid(step, step, indexing="ij"))
    in_circle = np.hypot(*np.moveaxis(pixel - centre, 1, 0)) < radius
    row, column = np.moveaxis(pixel - first[:, None, None], 1, 0)
    used = in_circle & (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    used[used] = (raw.white[row[used], column[used]] >= raw.least).all(axis=1)
    if not used.any():
        raise InvalidValueError("the image contains no lit micro image; take a larger region, or a lower least_light")
    lens = np.nonzero(used)[0]
    through, slopes, to_sensor = rays_at_array(
        array_axes(camera),
        array,
        np.column_stack([row[used], column[used]]) + first,
        centres.on_array[inside_image][lens],
    )
    types, at_pupil = centres.type[inside_image][lens], through * pupil.vergence - slopes
    place = row[used], column[used], lens, types, through, at_pupil, to_sensor
    return PixelRays(camera, array, pupil, raw, *place, has_distances=not has_grid)


@functools.lru_cache(maxsize=4)
def _centres(camera: PlenopticCamera, margin: float) -> MicrolensCentres:
    """Centres of the micro images of a camera, those of the last cameras kept for further views."""
    return microlens_centres(camera, CentreMethod.CHIEF_RAY, margin=margin)


def _radius(camera: PlenopticCamera, array: MicrolensArray, pupil: Pupil) -> float:
    """Radius in pixels up to which a micro image is free of its neighbours' light.

    Micro images lie d apart and have the radius b slope, traced on the axis. The microlens aperture w adds the blur
    b |V + 1 / b - 1 / f| w / 2.
    """
    b, focal = camera.microlenses_to_sensor, np.array(array.focal_lengths_at(camera.wavelength))
    distance = abs(1.0 + b * pupil.vergence) * min(array.pitches)
    blur = 0.5 * opening_width(array) * float(np.abs(pupil.vergence + 1.0 / b - 1.0 / focal).max())
    slope, _ = clear_pupil(camera.lens, camera.stop_to_microlenses, camera.wavelength)
    free = distance - b * ((abs(pupil.slope) if math.isnan(slope) else slope) + blur)
    return min(max(free, _MIN_RADIUS * distance), 0.5 * distance) / camera.sensor.pixel_pitch
