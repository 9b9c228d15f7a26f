"""Micro images of a raw image, prepared for matching."""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import CameraKind, kind_of
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.matching.image_stack import (
    MIN_MARGIN,
    ImageStack,
    blur_levels,
    extrapolate_border,
    noise_variance,
)
from plenoptic.lightfield.outward_rays import aperture_variance
from plenoptic.lightfield.pinhole_model import PinholeModel, trace_displacement
from plenoptic.lightfield.raw_arrays import RawArrays
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice, neighbour_steps, rows_of

_MAX_DISTANCE = 3.05
"""Largest distance between compared microlenses, in pitches."""
_DEPTH_RATIO = 1.06
"""Ratio of the virtual depths of neighbouring planes."""
_MAX_COMPARED = 18
"""Microlenses with which one is compared at most: two rings of a hexagonal lattice."""
_MAX_SHIFT_PITCHES = 0.6
"""Largest shift of a point's image between two compared microlenses, in pitches."""
_MIN_LIGHT, _MIN_OWN_LIGHT = 0.7, 0.9
"""Minimum light of a compared pixel: relative to the best-lit pixel of its microlens, and from its own microlens
relative to all light on the pixel.
"""
_CENTRE_RADIUS = 0.25
"""Distance from the centre of a micro image, in pitches, within which no neighbouring microlens adds light."""
_ERROR_RATIO = 1.4
"""Ratio of the error of a disparity to that of independent residuals, since neighbouring pixels share their blur."""
_SHIFT_ERROR = 0.016
"""Systematic error of the largest shift in pixels; micro images have texture as fine as their pixels."""
_BLUR_STEP, _BLUR_LEVELS = 0.5, 5
"""Step of the variance of added blur, pixel^2, and the number of steps."""


class MicroImages(NamedTuple):
    """Images of k microlenses, each with as many pixels, n of which are lit."""

    stack: ImageStack
    """Its mask leaves out lit pixels that the main lens vignettes, or on which neighbouring microlenses add light."""
    lit: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]
    """Microlens, row and column in the stack of the lit pixels, (n,) each."""
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    """(n,): position of the lit pixels in the raw image."""
    orthogonal: Floats
    """(k, 2): orthogonal projection of the microlens centre onto the sensor, in pixels of the raw image."""
    on_array: Floats
    """(k, 2): optical centre on the array, mm."""
    index: NDArray[np.int64]  # type: ignore[assignment]
    """(k, 2): lattice indices."""
    type: NDArray[np.int64]
    """(k,): type of the microlens."""
    steps: NDArray[np.int64]
    """Steps from a microlens to its neighbours, in lattice indices."""

    def neighbours(self) -> NDArray[np.int64]:
        """(k, 4 or 6): microlenses around each one; -1 for a missing one."""
        return np.stack([rows_of(self.index, self.index + step) for step in self.steps], axis=1)


def focused_array(camera: PlenopticCamera) -> MicrolensArray:
    """The microlenses of a focused camera; raise InvalidValueError for another camera."""
    array = camera.microlenses
    if array is None:
        raise InvalidValueError("the camera has no microlenses, and nothing to match; use one with a MicrolensArray")
    if array.lattice is Lattice.FREE:
        raise InvalidValueError("the microlenses lie on no lattice, so that their neighbours are unknown")
    if array.model.focuses and _kinds(camera, array) == {CameraKind.PLENOPTIC_1}:
        raise InvalidValueError(
            "the microlenses are focused at infinity: their images show the pupil, and no scene to match; decode views "
            "by pl.lightfield.decode(shot, white), and match or refocus them"
        )
    return array


def image_side(camera: PlenopticCamera) -> float:
    """Return 1 if microlenses of any type are focused behind the array, -1 if all are focused in front of it."""
    return 1.0 if CameraKind.GALILEAN in _kinds(camera, focused_array(camera)) else -1.0


def _kinds(camera: PlenopticCamera, array: MicrolensArray) -> set[CameraKind]:
    return {kind_of(camera, focal_length) for focal_length in array.focal_lengths}


