"""How a path ended."""

from __future__ import annotations

import enum


class PathEnding(enum.IntEnum):
    """How a path ended.

    Examples
    --------
    See `replay`.
    """

    LEFT_SCENE = 0
    """It met nothing more; in a white image, it left the lens."""
    ABSORBED = 1
    """The surface sent nothing on: it reflects nothing, or the direction that was drawn leads to the wrong side."""
    ROULETTE = 2
    """It was ended by chance after some bounces (Russian roulette); others like it count for more."""
    MAX_BOUNCES = 3
    """It was scattered as often as `max_bounces` allows."""
    NOTHING_AHEAD = 4
    """Nothing that a ray onwards could meet shines, so that none is sent: the direct light was the last."""
    NO_SURFACE = 5
    """float32 found a triangle, and float64 no distance to it: it has no area, or the ray starts on it."""
    LOST = 6
    """It did not get through microlens and lens; the last event has the cause."""
    UNLIT_PIXEL = 7
    """No light can reach the pixel; the renderer traces none of its paths."""
    NOT_FINITE = 8
    """What it brings is infinite or not a number; it was left out of the image."""
