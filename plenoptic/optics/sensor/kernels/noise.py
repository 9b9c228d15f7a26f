"""Kernels: random numbers of pixels, each a function of seed, purpose, row, column, channel and number of the draw.

Every pixel has a SplitMix64 generator (G. L. Steele et al., OOPSLA 2014, doi:10.1145/2660193.2660195) whose state is
a hash of all other arguments. No number depends on which other pixels are requested, or in which order.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.sobol import mix
from plenoptic.core.numba.jit import device, kernel

FEW = 10.0
"""Smaller means are sampled by inversion; transformed rejection is valid from 10 on."""

_MAX_COUNT = 200
"""Limit of the search by inversion; a Poisson variable of mean 10 exceeds it with probability 1e-183."""


@device
def row_key(seed, purpose, row):
    return mix(mix(mix(np.uint64(seed), np.uint64(1)), np.uint64(purpose)), np.uint64(row) + np.uint64(1))


@device
def pixel_key(row_state, column, channel):
    return mix(mix(row_state, np.uint64(column) + np.uint64(1)), np.uint64(channel) + np.uint64(1))


@device
def uniform(key, draw):
    """Random number `draw` of a pixel's generator: one of the 2^52 midpoints of (0, 1), so neither 0 nor 1."""
    bits = mix(key, np.uint64(draw) + np.uint64(1))
    return (np.float64(bits >> np.uint64(12)) + 0.5) * 2.0**-52


@device
def normal(key):
    """One standard normal variable (G. E. P. Box and M. E. Muller, Ann. Math. Stat. 29, 610 (1958))."""
    return math.sqrt(-2.0 * math.log(uniform(key, 0))) * math.cos(2.0 * math.pi * uniform(key, 1))


@device
def log_probability(k, mean):
    """Logarithm of the Poisson probability of k, without the cancellation of its textbook form.

    C. Loader, "Fast and accurate computation of binomial probabilities" (2000): the deviance
    k log(k / mean) + mean - k is summed as a series where the two are near, and Stirling's remainder is kept apart.
    """
    if k == 0.0:
        return -mean
    ratio = (k - mean) / (k + mean)
    if abs(ratio) < 0.1:
        deviance = (k - mean) * ratio
        term = 2.0 * k * ratio
        for j in range(1, 20):
            term *= ratio * ratio
            deviance += term / (2 * j + 1)
    else:
        deviance = k * math.log(k / mean) + mean - k
    if k < 16.0:
        remainder = math.lgamma(k + 1.0) - (0.5 * math.log(2.0 * math.pi * k) + k * math.log(k) - k)
    else:
        square = 1.0 / (k * k)
        remainder = (1.0 / 12.0 - square * (1.0 / 360.0 - square * (1.0 / 1260.0 - square / 1680.0))) / k
    return -0.5 * math.log(2.0 * math.pi * k) - remainder - deviance


@device
def poisson_by_inversion(mean, key):
    """A Poisson variable of small mean, by inversion of its distribution."""
    u = uniform(key, 0)
    probability = math.exp(-mean)
    total = probability
    k = 0
    while u > total and k < _MAX_COUNT:
        k += 1
        probability *= mean / k
        total += probability
    return np.float64(k)


@device
def poisson_by_rejection(mean, key):
    """A Poisson variable of mean 10 or more, by transformed rejection.

    W. Hoermann, Insurance: Mathematics and Economics 12, 39 (1993), doi:10.1016/0167-6687(93)90997-4, algorithm PTRS.
    """
    b = 0.931 + 2.53 * math.sqrt(mean)
    a = -0.059 + 0.02483 * b
    inverse_alpha = 1.1239 + 1.1328 / (b - 3.4)
    inside = 0.9277 - 3.6224 / (b - 2.0)
    draw = 0
    while True:
        u = uniform(key, draw) - 0.5
        v = uniform(key, draw + 1)
        draw += 2
        edge = 0.5 - abs(u)
        k = np.floor((2.0 * a / edge + b) * u + mean + 0.43)  # math.floor would give an integer, which overflows
        if edge >= 0.07 and v <= inside:
            return k
        if k < 0.0 or (edge < 0.013 and v > edge):
            continue
        if math.log(v * inverse_alpha / (a / (edge * edge) + b)) <= log_probability(k, mean):
            return k


@device
def poisson(mean, key):
    if not mean < np.inf:
        return mean
    if mean <= 0.0:
        return 0.0
    return poisson_by_inversion(mean, key) if mean < FEW else poisson_by_rejection(mean, key)


@kernel
def fill_poisson(counts, means, seed, purpose, first_row, first_column):
    """Poisson variables of the given means, both (H, W, C); an infinite mean gives infinity."""
    rows, columns, channels = means.shape
    for i in range(rows):
        state = row_key(seed, purpose, first_row + i)
        for j in range(columns):
            for c in range(channels):
                counts[i, j, c] = poisson(means[i, j, c], pixel_key(state, first_column + j, c))


@kernel
def fill_normals(normals, seed, purpose, first_row, first_column):
    """Standard normal variables, (H, W, C)."""
    rows, columns, channels = normals.shape
    for i in range(rows):
        state = row_key(seed, purpose, first_row + i)
        for j in range(columns):
            for c in range(channels):
                normals[i, j, c] = normal(pixel_key(state, first_column + j, c))


@kernel
def fill_uniforms(uniforms, seed, purpose, first_row, first_column):
    """Numbers in (0, 1), (H, W)."""
    rows, columns = uniforms.shape
    for i in range(rows):
        state = row_key(seed, purpose, first_row + i)
        for j in range(columns):
            uniforms[i, j] = uniform(pixel_key(state, first_column + j, 0), 0)
