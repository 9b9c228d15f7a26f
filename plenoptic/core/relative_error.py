"""Lit pixels and the error over them: the one number that stands for the noise of an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import AnyFloats, Floats, frozen_array
from plenoptic.errors import InvalidValueError

LIT = 0.1
"""Pixels are lit whose mean over the channels is above this share of the 99th percentile of all but black ones."""
_PERCENTILE = 99


def brightness(image: AnyFloats) -> Floats:
    """(..., C) to (...): the mean over the channels."""
    return np.asarray(np.mean(image, axis=-1, dtype=np.float64))


def lit_level(bright: Floats) -> float:
    """Above what brightness a pixel is lit; black pixels, however many there are, do not matter."""
    seen = bright[bright > 0]
    return LIT * float(np.percentile(seen, _PERCENTILE)) if seen.size else 0.0


def lit_pixels(image: ArrayLike) -> NDArray[np.bool_]:
    """Which pixels count in `Exposure.relative_error`: those brighter than a tenth of the 99th percentile.

    The percentile is that of the pixels above 0.

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


def relative_squares(bright: Floats, error: AnyFloats) -> Floats:
    """Squared relative error (...) of pixels: mean square over the channels (..., C), over brightness; 0 where dark."""
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # inf is what it is then
        squares = np.mean(np.square(error / bright[..., None], dtype=np.float64), axis=-1)
    return np.where(bright > 0, squares, 0.0)


def relative_error(image: AnyFloats, error: AnyFloats) -> float:
    """Root mean square of the relative errors of lit pixels; nan where there are neither lit pixels nor errors.

    inf where the error of any pixel is, since it may be lit.
    """
    if np.isinf(error).any():
        return float("inf")
    bright = brightness(image)
    lit = bright > lit_level(bright)
    if lit.any():
        return float(np.sqrt(np.mean(relative_squares(bright[lit], error[lit]))))
    return float("inf") if np.any(error) else float("nan")
