"""Radiance of rays that hit nothing, and directions sampled by the light of an environment: device functions.

The map's axes are those of `environment.EnvironmentMap`; `rotation` is (9,), from them to the world, or None.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.arctan import arctan2
from plenoptic.core.kernels.sincos import turn
from plenoptic.core.kernels.vectors import dot, sub
from plenoptic.core.numba.jit import device

INSIDE = 2.0**-30
"""Drawn directions keep this part of a texel's extent off its borders, so that rounding leaves them in it."""


@device
def sample_cdf(cdf, u):
    """Index of the entry of a cumulative distribution that holds u, and u stretched to [0, 1) within it."""
    low, high = 0, cdf.size - 1
    while low < high:
        middle = (low + high) // 2
        if cdf[middle] > u:
            high = middle
        else:
            low = middle + 1
    return low, _stretch(cdf, low, u)


@device
def sample_guided_cdf(cdf, guide, u):
    """Find an entry as `sample_cdf` does, by a guide table: guide[int(u guide.size)] is where the search begins.

    H.-C. Chen and Y. Asau, AIIE Transactions 6, 163 (1974). The size of the table is a power of two.
    """
    k = int(guide[int(u * guide.size)])
    while cdf[k] <= u:
        k += 1
    return k, _stretch(cdf, k, u)


@device
def _stretch(cdf, k, u):
    """U from the extent of entry k to [0, 1)."""
    before = cdf[k - 1] if k > 0 else 0.0
    return min(max((u - before) / (cdf[k] - before), 0.0), 1.0)


@device
def map_axes(rotation):
    """Axes of the map in the world: scalars, so that loops need not read them again."""
    if rotation is None:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    return (
        (rotation[0], rotation[3], rotation[6]),
        (rotation[1], rotation[4], rotation[7]),
        (rotation[2], rotation[5], rotation[8]),
    )


@device
def map_angles(direction, axes):
    """Polar angle from the map's +y, and azimuth from its -z, of a direction of the world of any length."""
    x, y, z = dot(axes[0], direction), dot(axes[1], direction), dot(axes[2], direction)
    return arctan2(math.sqrt(x * x + z * z), y), arctan2(x, -z)


@device
def texel_at(angles, rows, columns):
    """Row and column of the texel at a polar angle and azimuth."""
    row, column = int(angles[0] * (rows / math.pi)), int((angles[1] + math.pi) * (columns / (2.0 * math.pi)))
    return max(0, min(row, rows - 1)), max(0, min(column, columns - 1))


@device
def sample_environment(u, v, environment):
    """A unit vector drawn by the light that comes from there, from u and v in [0, 1), and row and column of its texel.

    Its probability per steradian is `Environment.pdf[row, column]`.
    """
    columns, rotation = environment.columns_cdf.shape[1], environment.rotation
    row, across = sample_guided_cdf(environment.rows_cdf, environment.rows_guide, u)
    column, along = sample_guided_cdf(environment.columns_cdf[row], environment.columns_guide[row], v)
    across = min(max(across, INSIDE), 1.0 - INSIDE)
    along = min(max(along, INSIDE), 1.0 - INSIDE)
    # Counted from the nearer pole, 1 - cos and the sine keep their digits however small the texels there are.
    first, last, up = environment.edges[row, 0], environment.edges[row, 1], environment.edges[row, 2]
    height = first + across * (last - first)
    sine = math.sqrt(height * (2.0 - height))
    # Azimuth plus pi, as a fraction of a turn.
    c, s = turn((column + along) / columns)
    x, y, z = -sine * s, up * (1.0 - height), sine * c
    if rotation is None:
        return (x, y, z), row, column
    turned = (
        rotation[0] * x + rotation[1] * y + rotation[2] * z,
        rotation[3] * x + rotation[4] * y + rotation[5] * z,
        rotation[6] * x + rotation[7] * y + rotation[8] * z,
    )
    return turned, row, column


@device
def weight(pdf, other):
    """Weight of a direction sampled with density `pdf` that another method samples with `other` (power heuristic)."""
    if pdf < 0.0 or other <= 0.0:
        return 1.0
    if not pdf > 0.0:
        return 0.0
    ratio = other / pdf
    return 1.0 / (1.0 + ratio * ratio)


@device
def add_suns(color, direction, pdf, suns, sun_colors):
    """Add the discs of suns that lie in a direction, which was drawn with a density."""
    for s in range(suns.shape[0]):
        sun = suns[s]
        if sun.cap > 0.0:
            off = sub(direction, (sun.x, sun.y, sun.z))
            # |d - s|^2 = 2 (1 - cos), without the cancellation of 1 - cos.
            if 0.5 * dot(off, off) < sun.cap:
                counts = weight(pdf, sun.pdf / (2.0 * math.pi * sun.cap))
                for c in range(color.size):
                    color[c] += counts * sun_colors[s, c]
