"""Arguments and threads of the plane-sweep kernels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats

_MIN_NOISE = 1e-3
"""Standard deviation, relative to the mean radiance, below which differences are not texture."""


class Images(NamedTuple):
    """Images of equal size, (k, rows, columns)."""

    values: NDArray[np.float32]
    mask: NDArray[np.uint8]
    """1 for valid pixels; values are extrapolated for two pixels around them."""
    noise_variance: Floats
    """(k,): variance up to which differences are not texture."""
    residual_displacement: Floats | None = None
    """(k, rows, columns, 2, 2): displacement from the pinhole model in rows and columns, as coefficients of 1 and of
    disparity / pitch; nan where unknown. None: no displacement."""
    blurred: NDArray[np.float32] | None = None
    """(k, levels, rows, columns): the images blurred by Gaussians with variances in steps of `Sweep.blur_step`; None if
    all images have equal blur."""
    defocus: Floats | None = None
    """(k,): 1 - b / f of the microlenses; minus disparity / pitch, the blur diameter of a point over the aperture."""


class Pairs(NamedTuple):
    """Pairs of compared images: image m and `other[j]` for the rows j from first[m] to first[m + 1], nearest first."""

    first: NDArray[np.int64]
    other: NDArray[np.int64]
    base: Floats
    """(n, 2): a point at p is seen at p + base - disparity step in the other image, row and column."""
    step: Floats


class Sweep(NamedTuple):
    """Parameters of the plane sweep."""

    disparities: Floats
    """Disparities of the planes, ascending or descending, pixels."""
    radius: int
    """Radius of the compared windows, pixels."""
    max_compared: int
    """Largest number of images compared with one on each plane: the nearest."""
    max_shift: float
    """Largest shift between two compared images, pixels."""
    relative_reach: float
    constant_reach: float
    """Search range of the refinement around a plane: relative to the disparity, plus a constant in pixels."""
    pitch: float = 1.0
    """Pitch of the microlenses over that of the pixels."""
    aperture_variance: float = 0.0
    """Variance of positions in a microlens aperture along one axis, pixel^2."""
    blur_step: float = 1.0
    """Variance between successive levels of blur, pixel^2."""


class Workspace(NamedTuple):
    """Work arrays of one thread."""

    shifted: NDArray[np.float32]
    shifted_mask: NDArray[np.uint8]
    sums: Floats
    scores: NDArray[np.float32]
    cost: NDArray[np.float32]
    path_cost: NDArray[np.float32]
    previous: NDArray[np.float32]
    current: NDArray[np.float32]
    start: Floats
    slopes: Floats
    slope_sums: Floats


def plane_sweep(images: Images, pairs: Pairs, sweep: Sweep, threads: int) -> tuple[Floats, Floats, Floats]:
    """Disparity, its standard error from independent residuals, and the fraction of agreeing images, each (k, n, n).

    `pairs` lists k images. nan outside the mask; the error is inf without a match.
    """
    from plenoptic.lightfield.kernels.plane_sweep import fill_disparities

    count = len(pairs.first) - 1
    _, rows, columns = images.values.shape
    disparity, error, agreement = (np.full((count, rows, columns), np.nan) for _ in range(3))
    planes, window = len(sweep.disparities), (2 * sweep.radius + 1) ** 2

    def match_block(first: int) -> None:
        workspace = Workspace(
            np.empty((rows, columns), np.float32),
            np.empty((rows, columns), np.uint8),
            np.empty((6, rows + 1, columns)),
            np.empty((sweep.max_compared, rows, columns), np.float32),
            np.empty((rows, columns, planes), np.float32),
            np.empty((rows, columns, planes), np.float32),
            np.empty(planes, np.float32),
            np.empty(planes, np.float32),
            np.empty((rows, columns)),
            np.empty(window),
            np.empty(window),
        )
        end = min(first + block, count)
        fill_disparities(disparity, error, agreement, images, pairs, sweep, workspace, (first, end))

    block = max(1, 1 << 14 >> (rows * columns).bit_length())
    for _ in run_in_order(match_block, range(0, count, block), threads=threads):
        pass
    return disparity, error, agreement


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
