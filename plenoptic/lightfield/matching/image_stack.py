"""Images that see the same points, and the geometry that relates them: the record of all steps of matching."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

SPLINE_POLE = math.sqrt(3.0) - 2.0
"""Pole of the recursion for cubic B-splines."""
MIN_MARGIN = 2
"""Least margin around the masks of images, for interpolation, in pixels; windows need one of their radius."""
_MIN_NOISE = 1e-3
"""Standard deviation, relative to the mean radiance, below which differences are not texture."""


class ImageStack(NamedTuple):
    """k images of equal size to be matched: micro images, or sub-aperture views. Made by `depth` for its matcher.

    In the pinhole model, a point at p (row, column) of one image is seen at p + base - disparity step in another one.
    All lengths are in pixels.
    """

    values: NDArray[np.float32]
    """(k, rows, columns): radiance, mean of the channels."""
    mask: NDArray[np.uint8]
    """(k, rows, columns): 1 for valid pixels; values are extrapolated for two pixels around them. None are valid within
    two pixels, and the radius of a window, from the border."""
    noise_variance: Floats
    """(k,): variance of the radiance up to which differences are not texture."""
    first: NDArray[np.int64]
    """(m + 1,): the images 0 to m - 1 are matched, image i with those of the rows first[i] to first[i + 1] of `other`,
    `base` and `step`, nearest first."""
    other: NDArray[np.int64]
    """(n,): index of the other image."""
    base: Floats
    """(n, 2): shift at disparity 0."""
    step: Floats
    """(n, 2): shift per pixel of disparity."""
    disparities: Floats
    """(planes,): disparities of the planes, ascending or descending."""
    window_radius: int
    """Radius of the compared windows."""
    max_compared: int
    """Largest number of images compared with one on each plane: the nearest."""
    max_shift: float
    """Largest shift between two compared images."""
    reach: tuple[float, float]
    """Search range around a plane of disparity d: reach[0] |d| + reach[1]."""
    error_ratio: float = 1.7
    """Ratio of the error of a disparity to that of independent images: neighbouring views share half of their pixels
    (root of 2), and few of them tell by how much they scatter (root of 1.5)."""
    shift_error: float = 0.0015
    """Systematic error of the largest shift between images; for views, that of the model of their displacement."""
    coefficients: NDArray[np.float32] | None = None
    """(k, rows, columns): `spline_coefficients`, through which `refine` interpolates images without texture as fine as
    their pixels; None: it interpolates by cubic convolution."""
    pitch: float = 1.0
    """Pitch of the microlenses."""
    residual_displacement: NDArray[np.float32] | None = None
    """(k, rows, columns, 2, 2): displacement from the pinhole model in rows and columns, as coefficients of 1 and of
    disparity / pitch; nan where unknown. None: no displacement."""
    blurred: NDArray[np.float32] | None = None
    """(k, levels, rows, columns): the images blurred by Gaussians, whose variance grows by equal steps from level to
    level; None if all images have equal blur."""
    defocus: Floats | None = None
    """(k,): 1 - b / f of the microlenses; minus disparity / pitch, the blur diameter of a point over the aperture."""
    blur_variance: float = 0.0
    """Variance of the blur at a diameter of one aperture along one axis, in steps of the levels of `blurred`."""


class Matches(NamedTuple):
    """Disparities found by matching, in arrays of one shape. See `depth`, whose matcher returns them."""

    disparity: Floats
    """Disparity in pixels; nan where there is none."""
    standard_error: Floats
    """Standard error of the disparity, pixels; inf without a match."""
    confidence: Floats
    """Fraction of the compared images that agree, 0 to 1."""


def with_margin(stack: ImageStack, margin: int) -> ImageStack:
    """The stack with a margin of so many pixels around its images."""
    edges, coefficients, displacement = [(0, 0), (margin,) * 2, (margin,) * 2], stack.coefficients, None
    if stack.residual_displacement is not None:
        displacement = np.pad(stack.residual_displacement, [*edges, (0, 0), (0, 0)], constant_values=np.nan)
    return stack._replace(
        values=np.pad(stack.values, edges),
        mask=np.pad(stack.mask, edges),
        coefficients=None if coefficients is None else np.pad(coefficients, edges),
        residual_displacement=displacement,
    )


def flat(stack: ImageStack) -> ImageStack:
    """The stack with images whose pixels follow each other row after row, in one axis."""
    count, size = len(stack.values), stack.values[0].size

    def pixels(array: NDArray[Any] | None, shape: tuple[int, ...]) -> NDArray[Any] | None:
        return None if array is None else array.reshape(count, *shape)

    return stack._replace(
        values=stack.values.reshape(count, size),
        mask=stack.mask.reshape(count, size),
        coefficients=pixels(stack.coefficients, (size,)),
        residual_displacement=pixels(stack.residual_displacement, (size, 4)),
        blurred=pixels(stack.blurred, (-1, size)),
    )


def max_neighbours(stack: ImageStack) -> int:
    """Largest number of images that one is matched with."""
    return int(np.diff(stack.first).max(initial=0))


def noise_variance(values: Floats, variance: Floats, mask: NDArray[np.bool_]) -> Floats:
    """(k,): variance below which differences within images (k, rows, columns) are noise and not texture."""
    count = np.maximum(mask.sum(axis=(1, 2)), 1)
    mean, noise = (np.where(mask, plane, 0.0).sum(axis=(1, 2)) / count for plane in (values, variance))
    return np.asarray(np.maximum(np.maximum(noise, (_MIN_NOISE * mean) ** 2), 1e-30))


def extrapolate_border(values: Floats, mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Extrapolate values (k, rows, columns) by means of neighbours for two pixels around the mask; 0 beyond."""
    filled, valid = np.where(mask, values, 0.0), mask.copy()
    for _ in range(2):
        total, count = np.zeros_like(filled), np.zeros(filled.shape)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                shifted = np.roll(np.where(valid, filled, 0.0), (down, right), axis=(1, 2))
                total, count = total + shifted, count + np.roll(valid, (down, right), axis=(1, 2))
        new = ~valid & (count > 0)
        filled, valid = np.where(new, total / np.maximum(count, 1), filled), valid | new
    return filled.astype(np.float32)


