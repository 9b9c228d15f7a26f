"""The random numbers of paths in the scene: the kernel."""

from __future__ import annotations

from plenoptic.camera.sampling.kernels.path_indices import path_indices
from plenoptic.core.kernels.sobol import stream
from plenoptic.core.numba.jit import kernel


@kernel
def fill_path_keys(keys, indices, start, batch, number):
    """The random stream of each path of a bundle and the path's number in it."""
    for k in range(keys.size):
        pixel, replicate, index = path_indices(start + k, batch.samples, batch.streams)
        keys[k] = stream(batch.seed, number[pixel], batch.first_stream + replicate)
        indices[k] = batch.first_index + index
