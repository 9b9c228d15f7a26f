"""Random streams of paths in the scene."""

from __future__ import annotations

from plenoptic.camera.sampling.kernels.path_numbers import path_indices, replicate_size
from plenoptic.core.kernels.sobol import stream
from plenoptic.core.numba.jit import kernel


@kernel
def fill_path_keys(keys, indices, start, batch, number):
    """Random stream of each path of a bundle, and the path's index in it."""
    first = 0
    while first < keys.size:
        pixel, replicate, index = path_indices(start + first, batch.samples, batch.streams)
        end = min(first + replicate_size(replicate, batch.samples, batch.streams) - index, keys.size)
        key = stream(batch.seed, number[pixel], batch.first_stream + replicate)
        for k in range(first, end):
            keys[k] = key
            indices[k] = batch.first_index + index + k - first
        first = end
