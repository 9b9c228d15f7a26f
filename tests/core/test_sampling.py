import itertools
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from plenoptic.core.kernels.sobol import _direction_numbers
from plenoptic.core.sampling import sobol_points

KEYS = {"seed": st.integers(0, 2**40), "pixel": st.integers(0, 2**25), "replicate": st.integers(0, 64)}


def bits_of_sobol(index, numbers):
    """A coordinate from its definition: XOR of the direction numbers of the index's bits."""
    x = 0
    for k, v in enumerate(numbers):
        if (index >> k) & 1:
            x ^= v
    return x


def test_direction_numbers_are_those_of_joe_and_kuo():
    # new-joe-kuo-6.21201, dimensions 2 to 4 (d s a m): 2 1 0 1; 3 2 1 1 3; 4 3 1 1 3 1, by their recurrence on m.
    numbers = _direction_numbers()
    polynomials = {1: ([1], [1]), 2: ([1, 1], [1, 3]), 3: ([0, 1, 1], [1, 3, 1])}
    for dimension, (a, m) in polynomials.items():
        m = list(m)
        s = len(m)
        for k in range(s, 32):
            term = m[k - s] ^ (m[k - s] << s)
            for j in range(1, s):
                term ^= (a[j - 1] * m[k - j]) << j
            m.append(term)
        assert numbers[dimension].tolist() == [m[k] << (31 - k) for k in range(32)]
    assert numbers[0].tolist() == [1 << (31 - k) for k in range(32)]


@settings(max_examples=25)
@given(**KEYS, set_number=st.integers(0, 5), k=st.integers(0, 8), block=st.integers(0, 3))
def test_aligned_powers_of_two_are_stratified(seed, pixel, replicate, set_number, k, block):
    points = sobol_points((block + 1) << k, seed=seed, pixel=pixel, replicate=replicate, set_number=set_number)
    part = points[block << k :]
    assert part.shape == (1 << k, 4)
    strata = np.sort(np.floor(part * (1 << k)), axis=0)
    assert np.array_equal(strata, np.tile(np.arange(1 << k)[:, None], (1, 4)))


@settings(max_examples=25)
@given(**KEYS, set_number=st.integers(0, 3), m=st.integers(1, 9))
def test_the_first_two_dimensions_form_a_net(seed, pixel, replicate, set_number, m):
    points = sobol_points(1 << m, seed=seed, pixel=pixel, replicate=replicate, set_number=set_number)
    for a in range(m + 1):
        boxes = np.floor(points[:, 0] * 2**a) * 2 ** (m - a) + np.floor(points[:, 1] * 2 ** (m - a))
        assert len(np.unique(boxes)) == 1 << m


def test_scrambling_keeps_the_tree_of_the_sobol_points():
    # Nested scrambling: two points share their first b bits after it exactly where they did before.
    numbers = _direction_numbers().tolist()
    n = 128
    points = np.round(sobol_points(n, seed=9) * 2.0**32).astype(np.uint64)
    for dimension in range(4):
        plain = np.array([bits_of_sobol(i, numbers[dimension]) for i in range(n)], dtype=np.uint64)
        for shift in (31, 28, 25, 20):
            before = (plain[:, None] ^ plain) >> np.uint64(shift) == 0
            after = (points[:, None, dimension] ^ points[:, dimension]) >> np.uint64(shift) == 0
            assert np.array_equal(before, after)


def test_prefixes_and_repetition():
    points = sobol_points(1000, seed=3, pixel=5, replicate=2, set_number=1)
    for n in (0, 1, 17, 256, 999):
        assert np.array_equal(sobol_points(n, seed=3, pixel=5, replicate=2, set_number=1), points[:n])
    assert points.min() >= 0 and points.max() < 1
    # Beyond two bytes of the index, where the tables' upper half takes part.
    many = sobol_points(70000, seed=3)
    strata = np.sort(np.floor(many[: 1 << 16] * (1 << 16)), axis=0)
    assert np.array_equal(strata, np.tile(np.arange(1 << 16)[:, None], (1, 4)))
    assert len(np.unique(many[:, 0])) == 70000


def chi_square(values, bins):
    """Chi-square of values in [0, 1) over equal bins, less its mean, in its standard deviations."""
    counts = np.bincount((values * bins).astype(int), minlength=bins)
    expected = len(values) / bins
    freedom = bins - 1
    return float((((counts - expected) ** 2).sum() / expected - freedom) / math.sqrt(2 * freedom))


def test_each_coordinate_is_uniform_over_scramblings():
    for key in ("seed", "pixel", "replicate"):
        # One point of each of many scramblings is a sample of independent uniform numbers.
        first = np.concatenate([sobol_points(8, **{key: i})[None] for i in range(3000)])
        # 24 comparisons: 4.5 standard deviations of a chi-square with 63 degrees of freedom is a chance of 1e-4.
        for index, dimension in itertools.product((0, 1, 5), range(4)):
            assert abs(chi_square(first[:, index, dimension], 64)) < 4.5, key
        # In pairs of dimensions too, on an 8 x 8 grid.
        for a, b in itertools.combinations(range(4), 2):
            pairs = (np.floor(first[:, 3, a] * 8) + first[:, 3, b]) / 8
            assert abs(chi_square(pairs, 64)) < 4.5, key


def test_streams_are_uncorrelated():
    # Correlation over 2000 pixels of one point of two streams; its standard error is 1 / sqrt(n).
    def of_pixels(seed=0, pixel=0, replicate=0, set_number=0):
        keys = {"seed": seed, "replicate": replicate, "set_number": set_number}
        return np.array([sobol_points(4, pixel=pixel + 2 * i, **keys)[3] for i in range(2000)])

    one, keys = of_pixels(), ("seed", "pixel", "replicate", "set_number")
    for other in (*({key: 1} for key in keys), {"set_number": 2}, {"seed": 1, "pixel": 1}):
        correlation = np.corrcoef(one.T, of_pixels(**other).T)[:4, 4:]
        # 16 of them: 4.5 standard errors.
        assert np.abs(correlation).max() < 4.5 / math.sqrt(2000), other
    # Bounces of one pixel take their points in another order. Over 1024 points of 40 replicates, sums of products have
    # the standard error 1 / sqrt(40960) that independent uniform numbers would have at most.
    sets = {k: np.concatenate([sobol_points(1024, replicate=r, set_number=k) for r in range(40)]) for k in (0, 1, 2, 5)}
    for first, second in ((0, 1), (0, 2), (1, 2), (1, 5)):
        correlation = np.corrcoef(sets[first].T, sets[second].T)[:4, 4:]
        assert np.abs(correlation).max() < 4.5 / math.sqrt(40960), (first, second)
