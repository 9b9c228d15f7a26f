"""White images as one plane of light above black, with the variance of its noise."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, plain_array
from plenoptic.errors import InvalidValueError
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure

MIN_SIDE = 24
"""Least rows and columns of an image."""
_DARK, _BRIGHT = 0.1, 99.5
"""Percentiles of the image taken as black and as full light."""
_MOSAIC = 0.02
"""Relative differences between pixels of even and odd rows and columns from which on they have colour filters."""
_SATURATED, _SPIKE = 0.2, 5.0
"""Fraction of lit pixels at the highest value that means saturation, and their number over that of the next values."""
_LEVELS, _MIN_SIGNAL = 24, 5.0
"""Levels of light at which noise is measured, and least light in standard deviations of the noise in the dark."""
_KERNEL, _MEDIAN, _QUARTILE = (1.0, -2.0, 1.0), 0.6745 * 6.0, 0.3186 * 6.0
"""Second difference, and median and first quartile of its size for noise of variance 1."""


class WhitePlane(NamedTuple):
    """Light above black, and its variance, (H, W)."""

    light: Floats
    variance: Floats
    has_black: bool
    """False if black is taken to be the darkest pixels, which may be lit where micro images touch."""


def white_plane(white: Any) -> WhitePlane:
    """Light of a white image, equalised over colour filters; raise InvalidValueError if none can be read from it."""
    black, full, variance = None, np.inf, None
    if isinstance(white, Exposure):
        if white.white is False:
            raise InvalidValueError("the image shows a scene; give a white image, as pl.render_white(camera) is")
        image, black = white.image, 0.0
        if white.standard_error is not None:
            channels = white.standard_error.astype(np.float64)
            variance = (channels**2).sum(axis=2) / channels.shape[2] ** 2
    elif isinstance(white, RawImage):
        image, black, full = white.data, white.black_level, white.white_level
    elif isinstance(white, (list, tuple)) or hasattr(white, "__array__"):
        image = plain_array(white, "white")
    else:
        raise InvalidValueError(
            f"white is a {type(white).__name__}; give an array of numbers, an Exposure or a RawImage"
        )
    if image.ndim not in (2, 3) or min(image.shape[:2]) < MIN_SIDE or image.shape[2:] not in ((), (1,), (3,)):
        raise InvalidValueError(
            f"the white image has shape {image.shape}; give rows and columns, at least {MIN_SIDE}, and 1 or 3 channels"
        )
    if not np.isfinite(image).all():
        raise InvalidValueError("the white image holds values that are not finite; correct them")
    if not isinstance(white, Exposure):
        _check_saturation(image, full)
    plane = image.astype(np.float64).reshape(*image.shape[:2], -1).mean(axis=2)
    plane -= np.percentile(mean_filter(plane), _DARK) if black is None else black
    is_mosaic = image.ndim == 2 and not isinstance(white, Exposure) and equalise(plane)
    if variance is None:
        variance = noise_variance(plane, is_mosaic)
        noise, bright = float(np.sqrt(variance.min())), float(np.percentile(plane, _BRIGHT))
        if not bright > _MIN_SIGNAL * noise or (image.dtype.kind in "iu" and bright < _MIN_SIGNAL):
            raise InvalidValueError(
                f"the white image is too dark: its light reaches {bright:.3g} above black, and its noise is "
                f"{noise:.2g}; expose longer"
            )
    return WhitePlane(plane, variance, black is not None)


def _check_saturation(image: NDArray[Any], full: float) -> None:
    """Raise InvalidValueError if values pile up at the highest."""
    values, counts = np.unique(np.minimum(image, full), return_counts=True)
    lit = counts[values > 0.5 * (values[0] + values[-1])].sum()
    piled = counts[-1] / max(lit, 1)
    is_spike = counts[-1] > _SPIKE * counts[-4:-1].mean() and piled > 0.005 if len(values) > 4 else piled > 0.5
    if (is_spike or piled > _SATURATED) and values[-1] > values[0]:
        raise InvalidValueError(
            f"the white image is saturated: {100 * piled:.2g} % of its bright pixels have its highest value "
            f"{values[-1]:g}; expose shorter"
        )


def mean_filter(plane: Floats) -> Floats:
    """Means of 3 x 3 pixels, without the border."""
    rows = plane[:-2] + plane[1:-1] + plane[2:]
    return np.asarray((rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 9.0)


def equalise(plane: Floats) -> bool:
    """Scale pixels of even and odd rows and columns to the same mean in place, as of colour filters; False if alike."""
    parts = [plane[i::2, j::2] for i in (0, 1) for j in (0, 1)]
    means = np.array([part.mean() for part in parts])
    if not (means > 0).all() or np.ptp(means) < _MOSAIC * means.mean():
        return False
    for part, mean in zip(parts, means, strict=True):
        part *= means.mean() / mean
    return True


def noise_variance(plane: Floats, is_mosaic: bool) -> Floats:
    """Variance of the noise of each pixel, linear in its light, from second differences in both directions.

    After J. Immerkaer, Computer Vision and Image Understanding 64(2), 1996, doi:10.1006/cviu.1996.0060, at the levels
    of light where they are least: at the others they contain the rims of micro images.
    """
    line = min((_noise_line(plane, step) for step in ((1, 2) if is_mosaic else (1,))), key=sum)
    return np.asarray(line[0] + line[1] * np.maximum(plane, 0.0) / max(float(np.percentile(plane, _BRIGHT)), 1e-300))


def _noise_line(plane: Floats, step: int) -> tuple[float, float]:
    """Variance in the dark, and what full light adds to it, by differences between pixels `step` apart."""
    rows, columns = (n - 2 * step for n in plane.shape)
    starts = range(0, 3 * step, step)
    parts = [[plane[i : i + rows, j : j + columns] for j in starts] for i in starts]
    lines = [sum(b * part for b, part in zip(_KERNEL, row, strict=True)) for row in parts]
    detail = np.abs(sum(a * line for a, line in zip(_KERNEL, lines, strict=True)))
    mean = np.asarray(sum(p for row in parts for p in row) / 9.0)
    levels = np.array_split(np.argsort(mean, axis=None), _LEVELS)
    light = np.array([np.ravel(mean)[k].mean() for k in levels])
    variance = np.array([(np.median(np.ravel(detail)[k]) / _MEDIAN) ** 2 for k in levels])
    bright = light >= 0.5 * light[-1]
    calm = np.quantile(variance[bright], 0.25)
    dark = min((float(np.quantile(np.ravel(detail)[levels[0]], 0.25)) / _QUARTILE) ** 2, float(calm))
    return dark, float(np.quantile(((variance - dark) / np.maximum(light, 1e-300))[bright], 0.25) * light[-1])
