"""Disparities in the images of microlenses: matched one by one, then brought into agreement."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import ArrayAxes, array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.report.focus import CameraKind, kind_of
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.ideal import Planes, displacement, ideal_planes
from plenoptic.lightfield.lens_images import LensImages, lens_images
from plenoptic.lightfield.matching import Images, Sweep, blurred, continued, matched
from plenoptic.lightfield.outward_rays import opening_variance
from plenoptic.lightfield.planes import RawPlanes
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice

_RATIO = 1.06
"""Of the virtual depths of neighbouring planes."""
_FARTHEST = 0.6
"""Parts of the pitch by which the images of a point lie apart at most in two that are compared."""
_LEAST_NOISE = 1e-3
"""Standard deviation over the mean radiance below which differences do not count as texture."""
_ERRORS = 2.0
"""Errors found over what independent residuals give: neighbouring pixels are blurred alike."""
_SMALL, _LARGE = (float(__import__("os").environ.get(k,v)) for k,v in (("SMALL",0.03),("LARGE",0.3)))
"""Correlation that a step to the next plane costs, and one to any other."""
_WORST = 0.3
"""Correlation that counts at least."""
_OWN = float(__import__("os").environ.get("OWN","0.8"))
"""Part of the light of the brightest pixels, by which others belong to the image of a microlens alone."""
_LEVEL, _LEVELS = 0.5, 5
_AGREES = 0.03
"""Relative difference, beside three standard errors, up to which microlenses see the same."""


class Estimate(NamedTuple):
    """Of the pixels of microlens images, (k, n, n); nan where none is."""

    lenses: LensImages
    ideal: Planes
    disparity: Floats
    error: Floats


def estimated(
    camera: PlenopticCamera, planes: RawPlanes, virtual_depths: tuple[float, float], radius: int, threads: int
) -> Estimate:
    """Match the images of a raw image."""
    array = focused_array(camera)
    lenses = lens_images(camera, array, planes)
    low, high = virtual_depths
    count = 2 + int(np.log(high / low) / np.log(_RATIO))
    known = lenses.images.known > 0
    mean = float(lenses.images.values[known].mean()) if known.any() else 0.0
    sweep = Sweep(
        disparities=depth_sign(camera) * lenses.pitch / np.geomspace(high, low, count),
        radius=radius,
        farthest=_FARTHEST * lenses.pitch,
        floor=max(lenses.noise, (_LEAST_NOISE * mean) ** 2, 1e-30),
        same=float(__import__("os").environ.get("SAME","0.1")),least=float(__import__("os").environ.get("LEAST","0.25")),
        small=_SMALL,
        large=_LARGE,
        worst=_WORST,
        reach=_RATIO - 1.0,
        least_reach=0.0,
        pitch=lenses.pitch,
        opening=opening_variance(array) / camera.sensor.pixel_pitch**2,
        level=_LEVEL,
    )
    axes = array_axes(camera)
    ideal = ideal_planes(camera, virtual_depths, depth_sign(camera))
    images = _displaced(axes, array, lenses, ideal, planes.first, threads)
    disparity, error, _ = matched(images, lenses.pairs, sweep, threads)
    return Estimate(lenses, ideal, disparity, _ERRORS * error)


def _displaced(
    axes: ArrayAxes,
    array: MicrolensArray,
    lenses: LensImages,
    ideal: Planes,
    first: tuple[int, int],
    threads: int,
) -> Images:
    """The images without what neighbours light too, and what they show beside the ideal camera."""
    images = lenses.images
    rows, columns = lenses.rows_and_columns()
    lens, y, x = np.nonzero(images.known)
    pixel = np.column_stack([rows[lens, y, 0], columns[lens, 0, x]]) + np.array(first)
    found = displacement(axes, array, pixel, lenses.on_array[lens], lenses.type[lens], ideal, threads)
    share = np.zeros(images.known.shape)
    share[lens, y, x] = found.share
    known = (images.known > 0) & (share >= _OWN * share.max(axis=(1, 2), keepdims=True))
    shift = np.full((*known.shape, 2, 2), np.nan)
    shift[lens, y, x] = found.shift
    values = images.values.astype(np.float64)
    found_ = Images(continued(values, known), known.astype(np.uint8), shift)
    if not array.model.focuses or len(set(array.focal_lengths)) == 1 or __import__("os").environ.get("NOBLUR"):
        return found_
    bent = 1.0 - camera_b(axes) / np.array(array.focal_lengths_at(axes.camera.wavelength))[lenses.type]
    return found_._replace(blurred=blurred(values, known, _LEVEL * np.arange(_LEVELS)), bent=bent)


def camera_b(axes):
    return axes.camera.microlenses_to_sensor


def focused_array(camera: PlenopticCamera) -> MicrolensArray:
    """The microlenses of a focused camera, or an error."""
    array = camera.microlenses
    if array is None:
        raise InvalidValueError("the camera has no microlenses, and nothing to match; use one with a MicrolensArray")
    if array.lattice is Lattice.FREE:
        raise InvalidValueError("the microlenses lie on no lattice, and it is not known which are neighbours")
    if array.model.focuses and kind_of(camera, array.focal_length) is CameraKind.PLENOPTIC_1:
        raise InvalidValueError(
            "the microlenses are focused at infinity: their images show no scene to match; decode the views and give "
            "the light field"
        )
    return array


def depth_sign(camera: PlenopticCamera) -> float:
    """1 where the main lens's images lie behind the array, -1 where they lie in front of it."""
    array = focused_array(camera)
    return 1.0 if kind_of(camera, array.focal_length) is CameraKind.GALILEAN else -1.0


