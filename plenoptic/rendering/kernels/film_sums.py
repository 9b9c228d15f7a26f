"""Kernels that add the light of paths to the sums of pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.sampling.kernels.path_numbers import path_indices, replicate_size
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT
from plenoptic.core.numba.jit import device, kernel
from plenoptic.core.values import Floats


class Light(NamedTuple):
    """Light of the paths of a bundle."""

    blocks: Floats
    """The bundle, with the weights of the paths."""
    radiance: Floats | None
    """(n, channels); None for a white image, whose radiance is 1."""
    waves: NDArray[np.int64] | None
    """Wavelength numbers of the paths, whose radiance then has one channel. None if all have the same."""
    weights: Floats | None
    """(wavelengths, channels): weights of the wavelengths in the channels."""


@device
def _contribution(light, k, c):
    """Contribution of path k of a bundle to channel c."""
    light_of_path = light.blocks[(k // BLOCK) * RAY + WEIGHT + k % BLOCK]
    if light.weights is not None:
        light_of_path *= light.weights[light.waves[k], c]
        if light.radiance is not None:
            light_of_path *= light.radiance[k, 0]
    elif light.radiance is not None:
        light_of_path *= light.radiance[k, c]
    return light_of_path


@kernel
def fill_sums(sums, bundle, start, n, batch):
    """Add the light of a bundle's paths to sums (pixels, streams + 1, channels), in the order of their indices.

    The last row of a pixel's sums gets the squares of the contributions of all streams.

    The bundle is `Light`. Returns the number of contributions that are not finite, which are left out.
    """
    nonfinite = 0
    samples, streams = batch.samples, batch.streams
    path = start
    end = start + n
    while path < end:
        pixel, stream, index = path_indices(path, samples, streams)
        run = min(replicate_size(stream, samples, streams) - index, end - path)
        for c in range(sums.shape[2]):
            total, squares = sums[pixel, stream, c], sums[pixel, -1, c]
            for k in range(path - start, path - start + run):
                light = _contribution(bundle, k, c)
                if light - light == 0.0:
                    total += light
                    squares += light * light
                else:
                    nonfinite += 1
            sums[pixel, stream, c], sums[pixel, -1, c] = total, squares
        path += run
    return nonfinite


@kernel
def fill_kernel_sums(sums, place, bundle, pilot_mean, kernel_weights, start, n, batch):
    """Distribute the light of a bundle's paths over pixels by diffraction kernels.

    `sums` are (sources, replicates, channels, targets) and, for squares, (sources, channels, targets). `place` are the
    source indices of pixels; `kernel_weights` are the row of each path in a `KernelTable`, and the table's weights.
    `pilot_mean` (sources,) is an estimate of the light used as control variate: only the deviation from it is
    distributed; None for no estimate. For the other arguments see `fill_sums`.
    """
    nonfinite = 0
    kernel_row, kernel_rows = kernel_weights
    for k in range(n):
        pixel, stream, _ = path_indices(start + k, batch.samples, batch.streams)
        source, replicate = place[pixel], (batch.first_stream + stream) % sums[0].shape[1]
        weights = kernel_rows[kernel_row[k]]
        for c in range(sums[0].shape[2]):
            light, target_sums, target_squares = (
                _contribution(bundle, k, c),
                sums[0][source, replicate, c],
                sums[1][source, c],
            )
            if pilot_mean is not None:
                if bundle.weights is not None:
                    light -= pilot_mean[source] * bundle.weights[bundle.waves[k], c]
                else:
                    light -= pilot_mean[source]
            if light - light == 0.0:
                for target in range(weights.size):
                    contribution = light * weights[target]
                    target_sums[target] += contribution
                    target_squares[target] += contribution * contribution
            else:
                nonfinite += 1
    return nonfinite


@kernel
def fill_pilot_means(pilot_mean, place, blocks, start, n, batch):
    """Add the mean light of a bundle of a white image, without wavelength weights."""
    for k in range(n):
        light = blocks[(k // BLOCK) * RAY + WEIGHT + k % BLOCK]
        if light - light == 0.0:
            pilot_mean[place[path_indices(start + k, batch.samples, batch.streams)[0]]] += light / batch.samples


@kernel
def fill_deflected_sums(sums, bundle, start, n, deflections, batch, samples_per_deflection):
    """Add the light of sampled deflections to pixels; each stands for `samples_per_deflection` samples of a batch.

    `sums` are (pixels, replicates, channels) and, for squares, (pixels, channels); `deflections` is their
    batch. For the other arguments see `fill_sums`.
    """
    nonfinite = 0
    means, squares = sums
    for k in range(n):
        pixel, stream, index = path_indices(start + k, deflections.samples, deflections.streams)
        replicate = (batch.first_stream + stream) % means.shape[1]
        begin = (deflections.first_index + index) * samples_per_deflection
        end = batch.first_index + replicate_size(stream, batch.samples, batch.streams)
        count = min(begin + samples_per_deflection, end) - max(begin, batch.first_index)
        for c in range(means.shape[2]):
            light = _contribution(bundle, k, c)
            if light - light == 0.0:
                means[pixel, replicate, c] += count * light
                squares[pixel, c] += count * light * light
            else:
                nonfinite += 1
    return nonfinite


@kernel
def fill_pixel_totals(
    totals, spread_sums, control_variate, deflected, sources, batch, deflection_weight, samples_per_deflection
):
    """Total light of pixels for the samples of a batch: kernel-weighted light, control variate and deflections.

    `sources` are the pixels whose light reaches each pixel. `control_variate` (pixels, channels) is per sample, and
    `deflection_weight` is the weight of the sampled deflections. The last row of `totals`
    (pixels, replicates + 1, channels) gets the squared total over the number of samples, plus the scatter of the
    contributions. Each sampled deflection counts for `samples_per_deflection` samples, which multiplies its variance.
    """
    (spread_sums, spread_squares), (deflected, deflected_squares) = spread_sums, deflected
    replicates, samples = totals.shape[1] - 1, batch.samples
    counts = np.zeros(replicates)
    for stream in range(batch.streams):
        counts[(batch.first_stream + stream) % replicates] += replicate_size(stream, samples, batch.streams)
    for p in range(totals.shape[0]):
        for c in range(totals.shape[2]):
            total = 0.0
            for r in range(replicates):
                light_sum = deflection_weight * deflected[p, r, c] + control_variate[p, c] * counts[r]
                for target in range(sources.shape[1]):
                    light_sum += spread_sums[sources[p, target], r, c, target]
                totals[p, r, c] += light_sum
                total += light_sum
            scatter = 0.0
            for target in range(sources.shape[1]):
                light_sum = 0.0
                for r in range(replicates):
                    light_sum += spread_sums[sources[p, target], r, c, target]
                scatter += max(spread_squares[sources[p, target], c, target] - light_sum * light_sum / samples, 0.0)
            light_sum = 0.0
            for r in range(replicates):
                light_sum += deflected[p, r, c]
            deflected_scatter = max(deflected_squares[p, c] - light_sum * light_sum / samples, 0.0)
            scatter += samples_per_deflection * deflection_weight * deflection_weight * deflected_scatter
            totals[p, replicates, c] += total * total / samples + scatter


@kernel
def clamp_radiance(radiance, blocks, n, limit):
    """Scale down the radiance of paths above a limit; return the light that remains and the light removed."""
    remaining, removed = 0.0, 0.0
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
        remaining += fraction * light
        removed += (1.0 - fraction) * light
    return remaining, removed
