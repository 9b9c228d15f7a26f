"""Lit pixels, and the relative error over them: a single number for the noise of an image."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.color.percentile import HighPercentile
from plenoptic.core.values import AnyFloats, Floats, frozen_array
from plenoptic.errors import InvalidValueError

LIT = 0.1
"""Threshold of lit pixels over the 99th percentile of the mean over the channels of all pixels above 0."""
_PERCENTILE = 99
_FEW = 8
_MAX_UNCERTAINTY = 0.1
_MAX_THRESHOLD_RATIO = 2.5
_STRIP = 1 << 15
"""Pixels that are processed at a time: some twenty arrays of them fit into a processor's cache."""
_ROWS = 16
"""Fewest rows of a strip: the moments of two more rows are computed twice."""


def brightness(image: AnyFloats) -> Floats:
    """Mean over the channels of an image (..., C), shape (...)."""
    total = image[..., 0].astype(np.float64)
    for channel in range(1, image.shape[-1]):
        total += image[..., channel]
    total /= image.shape[-1]
    return np.asarray(total)


def mean_square(error: AnyFloats) -> Floats:
    """Mean over the channels of the squares of errors (..., C), shape (...)."""
    with np.errstate(over="ignore"):  # inf is the right result
        total = np.square(error[..., 0], dtype=np.float64)
        for channel in range(1, error.shape[-1]):
            total += np.square(error[..., channel], dtype=np.float64)
        total /= error.shape[-1]
    return np.asarray(total)


def lit_threshold(bright: Floats) -> float:
    """Brightness above which a pixel is lit, independent of the number of black pixels."""
    positive = bright[bright > 0]
    return LIT * float(np.percentile(positive, _PERCENTILE)) if positive.size else 0.0


def lit_pixels(image: ArrayLike) -> NDArray[np.bool_]:
    """Mask of lit pixels: those brighter than a tenth of the 99th percentile of the pixels above 0.

    `Exposure.relative_error` applies the same threshold to the expected brightness, estimated from noisy images.

    Parameters
    ----------
    image : (H, W, C) array_like
        Brightness is the mean over the channels.

    Returns
    -------
    (H, W) array of bool

    Raises
    ------
    InvalidValueError
        If the image is not an array (H, W, C) of finite numbers.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> pl.lit_pixels(np.array([[[1.0], [0.05], [0.2]]]))
    array([[ True, False,  True]])
    """
    numbers = frozen_array(image, name="image", shape=("H", "W", "C"))
    if not np.isfinite(numbers).all():
        raise InvalidValueError("image has numbers that are not finite; replace them")
    bright = brightness(numbers)
    return np.asarray(bright > lit_threshold(bright))


def expected_brightness(bright: Floats, variance: Floats) -> Floats:
    """Expected brightness of pixels (rows, columns), estimated from their values and their four diagonal neighbours.

    A pixel with a rare bright path is too bright and one without too dark, so that dividing errors by the pixel's own
    value would be biased. Each value is shrunk towards its neighbours' mean, by the ratio of its variance (squared
    standard error) to the total variance between pixels. Diagonal neighbours have the same colour of a checkerboard.

    B. Efron and C. Morris, J. Am. Stat. Assoc. 68, 117 (1973): the empirical Bayes estimate of normal means.
    """
    is_finite = np.isfinite(variance)
    values, noise = np.where(is_finite, bright, 0.0), np.where(is_finite, variance, 0.0)
    count = diagonal_sums(is_finite.astype(np.float64))
    divisor = np.maximum(count, 1.0)
    mean = diagonal_sums(values) / divisor
    with np.errstate(over="ignore", invalid="ignore"):
        # The variance between neighbours is that of the signal plus that of the noise.
        between = (diagonal_sums(values * values) / divisor - mean * mean) * count / np.maximum(count - 1.0, 1.0)
        signal_variance = np.maximum(between - diagonal_sums(noise) / divisor, 0.0)
        is_shrunk = (noise > 0) & (count >= 2)
        shrinkage = np.divide(noise, signal_variance + noise, out=np.zeros_like(noise), where=is_shrunk)
        posterior = values + shrinkage * (mean - values)
        # Uncertain divisors count as darker, since the mean of 1 / x^2 is above 1 / mean^2.
        relative_variance = np.divide(
            shrinkage * signal_variance, posterior * posterior, out=np.zeros_like(noise), where=posterior > 0
        )
        return np.asarray(posterior / np.sqrt(1.0 + np.minimum(relative_variance, _MAX_UNCERTAINTY)))


def diagonal_sums(values: Floats) -> Floats:
    """Sums over the four diagonal neighbours of each pixel (rows, columns): those of its colour of a checkerboard."""
    vertical, sums = np.empty_like(values), np.empty_like(values)
    vertical[:-1], vertical[-1:] = values[1:], 0.0
    vertical[1:] += values[:-1]
    sums[:, :-1], sums[:, -1:] = vertical[:, 1:], 0.0
    sums[:, 1:] += vertical[:, :-1]
    return sums


def relative_squares(expected: Floats, variance: Floats) -> Floats:
    """Squared relative errors: variance over the square of the expected brightness; 0 where that is 0."""
    with np.errstate(over="ignore"):  # inf is the right result
        return np.divide(variance, np.square(expected), out=np.zeros_like(expected), where=expected > 0)


