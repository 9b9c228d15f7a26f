"""What paths add to the sums of pixels: the kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.kernels.paths import path_place, replicate_size
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.numba.jit import device, kernel
from plenoptic.core.values import Floats


class Light(NamedTuple):
    """What the paths of a bundle bring."""

    blocks: Floats
    """The bundle, with what paths weigh."""
    radiance: Floats | None
    """(n, channels); None for 1 everywhere: a white image."""
    waves: NDArray[np.int64] | None
    """Numbers of their wavelengths. Their radiance is then one number. None where there is one for all."""
    weights: Floats | None
    """(wavelengths, channels): what they add to channels."""


@device
def _brought(light, k, c):
    """What path k of a bundle brings to channel c."""
    found = light.blocks[(k // BLOCK) * RAY + WEIGHT + k % BLOCK]
    if light.weights is not None:
        found *= light.weights[light.waves[k], c]
        if light.radiance is not None:
            found *= light.radiance[k, 0]
    elif light.radiance is not None:
        found *= light.radiance[k, c]
    return found


@kernel
def fill_sums(sums, bundle, start, n, batch):
    """Add what the paths of a bundle bring to sums (pixels, streams, channels), in the order of their numbers.

    The last row of a pixel's sums gets the squares of what its paths bring, those of all streams.

    The bundle is `Light`. Returns how many contributions were not finite; these are left out.
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
                light = _brought(bundle, k, c)
                if light - light == 0.0:
                    total += light
                    squares += light * light
                else:
                    broken += 1
            sums[pixel, stream, c], sums[pixel, -1, c] = total, squares
        path += run
    return broken


@kernel
def fill_kernel_sums(sums, place, bundle, levels, shares, start, n, batch):
    """Share what the paths of a bundle bring between pixels.

    `sums` are (places, replicates, channels, pixels) and, of squares, (places, channels, pixels); `place` are those of
    pixels, `shares` a row of a `SpreadTable` for each path, and its rows. `levels` (places,) is light that is known to
    be about there, of which only what paths bring more or less is shared; None for nothing. For the rest see
    `fill_sums`.
    """
    broken = 0
    spots, parts = shares
    for k in range(n):
        pixel, stream, _ = path_place(start + k, batch.samples, batch.streams)
        at, replicate, row = place[pixel], (batch.first_stream + stream) % sums[0].shape[1], parts[spots[k]]
        for c in range(sums[0].shape[2]):
            light, means, squares = _brought(bundle, k, c), sums[0][at, replicate, c], sums[1][at, c]
            if levels is not None:
                if bundle.weights is not None:
                    light -= levels[at] * bundle.weights[bundle.waves[k], c]
                else:
                    light -= levels[at]
            if light - light == 0.0:
                for to in range(row.size):
                    part = light * row[to]
                    means[to] += part
                    squares[to] += part * part
            else:
                broken += 1
    return broken


@kernel
def fill_pilot_means(levels, place, blocks, start, n, batch):
    """Add the mean of what the paths of a bundle of a white image bring, before weights of wavelengths."""
    for k in range(n):
        light = blocks[(k // BLOCK) * RAY + WEIGHT + k % BLOCK]
        if light - light == 0.0:
            levels[place[path_place(start + k, batch.samples, batch.streams)[0]]] += light / batch.samples


@kernel
def fill_drawn(sums, bundle, start, n, drawn, batch, every):
    """Add what drawn bends bring to pixels, each for all samples of a batch that it stands for.

    `sums` are (pixels, replicates, channels) and, of squares, (pixels, channels); `drawn` is the batch of the bends.
    For the rest see `fill_sums`.
    """
    broken = 0
    means, squares = sums
    for k in range(n):
        pixel, stream, index = path_place(start + k, drawn.samples, drawn.streams)
        replicate, begin = (batch.first_stream + stream) % means.shape[1], (drawn.first_index + index) * every
        end = batch.first_index + replicate_size(stream, batch.samples, batch.streams)
        count = min(begin + every, end) - max(begin, batch.first_index)
        for c in range(means.shape[2]):
            light = _brought(bundle, k, c)
            if light - light == 0.0:
                means[pixel, replicate, c] += count * light
                squares[pixel, c] += count * light * light
            else:
                broken += 1
    return broken


@kernel
def fill_pixel_totals(whole, shared, known, drawn, givers, batch, part, every):
    """Add up what pixels get of the samples of a batch: shares of light at `givers`, what is `known` (pixels, channels)
    of a sample, and `part` of the drawn bends.

    The last row of `whole` (pixels, replicates + 1, channels) gets the square of what all bring over their number, and
    how much what they bring differs: a drawn bend stands for `every` samples, and differs as much more.
    """
    replicates, (shared, shared_squares), (drawn, drawn_squares) = whole.shape[1] - 1, shared, drawn
    samples, counts = batch.samples, np.zeros(replicates)
    for stream in range(batch.streams):
        counts[(batch.first_stream + stream) % replicates] += replicate_size(stream, samples, batch.streams)
    for p in range(whole.shape[0]):
        for c in range(whole.shape[2]):
            total = 0.0
            for r in range(replicates):
                found = part * drawn[p, r, c] + known[p, c] * counts[r]
                for to in range(givers.shape[1]):
                    found += shared[givers[p, to], r, c, to]
                whole[p, r, c] += found
                total += found
            scatter = 0.0
            for to in range(givers.shape[1]):
                found = 0.0
                for r in range(replicates):
                    found += shared[givers[p, to], r, c, to]
                scatter += max(shared_squares[givers[p, to], c, to] - found * found / samples, 0.0)
            found = 0.0
            for r in range(replicates):
                found += drawn[p, r, c]
            scatter += every * part * part * max(drawn_squares[p, c] - found * found / samples, 0.0)
            whole[p, replicates, c] += total * total / samples + scatter


@kernel
def clamp_radiance(radiance, blocks, n, limit):
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
