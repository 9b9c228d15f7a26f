"""Rays through a stack with notes on how it treats them: the kernels."""

from __future__ import annotations

import numpy as np

from plenoptic.core.jit import kernel
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
from plenoptic.optics.lens.kernels.trace import trace_block


@kernel
def fill_conditions(
    blocks, told, kind, z, c, mu, clear, rim, number, edges, first_edge, conic, aspheric, frames, masks, s
):
    """Trace a bundle as `fill_traced` does, and fill `told`.

    `told` (n_blocks, elements, TOLD, BLOCK), elements in the order of travel; see `notes`.
    """
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        trace_block(
            ray,
            None,
            None,
            None,
            0,
            kind,
            z,
            c,
            mu,
            clear,
            rim,
            number,
            edges,
            first_edge,
            conic,
            aspheric,
            frames,
            masks,
            s,
            told[b],
        )


@kernel
def fill_conditions_waves(
    blocks, told, waves, kind, z, c, mu, clear, rim, number, edges, first_edge, conic, aspheric, frames, masks, s
):
    """The same for rays with wavelengths of their own, as `fill_traced_waves`."""
    mus, common = np.empty(BLOCK), mu[:, 0].copy()
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        trace_block(
            ray,
            mus,
            mu,
            waves,
            b * BLOCK,
            kind,
            z,
            c,
            common,
            clear,
            rim,
            number,
            edges,
            first_edge,
            conic,
            aspheric,
            frames,
            masks,
            s,
            told[b],
        )
