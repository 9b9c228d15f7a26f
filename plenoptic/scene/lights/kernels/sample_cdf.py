"""Drawing from a table of probabilities: a device function."""

from __future__ import annotations

from plenoptic.core.jit import device


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
    before = cdf[low - 1] if low > 0 else 0.0
    return low, min(max((u - before) / (cdf[low] - before), 0.0), 1.0)
