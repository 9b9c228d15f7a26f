"""Radiance of rays that hit nothing, and directions sampled by the light of an environment: device functions.

The map's axes are those of `environment.EnvironmentMap`; `rotation` is (9,), from them to the world, or None.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.vectors import dot, sub
from plenoptic.core.numba.jit import device

INSIDE = 2.0**-30
"""Drawn directions keep this part of a texel's extent off its borders, so that rounding leaves them in it."""


@device
def sample_cdf(cdf, u):
    """Index of the entry of a cumulative distribution that holds u, and u stretched to [0, 1) within it."""
    return _bisect(cdf, u, 0, cdf.size - 1)


@device
def _bisect(cdf, u, low, high):
    """Find an entry as `sample_cdf` does, within low and high."""
    while low < high:
        middle = (low + high) // 2
        if cdf[middle] > u:
            high = middle
        else:
            low = middle + 1
    before = cdf[low - 1] if low > 0 else 0.0
    return low, min(max((u - before) / (cdf[low] - before), 0.0), 1.0)


@device
def sample_long_cdf(cdf, u):
    """Find an entry as `sample_cdf` does, for long tables: the search begins where u lies for equal shares.

    From there it goes outwards in growing steps, then bisects: a row of a large map is rarely in the cache.
    """
    last = cdf.size - 1
    guess = min(int(u * cdf.size), last)
    step = 4
    if cdf[guess] > u:
        high = guess
        while high - step >= 0 and cdf[high - step] > u:
            high -= step
            step *= 4
        low = max(high - step + 1, 0)
    else:
        low = guess + 1
        while low + step <= last and not cdf[low + step] > u:
            low += step + 1
            step *= 4
        high = min(low + step, last)
    return _bisect(cdf, u, low, high)


@device
def environment_texel(d, rows, columns, rotation):
    """Row and column of the texel in which a direction of the world lies; its length is of no account."""
    x, y, z = d
    if rotation is not None:
        # The transpose turns back.
        x = rotation[0] * d[0] + rotation[3] * d[1] + rotation[6] * d[2]
        y = rotation[1] * d[0] + rotation[4] * d[1] + rotation[7] * d[2]
        z = rotation[2] * d[0] + rotation[5] * d[1] + rotation[8] * d[2]
    polar = math.atan2(math.sqrt(x * x + z * z), y)
    azimuth = math.atan2(x, -z)
    row = int(polar * (rows / math.pi))
    column = int((azimuth + math.pi) * (columns / (2.0 * math.pi)))
    return max(0, min(row, rows - 1)), max(0, min(column, columns - 1))


@device
def sample_environment(u, v, rows_cdf, columns_cdf, rotation):
    """A unit vector drawn by the light that comes from there, from u and v in [0, 1), and row and column of its texel.

    Its probability per steradian is `Environment.pdf[row, column]`.
    """
    rows, columns = columns_cdf.shape
    row, across = sample_cdf(rows_cdf, u)
    column, along = sample_long_cdf(columns_cdf[row], v)
    across = min(max(across, INSIDE), 1.0 - INSIDE)
    along = min(max(along, INSIDE), 1.0 - INSIDE)
    # Counted from the nearer pole, 1 - cos and the sine keep their digits however small the texels there are.
    up = 1.0 if 2 * row < rows else -1.0
    near = row if up > 0.0 else rows - row
    far = row + 1 if up > 0.0 else rows - row - 1
    first = math.sin(0.5 * math.pi * near / rows)
    last = math.sin(0.5 * math.pi * far / rows)
    height = 2.0 * (first * first + across * (last * last - first * first))
    sine = math.sqrt(height * (2.0 - height))
    azimuth = 2.0 * math.pi * (column + along) / columns - math.pi
    x, y, z = sine * math.sin(azimuth), up * (1.0 - height), -sine * math.cos(azimuth)
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


@device
def add_environment(color, direction, pdf, texels, texel_pdf, rotation, probability):
    """Add the texel that lies in a direction, which was drawn with a density."""
    row, column = environment_texel(direction, texels.shape[0], texels.shape[1], rotation)
    counts = weight(pdf, probability * texel_pdf[row, column])
    for c in range(color.size):
        color[c] += counts * texels[row, column, c]
