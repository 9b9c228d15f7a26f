"""Numbers as they come: mostly sensible, sometimes over twelve orders of magnitude.

All is drawn from a `random.Random` of hypothesis, by one number that hypothesis draws: it would otherwise repeat large
parts of one example in the next ones, and of 2000 examples some 700 were different. With
``st.randoms(use_true_random=False)`` hypothesis shrinks what fails.
"""

import math

import numpy as np

WILD = 12
"""One length in so many is up to a million times too small or too large."""
END = 30
"""One number in so many is an end of its range."""


def chance(rnd, one_in):
    """True once in so many times."""
    return rnd.randrange(one_in) == one_in - 1


def uniform(rnd, low, high):
    return rnd.choice([low, high]) if chance(rnd, END) else rnd.uniform(low, high)


def table(rnd, low, high, *shape):
    return np.array([uniform(rnd, low, high) for _ in range(math.prod(shape))]).reshape(shape)


def length(rnd, scale, *, spread=1.0):
    """Above 0, mostly within 10^spread of the scale, sometimes within 10^6."""
    return scale * 10.0 ** (uniform(rnd, -1.0, 1.0) * (6.0 if chance(rnd, WILD) else spread))


def signed(rnd, scale, **how):
    return length(rnd, scale, **how) * rnd.choice([1.0, -1.0])


def angle(rnd, largest):
    return uniform(rnd, -largest, largest)


def rotation(rnd):
    """(3, 3), any; from a unit quaternion (K. Shoemake, Uniform random rotations, Graphics Gems III, 1992)."""
    u, v, w = (uniform(rnd, 0.0, 1.0) for _ in range(3))
    a, b = math.sqrt(1.0 - u), math.sqrt(u)
    x, y = a * math.sin(2 * math.pi * v), a * math.cos(2 * math.pi * v)
    z, r = b * math.sin(2 * math.pi * w), b * math.cos(2 * math.pi * w)
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # v x
    return np.eye(3) + 2 * r * across + 2 * across @ across


def colour(rnd, brightest=1.0):
    """One number or red, green and blue, from 0 to the brightest."""
    if chance(rnd, 2):
        return uniform(rnd, 0.0, brightest)
    return tuple(uniform(rnd, 0.0, brightest) for _ in range(3))
