"""Rays through a lens with notes on how it treats them: the kernel."""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
from plenoptic.core.numba.jit import kernel
from plenoptic.optics.lens.kernels.trace import trace_block


@kernel
def fill_conditions(blocks, log, lens, waves):
    """Trace a bundle as `fill_traced` does, and fill `log`.

    `log` (n_blocks, elements, LOG, BLOCK), elements in the order of travel; see `notes`.
    """
    index_ratios = None if waves is None else np.empty(BLOCK)
    for b in range(blocks.size // RAY):
        trace_block(blocks[b * RAY : (b + 1) * RAY], lens, waves, b * BLOCK, index_ratios, log[b], None)
