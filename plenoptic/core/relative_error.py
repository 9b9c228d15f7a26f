"""Lit pixels and the error over them: the one number that stands for the noise of an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import AnyFloats, Floats, frozen_array
from plenoptic.errors import InvalidValueError

LIT = 0.1
"""Pixels are lit whose mean over the channels is above this share of the 99th percentile of all but black ones."""
_PERCENTILE = 99
_FEW = 8
_MOST_UNCERTAIN = 0.1
_MOST_LIFTED = 2.5


def brightness(image: AnyFloats) -> Floats:
    """(..., C) to (...): the mean over the channels."""
    return np.asarray(np.mean(image, axis=-1, dtype=np.float64))


def lit_level(bright: Floats) -> float:
    """Above what brightness a pixel is lit; black pixels, however many there are, do not matter."""
    seen = bright[bright > 0]
    return LIT * float(np.percentile(seen, _PERCENTILE)) if seen.size else 0.0


def lit_pixels(image: ArrayLike) -> NDArray[np.bool_]:
    """Which pixels are lit: those brighter than a tenth of the 99th percentile of the pixels above 0.

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
    """What pixels (rows, columns) are on average, as far as they and their four diagonal neighbours tell.

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
    beside, found = np.zeros_like(values), np.zeros_like(values)
    beside[1:] += values[:-1]
    beside[:-1] += values[1:]
    found[:, 1:] += beside[:, :-1]
    found[:, :-1] += beside[:, 1:]
    return found


def relative_squares(expected: Floats, variance: Floats) -> Floats:
    """Squared relative errors: variance over the square of the expected brightness; 0 where dark."""
    with np.errstate(over="ignore"):  # inf is what it is then
        return np.divide(variance, np.square(expected), out=np.zeros_like(expected), where=expected > 0)


def lit_squares(image: AnyFloats, error: AnyFloats) -> Floats:
    """(n,): squared relative errors of the lit pixels of an image (rows, columns, C). Not finite: unknown pixels."""
    with np.errstate(over="ignore"):
        variance = np.mean(np.square(error, dtype=np.float64), axis=-1)
        expected = expected_brightness(brightness(image), variance)
    lit = (expected > lit_level(expected)) & ~np.isnan(variance)
    return relative_squares(expected[lit], variance[lit])


def relative_error(image: AnyFloats, error: AnyFloats) -> float:
    """Root mean square of the relative errors of lit pixels; nan where there are neither lit pixels nor errors.

    inf where the error of any pixel is, since it may be lit. Pixels whose error is nan do not count.
    """
    if np.isinf(error).any():
        return float("inf")
    squares = lit_squares(image, error)
    if squares.size:
        return float(np.sqrt(np.mean(squares)))
    return float("inf") if np.nansum(error) > 0 else float("nan")


def rests_on_few(squares: Floats) -> bool:
    """Whether the mean of squared relative errors (n,) is that of few pixels: fewer than 8, and than one of 16.

    Counted is (sum q)^2 / sum q^2, the number of equal ones that would scatter as much. With 8 of them, the root mean
    square is known to 1 / (2 sqrt(8)), some 18 %. White images have n / 6, `objects` n / 50 at 32 samples.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        total, scatter = np.sum(squares), np.sum(np.square(squares))
        return bool(total * total < min(_FEW, squares.size / (2 * _FEW)) * scatter)


def level_is_known(bright: Floats, variance: Floats) -> bool:
    """Whether noise does not lift the level above which pixels are lit: to 2.5 of what it is less the errors, at most.

    Where more than a hundredth of the pixels have met a rare bright path, these make all others dark. Scenes whose
    light is not rare have at most 1.8, with 16 samples.
    """
    error = np.sqrt(np.where(np.isfinite(variance), variance, np.inf))
    return lit_level(bright) <= _MOST_LIFTED * lit_level(np.maximum(bright - error, 0.0))


def light_is_rare(image: AnyFloats, error: AnyFloats) -> bool:
    """Whether light is too rare to know the relative error: it is that of few pixels, or which are lit is not known."""
    with np.errstate(over="ignore"):
        variance = np.mean(np.square(error, dtype=np.float64), axis=-1)
    return rests_on_few(lit_squares(image, error)) or not level_is_known(brightness(image), variance)
