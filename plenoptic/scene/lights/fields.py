"""Common parts of the descriptions of lights: checks, and sums over their colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import LARGEST_LENGTH, Floats, frozen_array
from plenoptic.errors import SceneError
from plenoptic.scene.textures.color import Colour


def place_in_mm(vector: ArrayLike, name: str) -> Floats:
    """(3,), mm, read-only, with coordinates that Embree can hold."""
    place = frozen_array(vector, name=name, shape=(3,))
    if not np.all(np.abs(place) <= LARGEST_LENGTH):
        raise SceneError(f"{name} is {place.tolist()} mm; it must be finite and within {LARGEST_LENGTH:g} mm")
    return place


def unit_vector(vector: ArrayLike, name: str) -> Floats:
    """(3,), read-only: a direction of any length above 0, brought to length 1; to rounding so, it keeps its bits."""
    components = frozen_array(vector, name=name, shape=(3,))
    largest = float(np.abs(components).max())
    if not 0 < largest < np.inf:
        raise SceneError(f"{name} is {components.tolist()}; it must be finite and longer than 0")
    # The largest component first, so that squares neither overflow nor vanish.
    scaled = components / largest
    length = float(np.linalg.norm(scaled))
    if abs(length * largest - 1) <= 1e-15:
        return components
    return frozen_array(scaled / length, name=name, shape=(3,))


def direction_towards(start: Floats, target: ArrayLike, name: str) -> Floats:
    """(3,), unit length, from one point to another, both in mm."""
    towards = frozen_array(target, name="target", shape=(3,)) - start
    distance = float(np.linalg.norm(towards))
    if not 0 < distance < np.inf:
        raise SceneError(f"target is {distance:g} mm from {name} {start.tolist()}; it must be finite and above 0")
    return np.asarray(towards / distance)


def channel_mean(colour: Colour) -> float:
    """The number itself, or the mean of red, green and blue."""
    return sum(part / 3 for part in colour) if isinstance(colour, tuple) else colour


def times(colour: Colour, factor: float) -> Colour:
    """A colour times a number."""
    if isinstance(colour, tuple):
        return (colour[0] * factor, colour[1] * factor, colour[2] * factor)
    return colour * factor
