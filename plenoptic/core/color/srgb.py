"""Encoding of the integer codes of an image: sRGB or linear."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import AnyFloats, plain_array

# IEC 61966-2-1: a straight piece near black, a power elsewhere; the two meet at these values.
_SRGB_KNEE = 0.04045
_LINEAR_KNEE = 0.0031308


class Encoding(enum.IntEnum):
    """Encoding of the integer codes of an image; floating-point images are always linear.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [encoding.name for encoding in pl.images.Encoding]
    ['SRGB', 'LINEAR']
    """

    SRGB = 0
    """Colours encoded for displays (IEC 61966-2-1)."""
    LINEAR = 1
    """Proportional to the quantity: normals, roughness, opacity and other data."""


def srgb_to_linear(encoded: ArrayLike) -> AnyFloats:
    """Decode sRGB values in 0..1 to linear values in 0..1.

    The curve is continued above 1 and, as an odd function, below 0.

    Parameters
    ----------
    encoded : array_like
        Values of any shape; integers are not rescaled.

    Returns
    -------
    ndarray
        Of the same shape, in the floating-point type of the input (float64 for integers).

    References
    ----------
    IEC 61966-2-1:1999, section 5.2.

    Examples
    --------
    >>> import plenoptic as pl
    >>> float(pl.images.srgb_to_linear(0.5).round(4))
    0.214
    """
    return _odd(encoded, lambda size: np.where(size <= _SRGB_KNEE, size / 12.92, ((size + 0.055) / 1.055) ** 2.4))


def linear_to_srgb(linear: ArrayLike) -> AnyFloats:
    """Encode linear values in 0..1 as sRGB values in 0..1: the inverse of `srgb_to_linear`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> float(pl.images.linear_to_srgb(0.214).round(3))
    0.5
    """
    return _odd(linear, lambda size: np.where(size <= _LINEAR_KNEE, size * 12.92, 1.055 * size ** (1 / 2.4) - 0.055))


def _odd(values: ArrayLike, curve: Callable[[Any], Any]) -> AnyFloats:
    """A curve for values from 0, continued as an odd function; integers become float64."""
    array = plain_array(values, "values")
    floats = array if array.dtype.kind == "f" else array.astype(np.float64)
    signed: AnyFloats = np.copysign(curve(np.abs(floats)), floats)
    return signed