def agreed(found: Estimate, shape: tuple[int, int]) -> tuple[Floats, Floats, Floats]:
    """Disparity, standard error and confidence on the raw image (H, W); nan where no microlens image is.

    What a microlens sees its neighbours see too: each pixel gets their estimates where they fall on it, and takes the
    mean of those that agree with the weighted median. The share of these is the confidence.
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
        falls = usable & (other >= 0) & ((there >= 0) & (there < shape)).all(axis=1)
        place = np.where(falls, there[:, 0] * shape[1] + there[:, 1], 0)
        falls &= owner[place] == other
        slots[k + 1][:, place[falls]] = value[falls], error[falls]
    disparity, spread, confidence = (np.full(size, np.nan) for _ in range(3))
    seen = np.flatnonzero(owner >= 0)
    disparity[seen], spread[seen], confidence[seen] = _consensus(slots[:, 0, seen], slots[:, 1, seen])
    return disparity.reshape(shape), spread.reshape(shape), confidence.reshape(shape)


def _consensus(values: Floats, errors: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean of estimates (s, n) that agree with their weighted median, its standard error, and their share."""
    with np.errstate(divide="ignore", invalid="ignore"):
        order = np.argsort(values, axis=0)
        ordered = np.take_along_axis(values, order, axis=0)
        spread = np.maximum(np.take_along_axis(errors, order, axis=0), 1e-12)
        # Errors of a hundredth of the value and less are as good as each other.
        weight = np.where(np.isfinite(ordered), 1.0 / np.maximum(spread, 0.01 * np.abs(ordered)), 0.0)
        half = np.cumsum(weight, axis=0) >= 0.5 * weight.sum(axis=0)
        middle = np.take_along_axis(ordered, half.argmax(axis=0)[None], axis=0)[0]
        agrees = np.abs(ordered - middle) <= _AGREES * np.abs(middle) + 3.0 * spread * (spread < 0.1 * np.abs(middle))
        precise = np.where(agrees, weight**2, 0.0)
        total = precise.sum(axis=0)
        mean = np.where(agrees, precise * ordered, 0.0).sum(axis=0) / total
        # Estimates of neighbours rest on the same pixels: their mean is no better than the best of them.
        least = np.where(agrees, spread, np.inf).min(axis=0)
        share = agrees.sum(axis=0) / np.isfinite(ordered).sum(axis=0)
    return mean, np.where(np.isfinite(mean), least, np.nan), share
