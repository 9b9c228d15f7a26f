"""Sampling points: Owen-scrambled Sobol points as a function of seed, pixel, replicate, set and index."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.sobol import DIMENSIONS, fill_points
from plenoptic.core.values import MAX_POINTS, Floats, seed_number, whole


def sobol_points(n: int, *, seed: int = 0, pixel: int = 0, replicate: int = 0, set_number: int = 0) -> Floats:
    """The first points of one pixel's replicate, from which its paths are sampled.

    Parameters
    ----------
    n : int
        Number of points.
    seed, pixel, replicate : int
        Each combination is an independent scrambling; `pixel` counts row by row over the whole sensor.
    set_number : int
        0 for the camera (two dimensions for the pixel, two for the microlens plane), k for bounce k.

    Returns
    -------
    (n, 4) array
        Coordinates in [0, 1). Aligned groups of 2^k points are stratified: one falls in each of the 2^k intervals of
        each coordinate.

    Notes
    -----
    Sobol points after S. Joe and F. Y. Kuo, doi:10.1137/070709359; scrambling and shuffling by hashing after B. Burley,
    J. Comput. Graph. Tech. 9(4), 2020.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> points = pl.sampling.sobol_points(8, seed=1)
    >>> np.sort(np.floor(points[:, 2] * 8)).tolist()
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    """
    points = np.empty((whole(n, "n", at_least=0, at_most=MAX_POINTS), DIMENSIONS))
    counters = {"pixel": pixel, "replicate": replicate, "set_number": set_number}
    keys = [whole(k, name, at_least=0) for name, k in counters.items()]
    fill_points(points, np.uint64(seed_number(seed)), *keys)
    return points
