"""Moments of the light in windows of an image, one around each micro image."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

_PIXELS = 1 << 16
"""Pixels that are summed together, within the processor's cache."""


class WindowMoments(NamedTuple):
    """Moments of the light in n windows; nan where a window is not whole in the image."""

    light: Floats
    """(n,): sum of the weighted pixels."""
    centroid: Floats
    """(n, 2): row and column."""
    second: Floats
    """(n,): mean of the squared distance from the centroid, pixels^2."""
    error: Floats
    """(n, 2): standard error of the centroid, along rows and columns; 0 without variances."""

    def rows(self, chosen: NDArray[np.bool_]) -> WindowMoments:
        """Moments of some of the windows."""
        return WindowMoments(*(part[chosen] for part in self))


def window_moments(
    image: Floats,
    centre: Floats,
    reach: int,
    weights: Callable[[slice, Floats], Floats],
    variance: Floats | None = None,
) -> WindowMoments:
    """Moments of an image (H, W) in windows around points (n, 2), row and column.

    `weights(part, offset)` are the weights (m, k) of pixels at offsets (m, k, 2) from the m points of a part of them,
    at most `reach` pixels from the pixel nearest to the point. `variance` is that of each pixel.
    """
    is_finite = np.asarray(np.isfinite(centre).all(axis=1))
    nearest = np.rint(np.where(is_finite[:, None], centre, -1e6)).astype(np.int64)
    is_whole = np.asarray(((nearest >= reach) & (nearest + reach < np.array(image.shape))).all(axis=1))
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    light, centroid, second, error = (np.full((len(centre), n), np.nan) for n in (1, 2, 1, 2))
    size = max(1, _PIXELS // len(steps))
    for first in range(0, len(centre), size):
        part = slice(first, first + size)
        pixel = np.where(is_whole[part, None], nearest[part], reach)[:, None] + steps
        offset = pixel - centre[part, None]
        weight = weights(part, offset)
        values = weight * image[pixel[..., 0], pixel[..., 1]]
        with np.errstate(invalid="ignore", divide="ignore"):
            light[part, 0] = total = values.sum(axis=1)
            mean = np.einsum("nk,nkc->nc", values, offset) / total[:, None]
            second[part, 0] = np.einsum("nk,nkc,nkc->n", values, offset, offset) / total - (mean**2).sum(axis=1)
            centroid[part] = centre[part] + mean
            if variance is not None:
                noise = weight**2 * variance[pixel[..., 0], pixel[..., 1]]
                spread = np.einsum("nk,nkc->nc", noise, (offset - mean[:, None]) ** 2)
                error[part] = np.sqrt(spread) / np.abs(total[:, None])
    for array in (light, centroid, second, error):
        array[~is_whole] = np.nan
    return WindowMoments(light[:, 0], centroid, second[:, 0], error if variance is not None else 0.0 * centroid)
