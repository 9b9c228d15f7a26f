"""Colours: one number, or red, green and blue, or a texture of such."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from plenoptic.core.values import finite
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.textures.texture import Texture

Colour: TypeAlias = float | tuple[float, float, float]


def as_colour(colour: Any, name: str, *, at_most: float = np.inf) -> Colour:
    """One number or (red, green, blue), each finite and within 0 and a limit, as floats."""
    try:
        shape = np.shape(colour)
    except ValueError:
        raise InvalidValueError(f"{name} is {colour!r}; it must be one number or (red, green, blue)") from None
    if shape not in ((), (3,)):
        raise InvalidValueError(f"{name} has shape {shape}; it must be one number or (red, green, blue)")
    parts = [finite(part, name) for part in ([colour] if shape == () else colour)]
    if min(parts) < 0 or max(parts) > at_most:
        limit = "0 or more" if at_most == np.inf else f"within 0 and {at_most:g}"
        raise SceneError(f"{name} is {parts[0] if shape == () else tuple(parts)}; it must be {limit}")
    return parts[0] if shape == () else (parts[0], parts[1], parts[2])


def as_texture_or_colour(colour: Any, name: str, *, at_most: float = np.inf) -> Colour | Texture:
    """A colour, or a texture none of whose texels is above the limit."""
    if not isinstance(colour, Texture):
        return as_colour(colour, name, at_most=at_most)
    if (brightest := float(colour.texels.max())) > at_most:
        raise SceneError(f"{name} has texels up to {brightest:g}; it must be {at_most:g} or less, so scale the texture")
    return colour


def as_fraction(fraction: Any, name: str) -> float:
    """A number within 0 and 1."""
    number = finite(fraction, name)
    if not 0 <= number <= 1:
        raise SceneError(f"{name} is {number:g}; it must be within 0 and 1")
    return number


def as_index(index: Any, name: str = "index") -> float:
    """A real refractive index."""
    number = finite(index, name)
    if not number > 0:
        raise SceneError(f"{name} is {number:g}; it must be above 0")
    return number


def as_share(share: Any, name: str) -> float | Texture:
    """A number within 0 and 1, or a texture of one channel of such numbers."""
    if not isinstance(share, Texture):
        return as_fraction(share, name)
    if share.texels.shape[2] != 1:
        raise InvalidValueError(f"{name} is a texture of {share.texels.shape[2]} channels; it must have 1")
    as_texture_or_colour(share, name, at_most=1.0)
    return share


def is_grey(colour: complex | tuple[complex, complex, complex] | Texture) -> bool:
    """True if red, green and blue are the same."""
    return colour.is_grey if isinstance(colour, Texture) else len(set(np.ravel(colour).tolist())) == 1


def mean_colour(colour: Colour | Texture) -> Colour:
    """The colour itself, or the mean of a texture's texels."""
    if not isinstance(colour, Texture):
        return colour
    mean = colour.texels.mean(axis=(0, 1), dtype=np.float64)
    return float(mean[0]) if mean.size == 1 else (float(mean[0]), float(mean[1]), float(mean[2]))
