"""Bundles of rays, which are whole blocks."""

from __future__ import annotations

from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS


@device
def pad(blocks, n):
    """Fill the last block from ray n on with rays that are lost already."""
    for path in range(n, blocks.size // 8):
        ray = blocks[(path // BLOCK) * RAY : (path // BLOCK + 1) * RAY]
        i = path % BLOCK
        for row in range(8):
            ray[row * BLOCK + i] = 0.0
        ray[STATUS + i] = MISSED


@kernel
def fill_status_counts(counts, blocks, n):
    """Count the rays of a bundle by their status."""
    for k in range(n):
        counts[int(blocks[(k // BLOCK) * RAY + STATUS + k % BLOCK])] += 1
