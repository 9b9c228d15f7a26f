"""What paths add to the sums of pixels: the kernels."""

from __future__ import annotations

from plenoptic.camera.sampling.kernels.paths import path_place, replicate_size
from plenoptic.core.jit import kernel
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT


@kernel
def fill_sums(sums, blocks, radiance, waves, weights, start, n, batch):
    """Add what the paths of a bundle bring to sums (pixels, streams, channels), in the order of their numbers.

    The last row of a pixel's sums gets the squares of what its paths bring, those of all streams.

    `radiance` is (n, channels), or None for 1 everywhere: a white image. With `weights` (wavelengths, channels), each
    path has a wavelength, its radiance is one number, and the weights are what that adds to the channels. Returns how
    many contributions were not finite; these are left out.
    """
    broken = 0
    samples, streams = batch.samples, batch.streams
    path = start
    end = start + n
    while path < end:
        pixel, stream, index = path_place(path, samples, streams)
        run = min(replicate_size(stream, samples, streams) - index, end - path)
        for c in range(sums.shape[2]):
            total, squares = sums[pixel, stream, c], sums[pixel, -1, c]
            for k in range(path - start, path - start + run):
                light = blocks[(k // BLOCK) * RAY + WEIGHT + k % BLOCK]
                if weights is not None:
                    light *= weights[waves[k], c]
                    if radiance is not None:
                        light *= radiance[k, 0]
                elif radiance is not None:
                    light *= radiance[k, c]
                if light - light == 0.0:
                    total += light
                    squares += light * light
                else:
                    broken += 1
            sums[pixel, stream, c], sums[pixel, -1, c] = total, squares
        path += run
    return broken


@kernel
def fill_clamped(radiance, blocks, n, limit):
    """Scale down what paths bring that is brighter than a limit; returns the light that is kept and that is not."""
    kept, removed = 0.0, 0.0
    for k in range(n):
        brightest, mean = 0.0, 0.0
        for c in range(radiance.shape[1]):
            brightest = max(brightest, radiance[k, c])
            mean += radiance[k, c] / radiance.shape[1]
        light = mean * blocks[(k // BLOCK) * RAY + WEIGHT + k % BLOCK]
        fraction = 1.0
        if brightest > limit:
            fraction = limit / brightest
            for c in range(radiance.shape[1]):
                radiance[k, c] *= fraction
        kept += fraction * light
        removed += (1.0 - fraction) * light
    return kept, removed
