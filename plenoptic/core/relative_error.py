"""Lit pixels and the error over them: the one number that stands for the noise of an image."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.color.percentile import HighPercentile
from plenoptic.core.values import AnyFloats, Floats, frozen_array
from plenoptic.errors import InvalidValueError

LIT = 0.1
"""Pixels are lit whose mean over the channels is above this share of the 99th percentile of all but black ones."""
_PERCENTILE = 99
_FEW = 8
_MOST_UNCERTAIN = 0.1
_MOST_LIFTED = 2.5
_STRIP = 1 << 15
"""Pixels at a time: some twenty arrays of them stay in a processor's cache."""
_ROWS = 16
"""Rows at a time, at least: of two more the moments are found twice."""


def brightness(image: AnyFloats) -> Floats:
    """(..., C) to (...): the mean over the channels."""
    total = image[..., 0].astype(np.float64)
    for channel in range(1, image.shape[-1]):
        total += image[..., channel]
    total /= image.shape[-1]
    return np.asarray(total)


def mean_square(error: AnyFloats) -> Floats:
    """(..., C) to (...): the mean over the channels of the squares."""
    with np.errstate(over="ignore"):  # inf is what it is then
        total = np.square(error[..., 0], dtype=np.float64)
        for channel in range(1, error.shape[-1]):
            total += np.square(error[..., channel], dtype=np.float64)
        total /= error.shape[-1]
    return np.asarray(total)


def lit_level(bright: Floats) -> float:
    """Brightness above which a pixel is lit; black pixels, however many there are, do not matter."""
    seen = bright[bright > 0]
    return LIT * float(np.percentile(seen, _PERCENTILE)) if seen.size else 0.0


def lit_pixels(image: ArrayLike) -> NDArray[np.bool_]:
    """True for lit pixels: those brighter than a tenth of the 99th percentile of the pixels above 0.

    In `Exposure.relative_error` those count whose expected brightness is, as far as noisy images tell.

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
        If it is no image of finite numbers.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> pl.lit_pixels(np.array([[[1.0], [0.05], [0.2]]]))
    array([[ True, False,  True]])
    """
    numbers = frozen_array(image, name="image", shape=("H", "W", "C"))
    if not np.isfinite(numbers).all():
        raise InvalidValueError("image has numbers that are not finite; lit pixels are told by those that are")
    bright = brightness(numbers)
    return np.asarray(bright > lit_level(bright))


def expected_brightness(bright: Floats, variance: Floats) -> Floats:
    """Expected brightness of pixels (rows, columns), from themselves and their four diagonal neighbours.

    A pixel that has met rare light is too bright and one that has not is too dark, so that neither may be divided by
    itself. Each is drawn towards its neighbours' mean, by as much as its variance (squared standard error) is of the
    variance that there is between pixels, noise included. Pixels of one colour of a checkerboard see each other only.

    B. Efron and C. Morris, J. Am. Stat. Assoc. 68, 117 (1973): the empirical Bayes estimate of normal means.
    """
    known = np.isfinite(variance)
    values, noise = np.where(known, bright, 0.0), np.where(known, variance, 0.0)
    number = diagonal_sums(known.astype(np.float64))
    most = np.maximum(number, 1.0)
    mean = diagonal_sums(values) / most
    with np.errstate(over="ignore", invalid="ignore"):
        # Less the noise, the variance of neighbours is that of what they show.
        between = (diagonal_sums(values * values) / most - mean * mean) * number / np.maximum(number - 1.0, 1.0)
        shown = np.maximum(between - diagonal_sums(noise) / most, 0.0)
        drawn = (noise > 0) & (number >= 2)
        share = np.divide(noise, shown + noise, out=np.zeros_like(noise), where=drawn)
        found = values + share * (mean - values)
        # Divisors count as darker the less they are known, since the mean of 1 / x^2 is above 1 / mean^2.
        left = np.divide(share * shown, found * found, out=np.zeros_like(noise), where=found > 0)
        return np.asarray(found / np.sqrt(1.0 + np.minimum(left, _MOST_UNCERTAIN)))


def diagonal_sums(values: Floats) -> Floats:
    """Sums (rows, columns) over the four diagonal neighbours: those of a pixel's own colour of a checkerboard."""
    beside, found = np.empty_like(values), np.empty_like(values)
    beside[:-1], beside[-1:] = values[1:], 0.0
    beside[1:] += values[:-1]
    found[:, :-1], found[:, -1:] = beside[:, 1:], 0.0
    found[:, 1:] += beside[:, :-1]
    return found


def relative_squares(expected: Floats, variance: Floats) -> Floats:
    """Squared relative errors: variance over the square of the expected brightness; 0 where dark."""
    with np.errstate(over="ignore"):  # inf is what it is then
        return np.divide(variance, np.square(expected), out=np.zeros_like(expected), where=expected > 0)


