"""Random streams of paths in the scene."""

from __future__ import annotations

from plenoptic.camera.sampling.kernels.path_numbers import path_indices
from plenoptic.core.kernels.sobol import stream
from plenoptic.core.numba.jit import kernel


@kernel
def fill_path_keys(keys, indices, start, batch, number):
    """Random stream of each path of a bundle, and the path's index in it."""
    for k in range(keys.size):
        pixel, replicate, index = path_indices(start + k, batch.samples, batch.streams)
        keys[k] = stream(batch.seed, number[pixel], batch.first_stream + replicate)
        indices[k] = batch.first_index + index
