"""Disparities of micro images: matched one by one by a plane sweep, then made consistent between microlenses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import CameraKind, kind_of
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.micro_images import MicroImages, micro_images
from plenoptic.lightfield.outward_rays import aperture_variance
from plenoptic.lightfield.pinhole_model import PlanePair, displacement, object_plane_pair
from plenoptic.lightfield.plane_sweep import Images, Sweep, blur_levels, extrapolate_border, plane_sweep
from plenoptic.lightfield.raw_arrays import RawArrays
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice

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
_BLUR_STEP, _BLUR_LEVELS = 0.5, 5
"""Step of the variance of added blur, pixel^2, and the number of steps."""
_ERROR_RATIO = 2.0
"""Ratio of the actual error to that of independent residuals: neighbouring pixels share their blur."""
_TOLERANCE = 0.03
"""Relative difference, in addition to three standard errors, up to which microlenses agree."""


class LocalDisparities(NamedTuple):
    """Disparities of the pixels of micro images, (k, n, n); nan without one."""

    micro_images: MicroImages
    planes: PlanePair
    disparity: Floats
    """Disparity in the pinhole model, pixels."""
    error: Floats
    agreement: Floats
    """Fraction of the compared microlenses that agree."""


def match_micro_images(
    axes: ArrayAxes, raw: RawArrays, virtual_depths: tuple[float, float], radius: int, threads: int
) -> LocalDisparities:
    """Match the micro images of a raw image by a plane sweep over a range of virtual depths."""
    camera = axes.camera
    array = focused_array(camera)
    sign, (low, high) = math.copysign(1.0, virtual_depths[0]), sorted(map(abs, virtual_depths))
    planes = object_plane_pair(camera, (low, high), sign)
    micro = micro_images(camera, array, raw)
    count = 2 + int(np.log(high / low) / np.log(_DEPTH_RATIO))
    sweep = Sweep(
        disparities=sign * micro.pitch / np.geomspace(high, low, count),
        radius=radius,
        max_compared=_MAX_COMPARED,
        max_shift=_MAX_SHIFT_PITCHES * micro.pitch,
        relative_reach=_DEPTH_RATIO - 1.0,
        constant_reach=0.0,
        pitch=micro.pitch,
        aperture_variance=aperture_variance(array) / camera.sensor.pixel_pitch**2,
        blur_step=_BLUR_STEP,
    )
    images = _mask_and_displace(axes, micro, planes, raw, threads)
    disparity, error, agreement = plane_sweep(images, micro.pairs, sweep, threads)
    return LocalDisparities(micro, planes, disparity, _ERROR_RATIO * error, agreement)


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


def _mask_and_displace(axes: ArrayAxes, micro: MicroImages, planes: PlanePair, raw: RawArrays, threads: int) -> Images:
    """Micro images without pixels lit by neighbours, with their displacement from the pinhole model and their blur."""
    images, array = micro.images, focused_array(axes.camera)
    rows, columns = micro.rows_and_columns()
    lens, y, x = np.nonzero(images.mask)
    row, column = rows[lens, y, 0], columns[lens, 0, x]
    pixel = np.column_stack([row, column]) + np.array(raw.first)
    real = displacement(axes, array, pixel, micro.on_array[lens], micro.type[lens], planes, threads)
    throughput, light = (np.zeros(images.mask.shape) for _ in range(2))
    coefficients = np.full((*images.mask.shape, 2, 2), np.nan)
    throughput[lens, y, x], light[lens, y, x] = real.throughput, raw.white[row, column].mean(axis=1)
    coefficients[lens, y, x] = real.coefficients
    central = (images.mask > 0) & (micro.radius() < _CENTRE_RADIUS)
    central_light, central_throughput = (
        np.where(central, plane, 0.0).sum(axis=(1, 2), keepdims=True) for plane in (light, throughput)
    )
    own_light = throughput * central_light / np.maximum(central_throughput, 1e-9)
    well_lit = throughput >= _MIN_LIGHT * throughput.max(axis=(1, 2), keepdims=True)
    mask = (images.mask > 0) & (own_light >= _MIN_OWN_LIGHT * light) & well_lit
    values: Floats = np.asarray(images.values, dtype=np.float64)
    images = Images(extrapolate_border(values, mask), mask.astype(np.uint8), images.noise_variance, coefficients)
    if not array.model.focuses or len(set(array.focal_lengths)) == 1:
        return images
    focal_lengths = np.array(array.focal_lengths_at(axes.camera.wavelength))[micro.type]
    return images._replace(
        blurred=blur_levels(values, mask, _BLUR_STEP * np.arange(_BLUR_LEVELS, dtype=np.float64)),
        defocus=1.0 - axes.camera.microlenses_to_sensor / focal_lengths,
    )


def consensus(matches: LocalDisparities, shape: tuple[int, ...]) -> tuple[Floats, Floats, Floats]:
    """Disparity, standard error and confidence on the raw image (H, W); nan outside the micro images.

    Neighbouring microlenses see the same points: each pixel collects the estimates that neighbours project onto it, and
    takes the mean of those that agree with the weighted median. The confidence is the fraction that agree, times the
    fraction of compared microlenses that agree.
    """
    micro, size = matches.micro_images, shape[0] * shape[1]
    rows, columns = micro.rows_and_columns()
    lens, y, x = np.nonzero(micro.images.mask)
    row, column = rows[lens, y, 0], columns[lens, 0, x]
    value, error = matches.disparity[lens, y, x], matches.error[lens, y, x]
    usable = np.isfinite(value) & np.isfinite(error)
    owner = np.full(size, -1)
    owner[row * shape[1] + column] = lens
    slots = np.full((len(micro.steps) + 1, 2, size), np.nan)
    slots[0, :, row * shape[1] + column] = np.where(usable, [value, error], np.nan).T
    for j, other in enumerate(micro.neighbours(lens).T):
        shift = (micro.orthogonal[other] - micro.orthogonal[lens]) * (1.0 - value / micro.pitch)[:, None]
        target = np.rint(np.column_stack([row, column]) + np.nan_to_num(shift, nan=1e9)).astype(np.int64)
        lands = usable & (other >= 0) & ((target >= 0) & (target < shape[:2])).all(axis=1)
        target_index = np.where(lands, target[:, 0] * shape[1] + target[:, 1], 0)
        lands &= owner[target_index] == other
        slots[j + 1][:, target_index[lands]] = value[lands], error[lands]
    result = np.full((3, size), np.nan)
    covered = np.flatnonzero(owner >= 0)
    result[:, covered] = _weighted_consensus(slots[:, 0, covered], slots[:, 1, covered])
    disparity, standard_error, confidence = result.reshape(3, *shape[:2])
    agreement = matches.agreement[lens, y, x]
    confidence[row, column] *= np.where(np.isfinite(agreement), agreement, 1.0)
    return disparity, standard_error, confidence


def _weighted_consensus(values: Floats, errors: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean of the estimates (s, n) that agree with their weighted median, its standard error, and their fraction."""
    with np.errstate(divide="ignore", invalid="ignore"):
        order = np.argsort(values, axis=0)
        ordered = np.take_along_axis(values, order, axis=0)
        deviation = np.maximum(np.take_along_axis(errors, order, axis=0), 1e-12)
        valid = np.isfinite(ordered)
        # Errors below a hundredth of the value weigh the same.
        weight = np.where(valid, 1.0 / np.maximum(deviation, 0.01 * np.abs(ordered)), 0.0)
        half = np.cumsum(weight, axis=0) >= 0.5 * weight.sum(axis=0)
        median = np.take_along_axis(ordered, half.argmax(axis=0)[None], axis=0)[0]
        agrees = np.abs(ordered - median) <= _TOLERANCE * np.abs(median) + 3.0 * deviation * (
            deviation < 0.1 * np.abs(median)
        )
        inverse_variance = np.where(agrees, weight**2, 0.0)
        mean = np.where(agrees, inverse_variance * ordered, 0.0).sum(axis=0) / inverse_variance.sum(axis=0)
        # Estimates of neighbours share their pixels: their mean is no better than the best of them. The spread of the
        # estimates that disagree is added, since they may be right.
        smallest = np.where(agrees, deviation, np.inf).min(axis=0)
        doubt = np.where(valid & ~agrees, weight * (ordered - mean) ** 2, 0.0).sum(axis=0) / weight.sum(axis=0)
        fraction = agrees.sum(axis=0) / valid.sum(axis=0)
    return mean, np.where(np.isfinite(mean), np.sqrt(smallest**2 + doubt), np.nan), fraction