def rests_on_few(squares: Floats) -> bool:
    """True if the mean of squared relative errors (n,) rests on few pixels: fewer than 8, and than one of 16.

    Counted is (sum q)^2 / sum q^2, the number of equal ones that would scatter as much. With 8 of them, the root mean
    square is known to 1 / (2 sqrt(8)), some 18 %. White images have n / 6, `objects` n / 50 at 32 samples.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return _sum_rests_on_few(float(np.sum(squares)), float(np.sum(np.square(squares))), squares.size)


def _sum_rests_on_few(total: float, scatter: float, number: int) -> bool:
    """The same, from the sum of the squared errors, the sum of their squares, and how many they are."""
    return total * total < min(_FEW, number / (2 * _FEW)) * scatter


def level_is_known(bright: Floats, variance: Floats) -> bool:
    """True if noise lifts the level above which pixels are lit by a factor of at most 2.5.

    Where more than a hundredth of the pixels have met a rare bright path, these make all others dark. Scenes whose
    light is not rare have at most 1.8, with 16 samples.
    """
    return _level_is_near(lit_level(bright), lit_level(_less_error(bright, variance)))


def _less_error(bright: Floats, variance: Floats) -> Floats:
    """Brightness less its standard error, at least 0; 0 where the error is not known."""
    error = np.sqrt(np.where(np.isfinite(variance), variance, np.inf))
    return np.maximum(bright - error, 0.0)


def _level_is_near(level: float, lower: float) -> bool:
    """True if the level above which pixels are lit is near that of the pixels less their errors."""
    return level <= _MOST_LIFTED * lower


class ImageError(NamedTuple):
    """The error of an image."""

    relative: float
    """Root mean square of the relative errors of lit pixels; nan where there are neither lit pixels nor errors.

    inf where the error of any pixel is, since it may be lit. Pixels whose error is nan do not count.
    """
    rare: bool
    """Whether light is too rare to know that: it is that of few pixels, or which are lit is not known."""


def relative_error(image: AnyFloats, error: AnyFloats) -> float:
    """The first number of `image_error`."""
    return image_error(image, error).relative


def light_is_rare(image: AnyFloats, error: AnyFloats) -> bool:
    """The second one."""
    return image_error(image, error).rare


def image_error(image: AnyFloats, error: AnyFloats) -> ImageError:
    """The error of an image (rows, columns, C) whose standard errors are as many."""
    expected, bright, lower = (HighPercentile(_PERCENTILE, most=image[..., 0].size) for _ in range(3))
    for here in _strips(image, error):
        for level, values in ((expected, here.expected), (bright, here.bright), (lower, _less_error(*here[:2]))):
            level.add(values[values > 0])
    sums = _sums_above(_lit_level(expected), image, error)
    rare = _sum_rests_on_few(*sums) or not _level_is_near(_lit_level(bright), _lit_level(lower))
    return ImageError(_relative(sums, error), rare)


class _Strip(NamedTuple):
    """Statistics of the pixels of some rows, (rows, columns) each."""

    bright: Floats
    variance: Floats
    expected: Floats


def _strips(image: AnyFloats, error: AnyFloats) -> Iterator[_Strip]:
    """All rows, some at a time."""
    rows, columns = image.shape[:2]
    high = max(_STRIP // columns, _ROWS)
    for top in range(0, rows, high):
        # Pixels see their diagonal neighbours.
        seen, end = max(top - 1, 0), min(top + high, rows)
        moments = brightness(image[seen : end + 1]), mean_square(error[seen : end + 1])
        yield _Strip(*(values[top - seen : end - seen] for values in (*moments, expected_brightness(*moments))))


def _lit_level(level: HighPercentile) -> float:
    """The `lit_level` of all numbers that were added."""
    return LIT * level.found() if level.added else 0.0


class _Sums(NamedTuple):
    """Sums of squared relative errors."""

    total: float
    scatter: float
    """Of their squares."""
    number: int


def _sums_above(level: float, image: AnyFloats, error: AnyFloats) -> _Sums:
    """Over the pixels that are lit and known."""
    total, scatter, number = 0.0, 0.0, 0
    for here in _strips(image, error):
        lit = (here.expected > level) & ~np.isnan(here.variance)
        squares = relative_squares(here.expected[lit], here.variance[lit])
        with np.errstate(over="ignore"):
            total, scatter = total + float(np.sum(squares)), scatter + float(np.sum(np.square(squares)))
        number += squares.size
    return _Sums(total, scatter, number)


def _relative(sums: _Sums, error: AnyFloats) -> float:
    if any(np.isinf(row).any() for row in error):
        return math.inf
    if sums.number:
        return math.sqrt(sums.total / sums.number)
    return math.inf if sum(float(np.nansum(row)) for row in error) > 0 else math.nan