def is_dominated_by_few(squares: Floats) -> bool:
    """True if few pixels dominate the mean of squared relative errors (n,): fewer than 8, or than one in 16.

    The effective number is (sum q)^2 / sum q^2. With 8, the root mean square is known to 1 / (2 sqrt(8)), some 18 %.
    White images have n / 6, `objects` n / 50 at 32 samples.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return _few_dominate(float(np.sum(squares)), float(np.sum(np.square(squares))), squares.size)


def _few_dominate(total: float, sum_of_squares: float, count: int) -> bool:
    """`is_dominated_by_few` from the sum of the squared errors, the sum of their squares, and their number."""
    return total * total < min(_FEW, count / (2 * _FEW)) * sum_of_squares


def is_threshold_robust(bright: Floats, variance: Floats) -> bool:
    """True if noise raises the threshold of lit pixels at most 2.5 times above that of brightness less error.

    If more than a hundredth of the pixels have rare bright paths, the threshold makes all others dark. Scenes without
    rare light have at most 1.8, with 16 samples.
    """
    return lit_threshold(bright) <= _MAX_THRESHOLD_RATIO * lit_threshold(_less_error(bright, variance))


def _less_error(bright: Floats, variance: Floats) -> Floats:
    """Brightness less its standard error, at least 0; 0 if the error is unknown."""
    error = np.sqrt(np.where(np.isfinite(variance), variance, np.inf))
    return np.maximum(bright - error, 0.0)


class ImageError(NamedTuple):
    """Relative error of an image."""

    relative: float
    """Root mean square of the relative errors of lit pixels; nan if there are neither lit pixels nor errors.

    inf if the error of any pixel is inf, since it may be lit. Pixels whose error is nan do not count.
    """
    rare: bool
    """True if light is too rare for a reliable estimate: few pixels dominate, or the threshold is not robust."""
    few: bool = False
    """True if fewer than 8 pixels dominate, also where few are lit."""

    def misses(self, unmet_light: float) -> bool:
        """True if light that paths may have missed, a fraction of all light, is more than the error, or few show it."""
        return unmet_light > 0 and (self.few or not unmet_light <= self.relative)


def relative_error(image: AnyFloats, error: AnyFloats) -> float:
    """Root mean square of the relative errors of lit pixels; see `ImageError.relative`."""
    return image_error(image, error).relative


def image_error(image: AnyFloats, error: AnyFloats) -> ImageError:
    """Relative error of an image (rows, columns, C) from standard errors of the same shape."""
    expected, bright, lower = (HighPercentile(_PERCENTILE, max_count=image[..., 0].size) for _ in range(3))
    is_small = image[..., 0].size <= _STRIP  # then its moments are kept for the second pass
    strips = list(_strips(image, error)) if is_small else None
    for strip in strips or _strips(image, error):
        for level, values in ((expected, strip.expected), (bright, strip.bright), (lower, _less_error(*strip[:2]))):
            level.add(values[values > 0])
    sums = _sums_above(_threshold(expected), strips or _strips(image, error))
    rare = _few_dominate(*sums) or not _threshold(bright) <= _MAX_THRESHOLD_RATIO * _threshold(lower)
    return ImageError(_relative(sums, error), rare, sums.total * sums.total < _FEW * sums.sum_of_squares)


class _Moments(NamedTuple):
    """Moments of some rows of pixels, (rows, columns) each."""

    bright: Floats
    variance: Floats
    expected: Floats


def _strips(image: AnyFloats, error: AnyFloats) -> Iterator[_Moments]:
    """All rows in strips."""
    rows, columns = image.shape[:2]
    height = max(_STRIP // columns, _ROWS)
    for top in range(0, rows, height):
        # The expected brightness needs the rows above and below.
        first, end = max(top - 1, 0), min(top + height, rows)
        moments = brightness(image[first : end + 1]), mean_square(error[first : end + 1])
        yield _Moments(*(values[top - first : end - first] for values in (*moments, expected_brightness(*moments))))


def _threshold(percentile: HighPercentile) -> float:
    """`lit_threshold` of all numbers that were added."""
    return LIT * percentile.value() if percentile.count else 0.0


class _Sums(NamedTuple):
    """Sums over squared relative errors."""

    total: float
    sum_of_squares: float
    """Of the squared errors."""
    n_pixels: int


def _sums_above(threshold: float, strips: Iterable[_Moments]) -> _Sums:
    """Sums over lit pixels whose error is known."""
    total, sum_of_squares, count = 0.0, 0.0, 0
    for strip in strips:
        lit = (strip.expected > threshold) & ~np.isnan(strip.variance)
        squares = relative_squares(strip.expected[lit], strip.variance[lit])
        with np.errstate(over="ignore"):
            total, sum_of_squares = total + float(np.sum(squares)), sum_of_squares + float(np.sum(np.square(squares)))
        count += squares.size
    return _Sums(total, sum_of_squares, count)


def _relative(sums: _Sums, error: AnyFloats) -> float:
    if np.fmax.reduce(error, axis=None, initial=0.0) == math.inf:
        return math.inf
    if sums.n_pixels:
        return math.sqrt(sums.total / sums.n_pixels)
    return math.inf if sum(float(np.nansum(row)) for row in error) > 0 else math.nan
