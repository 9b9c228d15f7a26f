"""Random numbers of pixels against an independent generator in whole numbers, exact distributions and independence."""

import itertools
import math

import mpmath
import numpy as np
import pytest

from plenoptic.optics.sensor.kernels import noise

MASK = (1 << 64) - 1
FIVE_SIGMA = 5.0  # one chance in 2e6 for each normal statistic


def mix(state, salt):
    """SplitMix64's output function in Python's whole numbers."""
    x = (state + salt * 0x9E3779B97F4A7C15) & MASK
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & MASK
    return x ^ (x >> 31)


def uniforms(shape, seed=0, purpose=1, row=0, column=0):
    out = np.empty(shape)
    noise.fill_uniforms(out, np.uint64(seed), purpose, row, column)
    return out


def normals(shape, seed=0, purpose=1, row=0, column=0):
    out = np.empty(shape)
    noise.fill_normals(out, np.uint64(seed), purpose, row, column)
    return out


def counts(mean, shape, seed=0):
    means, out = np.full((*shape, 1), float(mean)), np.empty((*shape, 1))
    noise.fill_poisson(out, means, np.uint64(seed), 1, 0, 0)
    return out


def test_uniforms_are_those_of_the_documented_hash():
    for seed in [0, 12345, MASK]:
        numbers = uniforms((3, 4), seed, 7, 1000, 2**31)
        for i in range(3):
            for j in range(4):
                state = mix(mix(mix(seed, 1), 7), 1000 + i + 1)
                key = mix(mix(state, 2**31 + j + 1), 1)
                assert numbers[i, j] == ((mix(key, 1) >> 12) + 0.5) * 2.0**-52, seed


def test_normals_have_the_moments_of_a_normal_variable():
    numbers = normals((512, 512, 1), seed=8).ravel()
    n = numbers.size
    # Variances of the sample moments 1 to 4 of a standard normal: 1, 2, 15, 96 over n.
    for power, moment, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert abs(np.mean(numbers**power) - moment) < FIVE_SIGMA * math.sqrt(variance / n)


def test_numbers_of_different_keys_do_not_correlate():
    n = 256
    first = normals((n, n, 3), seed=5)
    others = {"next row": normals((n, n, 3), seed=5, row=1), "next column": normals((n, n, 3), seed=5, column=1)}
    others |= {"next channel": np.roll(first, 1, axis=2), "next seed": normals((n, n, 3), seed=6)}
    others |= {"next purpose": normals((n, n, 3), seed=5, purpose=2), "rows for columns": first.transpose(1, 0, 2)}
    for name, other in others.items():
        product = first * other
        if name == "rows for columns":  # each pair counts twice, and the diagonal is its own
            product = product[np.triu_indices(n, 1)]
        # The product of two independent standard normals has variance 1.
        assert abs(product.mean()) < FIVE_SIGMA / math.sqrt(product.size / (3 if name == "next channel" else 1)), name


def test_counts_follow_poisson_probabilities():
    # A wrong constant of the rejection shifts probabilities near a mean of 10 by less than a per cent: many there.
    for mean in (0.1, 0.7, 3.0, 9.99, 10.0, 14.0, 55.0, 1234.5, 1e5):
        side = 2048 if 5 < mean < 20 else 512
        n = side**2
        samples = counts(mean, (side, side), seed=21)
        assert np.array_equal(samples, np.floor(samples)) and samples.min() >= 0, mean
        spread = math.sqrt(mean)
        low = max(int(mean - 6 * spread) - 6, 0)
        high = int(mean + 6 * spread) + 12
        k = range(low, high)
        probability = np.array([math.exp(j * math.log(mean) - mean - math.lgamma(j + 1)) for j in k])
        edges = [low]  # bins of at least 200 expected counts, for which chi-square holds
        for j in k:
            if n * probability[edges[-1] - low : j - low].sum() >= 200 and n * probability[j - low :].sum() >= 200:
                edges.append(j)
        edges.append(high)
        expected = np.array([n * probability[a - low : b - low].sum() for a, b in itertools.pairwise(edges)])
        histogram = np.histogram(samples, bins=[*edges[:-1], np.inf])[0]
        assert histogram.sum() == n
        square = np.sum((histogram - expected) ** 2 / expected)
        # Wilson and Hilferty: the cube root of chi-square over its mean is close to normal, also for few bins.
        freedom = len(expected) - 1
        variance = 2 / (9 * freedom)
        assert abs((square / freedom) ** (1 / 3) - (1 - variance)) < FIVE_SIGMA * math.sqrt(variance), mean


def test_large_counts_have_the_moments_of_poisson():
    for mean in (1e6, 1e15):
        scaled = (counts(mean, (512, 512), seed=2) - mean) / math.sqrt(mean)
        n = scaled.size
        assert abs(scaled.mean()) < FIVE_SIGMA / math.sqrt(n), mean
        assert abs(scaled.var() - 1) < FIVE_SIGMA * math.sqrt(2 / n), mean
        assert abs(np.mean(scaled**3) - 1 / math.sqrt(mean)) < FIVE_SIGMA * math.sqrt(15 / n), mean


def test_log_probabilities_keep_their_digits():
    for mean in [10.0, 333.3, 1e9, 1e15]:
        # The textbook form loses k log k eps, 1e4 at 1e15 electrons; here only the terms themselves are rounded.
        with mpmath.workdps(60):
            for k in {float(math.floor(mean + step * math.sqrt(mean))) for step in (-3, -1, 0, 0.5, 4, 12)}:
                exact = mpmath.mpf(k) * mpmath.log(mean) - mean - mpmath.loggamma(mpmath.mpf(k) + 1)
                eps = float(np.finfo(float).eps)
                assert abs(noise.log_probability(k, mean) - exact) <= 32 * eps * max(1, abs(exact)), k


def test_limits():
    means = np.array([[0.0, np.inf, 1e-300, 1e300]])[:, :, np.newaxis]
    out = np.empty_like(means)
    noise.fill_poisson(out, means, np.uint64(0), 1, 0, 0)
    assert out.ravel()[:3].tolist() == [0.0, np.inf, 0.0] and out.ravel()[3] == pytest.approx(1e300, rel=1e-12)