def micro_images(
    model: PinholeModel, raw: RawArrays, virtual_depths: tuple[float, float], window_radius: int
) -> MicroImages:
    """Cut a devignetted raw image into micro images, to be matched within a range of virtual depths of one sign."""
    camera, array = model.axes.camera, model.array
    pitch = min(array.pitches) / camera.sensor.pixel_pitch
    centres = microlens_centres(camera, CentreMethod.CHIEF_RAY)
    first, shape, inside_image = np.array(raw.first), raw.shot.shape[:2], raw.near(centres.pixel, 0.0)
    if np.count_nonzero(inside_image) < 3:
        raise InvalidValueError("the image holds fewer than three micro images; take a larger region")
    index, types, on_array = centres.index[inside_image], centres.type[inside_image], centres.on_array[inside_image]
    # In pixels of the sensor, so that a region has the same bits as the whole.
    centre, orthogonal = centres.pixel[inside_image], _orthogonal_centres(camera, index)
    half = math.ceil(0.5 * pitch) + max(MIN_MARGIN, window_radius)
    corner = np.rint(centre).astype(np.int64) - half
    side = np.arange(2 * half + 1)
    rows, columns = corner[:, :1, None] + side[:, None], corner[:, 1:, None] + side
    radii = np.hypot(rows - centre[:, :1, None], columns - centre[:, 1:, None])
    rows, columns = rows - first[0], columns - first[1]
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    pixel = np.clip(rows, 0, shape[0] - 1), np.clip(columns, 0, shape[1] - 1)
    values, variance = (plane[pixel] for plane in _radiance(raw))
    mask = inside & (radii < 0.5 * pitch) & np.isfinite(values)
    lens, y, x = np.nonzero(mask)
    far, near = sorted(virtual_depths, key=abs, reverse=True)
    stack = ImageStack(
        values.astype(np.float32),
        mask.astype(np.uint8),
        np.zeros(len(values)),
        *_pairs(array, index, orthogonal, corner, pitch),
        disparities=pitch / np.geomspace(far, near, 2 + int(np.log(far / near) / np.log(_DEPTH_RATIO))),
        window_radius=window_radius,
        max_compared=_MAX_COMPARED,
        max_shift=_MAX_SHIFT_PITCHES * pitch,
        reach=(_DEPTH_RATIO - 1.0, 0.0),
        error_ratio=_ERROR_RATIO,
        shift_error=_SHIFT_ERROR,
        pitch=pitch,
    )
    steps, row, column = neighbour_steps(array.lattice), rows[lens, y, 0], columns[lens, 0, x]
    places = orthogonal - first, on_array, index, types
    micro = MicroImages(stack, (lens, y, x), row, column, *places, steps)
    stack = _mask_and_displace(model, micro, raw, radii < _CENTRE_RADIUS * pitch)
    stack = stack._replace(noise_variance=noise_variance(values, variance, stack.mask > 0))
    return micro._replace(stack=_with_blur(stack, camera, array, types))


def _mask_and_displace(
    model: PinholeModel, micro: MicroImages, raw: RawArrays, central: NDArray[np.bool_]
) -> ImageStack:
    """The stack without pixels lit by neighbours, with displacement from the pinhole model.

    Central pixels (k, n, n) are lit by no neighbour.
    """
    stack, lens = micro.stack, micro.lit[0]
    pixel = np.column_stack([micro.row, micro.column]) + np.array(raw.first)
    passed, displacement = trace_displacement(model, pixel, micro.on_array[lens], micro.type[lens])
    throughput, light = (np.zeros(stack.mask.shape) for _ in range(2))
    coefficients = np.full((*stack.mask.shape, 2, 2), np.nan, np.float32)
    throughput[micro.lit], light[micro.lit] = passed, raw.white[micro.row, micro.column].mean(axis=1)
    coefficients[micro.lit] = displacement
    lit = stack.mask > 0
    central_light, central_throughput = (
        np.where(lit & central, plane, 0.0).sum(axis=(1, 2), keepdims=True) for plane in (light, throughput)
    )
    own_light = throughput * central_light / np.maximum(central_throughput, 1e-9)
    well_lit = throughput >= _MIN_LIGHT * throughput.max(axis=(1, 2), keepdims=True)
    mask = lit & (own_light >= _MIN_OWN_LIGHT * light) & well_lit
    return stack._replace(
        values=extrapolate_border(stack.values.astype(np.float64), mask),
        mask=mask.astype(np.uint8),
        residual_displacement=coefficients,
    )


def _with_blur(
    stack: ImageStack, camera: PlenopticCamera, array: MicrolensArray, types: NDArray[np.int64]
) -> ImageStack:
    """The stack with the defocus of microlenses (k,), and blurred images that compensate it, if there are several."""
    if not array.model.focuses or len(set(array.focal_lengths)) == 1:
        return stack
    focal_lengths = np.array(array.focal_lengths_at(camera.wavelength))[types]
    values, variances = stack.values.astype(np.float64), _BLUR_STEP * np.arange(_BLUR_LEVELS, dtype=np.float64)
    return stack._replace(
        blurred=blur_levels(values, stack.mask > 0, variances),
        defocus=1.0 - camera.microlenses_to_sensor / focal_lengths,
        blur_variance=aperture_variance(array) / camera.sensor.pixel_pitch**2 / _BLUR_STEP,
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
        # Channels share their paths, and with them their errors.
        return radiance, (np.sqrt(raw.variance) / light).mean(axis=2) ** 2


def _pairs(
    array: MicrolensArray, index: NDArray[np.int64], orthogonal: Floats, corner: NDArray[np.int64], pitch: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
    """Pairs of each microlens with those up to three pitches away: `first`, `other`, `base`, `step` of a stack."""
    steps = np.array([step for step in product(range(-4, 5), repeat=2) if step != (0, 0)])
    distance = np.hypot(*(steps @ array.basis).T)
    order = np.argsort(distance, kind="stable")
    steps = steps[order][distance[order] <= _MAX_DISTANCE * min(array.pitches)]
    other = np.stack([rows_of(index, index + step) for step in steps], axis=1)
    lens, step_index = np.nonzero(other >= 0)
    neighbour = other[lens, step_index]
    baseline = orthogonal[neighbour] - orthogonal[lens]
    first = np.concatenate([[0], np.cumsum((other >= 0).sum(axis=1))]).astype(np.int64)
    return first, neighbour, baseline + corner[lens] - corner[neighbour], baseline / pitch