def spline_coefficients(values: Floats, mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Coefficients of the cubic B-splines through images (k, rows, columns), extrapolated beyond their masks.

    By recursion along columns and rows, see M. Unser, IEEE Signal Processing Magazine 16(6), 1999, 22 to 38.
    """
    total, count = (plane.sum(axis=(1, 2), keepdims=True) for plane in (np.where(mask, values, 0.0), mask))
    mean = total / np.maximum(count, 1)
    coefficients = extrapolate_border(values - mean, mask).astype(np.float64)
    for axis in (1, 2):
        lines = np.moveaxis(coefficients, axis, 0)
        for before, line in pairwise(lines):
            line += SPLINE_POLE * before
        lines[-1] /= SPLINE_POLE - 1.0 / SPLINE_POLE
        for after, line in pairwise(lines[::-1]):
            line[:] = SPLINE_POLE * (after - line)
        lines *= 6.0
    return np.asarray(coefficients + mean, dtype=np.float32)


def blur_levels(values: Floats, mask: NDArray[np.bool_], variances: Floats) -> NDArray[np.float32]:
    """Images (k, rows, columns) blurred by Gaussians of given variances within the mask: (k, levels, rows, columns)."""
    levels = []
    for variance in variances.tolist():
        reach = math.ceil(3.0 * math.sqrt(variance))
        offsets = range(-reach, reach + 1)
        weights = np.exp(-0.5 * np.square(offsets) / max(variance, 1e-9))
        total, coverage = np.where(mask, values, 0.0), mask.astype(np.float64)
        for axis in (1, 2):
            total, coverage = (
                np.sum([w * np.roll(plane, k, axis=axis) for w, k in zip(weights, offsets, strict=True)], axis=0)
                for plane in (total, coverage)
            )
        levels.append(extrapolate_border(total / np.maximum(coverage, 1e-9), mask))
    return np.stack(levels, axis=1)
