"""Disparities in the images of microlenses: matched one by one, then brought into agreement."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.report.focus import CameraKind, kind_of
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.micro_images import MicroImages, micro_images
from plenoptic.lightfield.outward_rays import aperture_variance
from plenoptic.lightfield.pinhole_model import PlanePair, displacement, object_plane_pair
from plenoptic.lightfield.plane_sweep import Images, Sweep, blurred, extrapolate_border, plane_sweep
from plenoptic.lightfield.raw_arrays import RawArrays
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice

_RATIO = 1.06
"""Of the virtual depths of neighbouring planes."""
_COMPARED = 18
"""Microlenses with which one is compared at most: two rings of a hexagonal lattice."""
_FARTHEST = 0.6
"""Parts of the pitch by which the images of a point lie apart at most in two that are compared."""
_LIT, _OWN = 0.7, 0.9
"""Of the light that the best lit pixels get of their microlens, and of all light that falls on a pixel: the least parts
that a pixel that is compared gets of its microlens."""
_MIDDLE = 0.25
"""Pitches from the middle of a microlens image within which no other one lights it."""
_LEVEL, _LEVELS = 0.5, 5
"""Steps of the variance of blur that is added, pixel^2, and how many there are."""
_ERRORS = 2.0
"""Errors found over what independent residuals give: neighbouring pixels are blurred alike."""
_AGREES = 0.03
"""Relative difference, beside three standard errors, up to which microlenses see the same."""


class Estimate(NamedTuple):
    """Of the pixels of microlens images, (k, n, n); nan where none is."""

    lenses: MicroImages
    ideal: PlanePair
    disparity: Floats
    """Of the ideal camera."""
    error: Floats
    share: Floats
    """Of the microlenses compared, those that show the same."""


def match_micro_images(
    axes: ArrayAxes, planes: RawArrays, virtual_depths: tuple[float, float], radius: int, threads: int
) -> Estimate:
    """Match the images of a raw image."""
    camera = axes.camera
    array = focused_array(camera)
    sign, (low, high) = math.copysign(1.0, virtual_depths[0]), sorted(map(abs, virtual_depths))
    ideal = object_plane_pair(camera, (low, high), sign)
    lenses = micro_images(camera, array, planes)
    count = 2 + int(np.log(high / low) / np.log(_RATIO))
    sweep = Sweep(
        disparities=sign * lenses.pitch / np.geomspace(high, low, count),
        radius=radius,
        compared=_COMPARED,
        farthest=_FARTHEST * lenses.pitch,
        reach=_RATIO - 1.0,
        least_reach=0.0,
        pitch=lenses.pitch,
        opening=aperture_variance(array) / camera.sensor.pixel_pitch**2,
        level=_LEVEL,
    )
    images = _mask_and_displace(axes, lenses, ideal, planes, threads)
    disparity, error, share = plane_sweep(images, lenses.pairs, sweep, threads)
    return Estimate(lenses, ideal, disparity, _ERRORS * error, share)


def focused_array(camera: PlenopticCamera) -> MicrolensArray:
    """The microlenses of a focused camera, or an error."""
    array = camera.microlenses
    if array is None:
        raise InvalidValueError("the camera has no microlenses, and nothing to match; use one with a MicrolensArray")
    if array.lattice is Lattice.FREE:
        raise InvalidValueError("the microlenses lie on no lattice, and it is not known which are neighbours")
    if array.model.focuses and _kinds(camera, array) == {CameraKind.PLENOPTIC_1}:
        raise InvalidValueError(
            "the microlenses are focused at infinity: their images show no scene to match; take views by "
            "pl.lightfield.decode(shot, white), and depth or refocus of those"
        )
    return array


def image_side(camera: PlenopticCamera) -> float:
    """1 where microlenses of any type are focused on what lies behind the array, -1 where all look before it."""
    return 1.0 if CameraKind.GALILEAN in _kinds(camera, focused_array(camera)) else -1.0


def _kinds(camera: PlenopticCamera, array: MicrolensArray) -> set[CameraKind]:
    return {kind_of(camera, focal_length) for focal_length in array.focal_lengths}


def _mask_and_displace(
    axes: ArrayAxes, lenses: MicroImages, ideal: PlanePair, planes: RawArrays, threads: int
) -> Images:
    """The images without what neighbours light too, and what they show beside the ideal camera."""
    images, array = lenses.images, focused_array(axes.camera)
    rows, columns = lenses.rows_and_columns()
    lens, y, x = np.nonzero(images.known)
    row, column = rows[lens, y, 0], columns[lens, 0, x]
    pixel = np.column_stack([row, column]) + np.array(planes.first)
    found = displacement(axes, array, pixel, lenses.on_array[lens], lenses.type[lens], ideal, threads)
    share, light = (np.zeros(images.known.shape) for _ in range(2))
    shift = np.full((*images.known.shape, 2, 2), np.nan)
    share[lens, y, x], light[lens, y, x] = found.share, planes.white[row, column].mean(axis=1)
    shift[lens, y, x] = found.shift
    middle = (images.known > 0) & (lenses.radius() < _MIDDLE)
    full, whole = (np.where(middle, part, 0.0).sum(axis=(1, 2), keepdims=True) for part in (light, share))
    own = share * full / np.maximum(whole, 1e-9)
    known = (images.known > 0) & (own >= _OWN * light) & (share >= _LIT * share.max(axis=(1, 2), keepdims=True))
    values: Floats = np.asarray(images.values, dtype=np.float64)
    images = Images(extrapolate_border(values, known), known.astype(np.uint8), images.floor, shift)
    if not array.model.focuses or len(set(array.focal_lengths)) == 1:
        return images
    focal_lengths = np.array(array.focal_lengths_at(axes.camera.wavelength))[lenses.type]
    return images._replace(
        blurred=blurred(values, known, _LEVEL * np.arange(_LEVELS, dtype=np.float64)),
        bent=1.0 - axes.camera.microlenses_to_sensor / focal_lengths,
    )


def consensus(found: Estimate, shape: tuple[int, ...]) -> tuple[Floats, Floats, Floats]:
    """Disparity, standard error and confidence on the raw image (H, W); nan where no microlens image is.

    What a microlens sees its neighbours see too: each pixel gets their estimates where they fall on it, and takes the
    mean of those that agree with the weighted median. The share of these, times that of microlenses that show the same,
    is the confidence.
    """
    lenses, size = found.lenses, shape[0] * shape[1]
    rows, columns = lenses.rows_and_columns()
    lens, y, x = np.nonzero(lenses.images.known)
    row, column = rows[lens, y, 0], columns[lens, 0, x]
    value, error = found.disparity[lens, y, x], found.error[lens, y, x]
    usable = np.isfinite(value) & np.isfinite(error)
    owner = np.full(size, -1)
    owner[row * shape[1] + column] = lens
    slots = np.full((len(lenses.steps) + 1, 2, size), np.nan)
    slots[0, :, row * shape[1] + column] = np.where(usable, [value, error], np.nan).T
    for k, other in enumerate(lenses.neighbours(lens).T):
        apart = (lenses.straight[other] - lenses.straight[lens]) * (1.0 - value / lenses.pitch)[:, None]
        there = np.rint(np.column_stack([row, column]) + np.nan_to_num(apart, nan=1e9)).astype(np.int64)
        falls = usable & (other >= 0) & ((there >= 0) & (there < shape[:2])).all(axis=1)
        place = np.where(falls, there[:, 0] * shape[1] + there[:, 1], 0)
        falls &= owner[place] == other
        slots[k + 1][:, place[falls]] = value[falls], error[falls]
    known = np.full((3, size), np.nan)
    seen = np.flatnonzero(owner >= 0)
    known[:, seen] = _consensus(slots[:, 0, seen], slots[:, 1, seen])
    disparity, spread, confidence = known.reshape(3, *shape[:2])
    shown = found.share[lens, y, x]
    confidence[row, column] *= np.where(np.isfinite(shown), shown, 1.0)
    return disparity, spread, confidence


def _consensus(values: Floats, errors: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean of estimates (s, n) that agree with their weighted median, its standard error, and their share."""
    with np.errstate(divide="ignore", invalid="ignore"):
        order = np.argsort(values, axis=0)
        ordered = np.take_along_axis(values, order, axis=0)
        spread = np.maximum(np.take_along_axis(errors, order, axis=0), 1e-12)
        known = np.isfinite(ordered)
        # Errors of a hundredth of the value and less are as good as each other.
        weight = np.where(known, 1.0 / np.maximum(spread, 0.01 * np.abs(ordered)), 0.0)
        half = np.cumsum(weight, axis=0) >= 0.5 * weight.sum(axis=0)
        middle = np.take_along_axis(ordered, half.argmax(axis=0)[None], axis=0)[0]
        agrees = np.abs(ordered - middle) <= _AGREES * np.abs(middle) + 3.0 * spread * (spread < 0.1 * np.abs(middle))
        precise = np.where(agrees, weight**2, 0.0)
        mean = np.where(agrees, precise * ordered, 0.0).sum(axis=0) / precise.sum(axis=0)
        # Estimates of neighbours rest on the same pixels: their mean is no better than the best of them. Others may be
        # right after all.
        least = np.where(agrees, spread, np.inf).min(axis=0)
        doubt = np.where(known & ~agrees, weight * (ordered - mean) ** 2, 0.0).sum(axis=0) / weight.sum(axis=0)
        share = agrees.sum(axis=0) / known.sum(axis=0)
    return mean, np.where(np.isfinite(mean), np.sqrt(least**2 + doubt), np.nan), share
