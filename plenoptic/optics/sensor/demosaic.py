"""Demosaicing: interpolation of all channels at every pixel."""

from __future__ import annotations

import enum

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files import images
from plenoptic.core.values import Floats, choice
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.color_filter import Filters, bayer_from, channels_of, pattern_of


class DemosaicMethod(enum.IntEnum):
    """Interpolation of missing channels. See `RawImage`.

    All three produce false colours at edges, as real cameras do.

    References
    ----------
    H. S. Malvar, L. He and R. Cutler, ICASSP 2004, doi:10.1109/ICASSP.2004.1326587. H. Knutsson and C.-F. Westin,
    "Normalized and differential convolution", CVPR 1993, doi:10.1109/CVPR.1993.341081.
    """

    LINEAR = 0
    """Bilinear, Bayer patterns only (OpenImageIO)."""
    MHC = 1
    """Linear with a correction by the gradient of the pixel's own channel (Malvar, He and Cutler 2004), Bayer patterns
    only (OpenImageIO). Sharper; overshoots at edges."""
    WEIGHTED_MEAN = 2
    """Mean of the pixels of the channel within one period, weighted by a tent (normalised convolution), for any
    pattern; for Bayer patterns the same as LINEAR away from the borders."""


_ALGORITHMS = {DemosaicMethod.LINEAR: "linear", DemosaicMethod.MHC: "MHC"}
"""Names of the algorithms in OpenImageIO."""


def demosaic(mosaic: Floats, filters: Filters, first: tuple[int, int], method: DemosaicMethod) -> NDArray[np.float32]:
    """(H, W, 3) image from a mosaic (H, W) whose first pixel is the sensor's pixel `first` (row, column)."""
    method = choice(method, DemosaicMethod, "method")
    if method == DemosaicMethod.WEIGHTED_MEAN:
        return _weighted_mean(mosaic, channels_of(filters, mosaic.shape, first), pattern_of(filters).shape)
    pattern = bayer_from(filters, first)
    if pattern is None:
        raise InvalidValueError(f"method is {method.name}, which supports Bayer patterns only; use WEIGHTED_MEAN")
    if min(mosaic.shape) < 2:
        raise InvalidValueError(
            f"the raw image has {mosaic.shape} pixels; demosaicing needs at least 2 rows and columns"
        )
    return images.bayer_to_rgb(mosaic, layout=pattern.name, algorithm=_ALGORITHMS[method])


def _weighted_mean(mosaic: Floats, channels: NDArray[np.int64], period: tuple[int, ...]) -> NDArray[np.float32]:
    """Normalised convolution with a tent that extends to the next period; measured values stay unchanged."""
    rows, columns = mosaic.shape
    p, q = period
    picture = np.empty((rows, columns, 3), dtype=np.float32)
    for channel in range(3):
        is_measured = channels == channel
        values = np.pad(np.where(is_measured, mosaic, 0.0), ((p, p), (q, q)))
        mask = np.pad(is_measured.astype(np.float64), ((p, p), (q, q)))
        total, weights = np.zeros(mosaic.shape), np.zeros(mosaic.shape)
        for i in range(1 - p, p):
            for j in range(1 - q, q):
                weight = (1.0 - abs(i) / p) * (1.0 - abs(j) / q)
                window = np.s_[p + i : p + i + rows, q + j : q + j + columns]
                total += weight * values[window]
                weights += weight * mask[window]
        if not weights.all():
            raise InvalidValueError(
                f"some pixels have none of channel {channel} within one period of {p} x {q}; give the pattern all "
                "of 0, 1 and 2, and the image at least one period"
            )
        picture[:, :, channel] = np.where(is_measured, mosaic, total / weights)
    return picture
