"""One surface from air to glass, and rays to it."""

import math

import numpy as np

import plenoptic as pl


def one_surface(index=1.6, **shape):
    """A surface from air to glass with its vertex at z = 0: element 2."""
    surface = pl.Surface(thickness=1e3, medium=pl.ConstantMedium(index), **shape)
    front = [pl.CircularStop(1e5), pl.Surface(math.inf, 0.0, semi_diameter=1e4)]
    return pl.LensStack([*front, surface, pl.Surface(math.inf, semi_diameter=1e5)])


def beam(size, n, s=1.0, slant=1.0):
    """Rays from a plane 4 sizes before the surface to its disc; `slant` is how oblique."""
    rng = np.random.default_rng(3)
    target = np.column_stack([rng.uniform(-size, size, (n, 2)), np.zeros(n)])
    start = np.column_stack([target[:, :2] + slant * rng.uniform(-size, size, (n, 2)), np.full(n, -s * 4 * size)])
    return pl.RayBundle(start, target - start)
