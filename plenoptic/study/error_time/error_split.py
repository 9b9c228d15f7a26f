"""The squared error of rendered images, split into variance and squared bias.

Errors are relative, and means over lit pixels (`core.relative_error`). Channels of a pixel count together: with the
image x and the reference r, the squared error of a pixel is mean((x - r)^2) / mean(r)^2, means over the channels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.relative_error import brightness, lit_pixels
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.exposure import Exposure


class Split(NamedTuple):
    """Parts of the squared error of one setting: the last fields of an `ErrorRow`."""

    variance: float
    variance_error: float
    bias_squared: float
    bias_squared_error: float
    reported_variance: float | None


class Reference(NamedTuple):
    """A converged image, its variance, and the lit pixels, over which errors are means."""

    image: Floats
    """(n, C): the lit pixels."""
    variance: Floats
    """(n, C): of `image`, from its standard errors."""
    lit: NDArray[np.bool_]
    """(H, W)."""

    @property
    def squared_error(self) -> float:
        """Mean squared relative error of the reference itself."""
        return float(np.mean(self.relative_squares(self.variance)))

    def relative_squares(self, squares: Floats) -> Floats:
        """Squares (n, C) of the lit pixels as relative ones of each pixel, (n,)."""
        relative: Floats = brightness(squares) / brightness(self.image) ** 2
        return relative


def reference_of(exposure: Exposure) -> Reference:
    """The reference of a converged exposure with standard errors."""
    if exposure.standard_error is None:
        raise InvalidValueError("the reference has no standard errors; render it with replicates of at least 2")
    if not np.isfinite(exposure.standard_error).all():
        raise InvalidValueError("the reference has infinite standard errors: some of its pixels have no samples")
    image = exposure.image.astype(np.float64)
    lit = lit_pixels(image)
    if not lit.any():
        raise InvalidValueError("the reference is black, so that no error is relative to it; choose another region")
    return Reference(image[lit], exposure.standard_error[lit].astype(np.float64) ** 2, lit)


def split_error(exposures: Sequence[Exposure], reference: Reference) -> Split:
    """Split the squared error of 2 or more renders that differ in their seeds alone.

    With S images x_s of mean m and sample variance v, and a reference r of variance w, per pixel and channel,

        variance     = v
        bias squared = (m - r)^2 - v / S - w

    Both are unbiased for any error of the reference, and add up to mean((x_s - r)^2) - w. Standard errors
    are those of means over pixels, since random numbers of different pixels are independent. They include the true
    differences among pixels, so that they are rather too large where there is a bias.
    """
    count = len(exposures)
    if count < 2:
        raise InvalidValueError(f"there are {count} renders; a split needs at least 2")
    channels = {shot.image.shape[2] for shot in exposures} | {reference.image.shape[1]}
    if len(channels) > 1:
        raise InvalidValueError(
            f"renders and reference have {' and '.join(map(str, sorted(channels)))} channels; both must have the same"
        )
    images = np.stack([shot.image[reference.lit] for shot in exposures]).astype(np.float64)
    noise = np.var(images, axis=0, ddof=1)
    difference = (np.mean(images, axis=0) - reference.image) ** 2 - noise / count - reference.variance
    variance, bias_squared = (_mean_over_pixels(reference.relative_squares(part)) for part in (noise, difference))
    return Split(*variance, *bias_squared, _reported_variance(exposures, reference))


def _reported_variance(exposures: Sequence[Exposure], reference: Reference) -> float | None:
    errors = [shot.standard_error for shot in exposures]
    squares = [error[reference.lit].astype(np.float64) ** 2 for error in errors if error is not None]
    if len(squares) < len(errors):
        return None
    return float(np.mean(reference.relative_squares(np.mean(squares, axis=0))))


def _mean_over_pixels(values: Floats) -> tuple[float, float]:
    """Mean and its standard error, which is infinite for a single pixel."""
    error = float(np.std(values, ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else math.inf
    return float(np.mean(values)), error
