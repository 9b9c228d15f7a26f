import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.rendering.film import block_sums

EPS = np.finfo(float).eps
EPS32 = float(np.finfo(np.float32).eps)
COUNTS = st.lists(st.integers(1, 9), min_size=1, max_size=8)


def film_of(samples: list[np.ndarray]) -> pl.rendering.Film:
    """A film of one pixel and one channel from the samples of each replicate."""
    film = pl.rendering.Film((1, 1, 1), counts=np.array([len(s) for s in samples]))
    film.add(0, 0, np.array([s.sum() for s in samples]).reshape(1, 1, -1, 1))
    return film


@settings(max_examples=60)
@given(counts=COUNTS, seed=st.integers(0, 10**6))
def test_mean_and_squares_are_those_of_numpy(counts: list[int], seed: int):
    rng = np.random.default_rng(seed)
    n = np.array(counts)
    sums = rng.normal(1.0, 3.0, (3, 4, len(counts), 2)) * n[:, None]
    film = pl.rendering.Film((3, 4, 2), counts=n)
    film.add(0, 0, sums)
    means = sums / n[:, None]
    mean = np.average(means, axis=2, weights=n)
    # Sums of at most 8 terms.
    scale = np.abs(means).max()
    # What is kept is rounded to float32, by half of its eps.
    assert film.mean == pytest.approx(mean, rel=0.5 * EPS32, abs=16 * EPS * scale)
    assert (film.samples, film.replicates) == (n.sum(), len(counts))
    if len(counts) == 1:
        assert film.between is None and film.standard_error() is None
        return
    squares = np.einsum("hwrc,r->hwc", (means - mean[:, :, None]) ** 2, n)
    # The root of what is good to 64 eps.
    worst = math.sqrt(64 * EPS * n.sum()) * scale
    assert film.between == pytest.approx(np.sqrt(squares), rel=EPS32, abs=worst)
    error = np.sqrt(squares / (len(counts) - 1) / n.sum())
    assert film.standard_error() == pytest.approx(error, rel=1e-6, abs=4 * EPS32 * scale)


def test_the_error_is_unbiased_with_unequal_counts():
    # Replicates of n_r independent samples of variance 1: the squared standard error must be 1 / n on average.
    counts = np.array([1, 2, 3, 7, 20])
    trials = 20000
    sums = np.random.default_rng(1).normal(size=(trials, 1, 5, 1)) * np.sqrt(counts)[:, None]
    film = pl.rendering.Film((trials, 1, 1), counts=counts)
    film.add(0, 0, sums)
    squared = np.square(film.between, dtype=float) / 4 / counts.sum()
    spread = squared.std(ddof=1) / math.sqrt(trials)
    assert squared.mean() == pytest.approx(1 / counts.sum(), abs=4 * spread)
    # And it is the error of the mean: 20 000 means have a variance good to sqrt(2 / trials).
    assert film.mean.var() == pytest.approx(1 / counts.sum(), rel=4 * math.sqrt(2 / trials))


@settings(max_examples=40)
@given(first=COUNTS, second=COUNTS, seed=st.integers(0, 10**6))
def test_merged_films_are_one_film_of_all(first: list[int], second: list[int], seed: int):
    rng = np.random.default_rng(seed)
    samples = [rng.normal(5.0, 1.0, n) for n in (*first, *second)]
    both = film_of(samples[: len(first)]).merged(film_of(samples[len(first) :]))
    whole = film_of(samples)
    assert (both.samples, both.replicates) == (whole.samples, whole.replicates)
    # Each of the three means is rounded to float32, by half of its eps.
    assert both.mean == pytest.approx(whole.mean, rel=2 * EPS32)
    # What lies between both is known as well as their means, which are up to 10 or so; roots of sums of squares are as
    # good as their terms.
    worst = 10 * EPS32 * math.sqrt(whole.samples)
    assert both.between == pytest.approx(whole.between, rel=4 * EPS32, abs=worst)
    error = worst / math.sqrt((whole.replicates - 1) * whole.samples)
    assert both.standard_error() == pytest.approx(whole.standard_error(), rel=5 * EPS32, abs=error)


def drawn(rng: np.random.Generator, spread: np.ndarray, counts: list[int]) -> pl.rendering.Film:
    """A film of pixels (rows, columns) whose samples are normal, of mean 5, independent but for a part that replicates
    share: the variance of a replicate of n samples is that of independent ones over 4."""
    film, sums, powers = pl.rendering.Film((*spread.shape, 1), counts=np.array(counts)), [], 0.0
    for n in counts:
        x = rng.normal(size=(*spread.shape, n))
        x = 5.0 + spread[..., None] * (x - 0.5 * x.mean(axis=-1, keepdims=True))
        sums.append(x.sum(axis=-1))
        powers += np.square(x).sum(axis=-1)
    film.add(0, 0, np.stack(sums, axis=-1)[..., None], powers=powers[..., None])
    return film


@pytest.mark.parametrize("counts", [[40, 24], [32] * 4])
def test_few_replicates_are_pooled_over_a_block(counts):
    rng = np.random.default_rng(2)
    spread = rng.uniform(0.1, 2.0, (64, 64))
    film = drawn(rng, spread, counts)
    squared = np.square(film.standard_error()[..., 0], dtype=float)
    true = np.square(spread) / 4 / sum(counts)
    # Each block's ratio has 32 degrees of freedom or more, spread unevenly, the scatter of each pixel 62 or more.
    assert squared.sum() == pytest.approx(true.sum(), rel=4 * math.sqrt(2 * 1.8 / 4096))
    # A tenth of the mean of the block and colour, of 32 pixels, is shared.
    expected = (true + 0.1 * block_sums(true) / 32) / 1.1
    assert np.all(np.abs(np.log(squared / expected)) < 2.0)
    assert np.mean(np.abs(np.log(squared / expected))) < 0.35  # of replicates alone: 1.3
    # Over the pixels of a block and colour, squares are those of the replicates.
    of_replicates = (np.square(film.between, dtype=float) / (len(counts) - 1) / sum(counts))[..., 0]
    colour = np.add.outer(np.arange(8), np.arange(8)) % 2 == 1
    for block in (np.s_[:8, :8], np.s_[24:32, 56:64]):
        for part in (colour, ~colour):
            assert squared[block][part].sum() == pytest.approx(of_replicates[block][part].sum(), rel=1e-5)


def test_what_one_colour_of_a_block_shows_changes_no_other_pixel():
    rng = np.random.default_rng(3)
    film = drawn(rng, np.ones((16, 20)), [8, 8])
    before = film.standard_error()[..., 0]
    film.add(3, 9, np.array([80.0, 40.0]).reshape(1, 1, 2, 1), powers=np.full((1, 1, 1), 2000.0))
    changed = np.argwhere(film.standard_error()[..., 0] != before)
    assert len(changed) == 32 and np.all(changed // 8 == (0, 1)) and np.all(changed.sum(axis=1) % 2 == 0)
    # With eight replicates a pixel has an error of its own.
    film = drawn(rng, np.ones((8, 8)), [4] * 8)
    np.testing.assert_allclose(film.standard_error(), film.between / math.sqrt(7 * 32), rtol=4 * EPS32)


def test_the_scatter_of_merged_films_is_that_of_all_samples():
    rng = np.random.default_rng(5)
    one, other = (drawn(rng, np.ones((4, 4)), counts) for counts in ([8, 8], [20]))
    both = one.merged(other)

    def powers(film):
        """Sums of all samples' squares."""
        return np.square(film.within, dtype=float) + film.samples * np.square(film.mean, dtype=float)

    # Squares of means are twice as far off as the means, 36 samples of about 25, three of them.
    assert powers(both) == pytest.approx(powers(one) + powers(other), abs=6 * EPS32 * 36 * 25, rel=0)


@settings(max_examples=40)
@given(value=st.floats(1e-6, 1e6), n=st.integers(2, 5000))
def test_sums_of_equal_samples_have_no_scatter(value: float, n: int):
    film = pl.rendering.Film((1, 1, 1), counts=np.array([n - n // 2, n // 2]))
    sums = [np.cumsum(np.full(k, value))[-1] for k in (n - n // 2, n // 2)]  # one after the other, as kernels add
    power = np.cumsum(np.full(n, value * value))[-1]
    film.add(0, 0, np.reshape(sums, (1, 1, 2, 1)), powers=np.full((1, 1, 1), power))
    assert film.within[0, 0, 0] == 0.0 and film.agreeing().all()


def test_merging_names_all_processors_leaves_both_films_and_needs_one_shape(monkeypatch):
    a = film_of([np.ones(2), np.zeros(2)])
    monkeypatch.setattr("plenoptic.core.numba.jit.processor", lambda: "another kind")
    b = film_of([np.ones(4), np.zeros(1)])
    before = a.mean.copy(), b.mean.copy()
    assert a.merged(b).processors == (*a.processors, "another kind")
    assert a.merged(a).processors == a.processors
    assert np.array_equal(a.mean, before[0]) and np.array_equal(b.mean, before[1])
    with pytest.raises(pl.errors.InvalidValueError, match=r"\(1, 1, 1\) and \(2, 1, 1\)"):
        a.merged(pl.rendering.Film((2, 1, 1), counts=np.array([1])))


def test_replicates_and_pixels_may_have_different_numbers_of_samples():
    # Replicates without samples do not count.
    film = pl.rendering.Film((1, 1, 1), counts=np.array([1, 1, 0, 0]))
    film.add(0, 0, np.array([2.0, 4.0, 0.0, 0.0]).reshape(1, 1, 4, 1))
    assert (film.replicates, film.mean[0, 0, 0], film.standard_error()[0, 0, 0]) == (2, 3.0, 1.0)
    # One has no error, two such films have one.
    film = film_of([np.array([1.0, 2.0, 3.0])])
    assert film.mean[0, 0, 0] == 2.0 and film.standard_error() is None
    assert film.merged(film_of([np.array([4.0, 4.0, 4.0])])).standard_error()[0, 0, 0] == 1.0
    # Pixels may have more than others.
    film = pl.rendering.Film((1, 2, 1), counts=np.array([2, 2]))
    sums = np.array([2.0, 6.0]).reshape(1, 1, 2, 1)
    film.add(0, 0, np.tile(sums, (1, 2, 1, 1)), counts=np.array([2, 2]))
    film.add(0, 0, np.tile(3 * sums, (1, 2, 1, 1)), counts=np.array([4, 4]), where=np.array([[False, True]]))
    assert film.sample_counts.tolist() == [[4, 8]]
    # Means 1 and 3 of the replicates, then 1.5 and 4.5: errors are half their difference.
    assert film.mean.ravel().tolist() == [2.0, 3.0]
    assert film.standard_error().ravel() == pytest.approx([1.0, 1.5])
    with pytest.raises(pl.errors.InvalidValueError, match="different numbers of samples"):
        film.merged(film)
    # Those without samples are not exact.
    film = pl.rendering.Film((1, 3, 1), counts=np.array([1, 1]))
    film.add(0, 0, np.ones((1, 1, 2, 1)), counts=np.array([1, 1]))
    film.add(0, 1, np.array([1.0, 0.0]).reshape(1, 1, 2, 1), counts=np.array([1, 0]))
    assert film.standard_error().ravel().tolist() == [0.0, math.inf, math.inf]
    # Tiles go where they belong.
    film = pl.rendering.Film((4, 5, 1), counts=np.array([2, 2]))
    film.add(1, 2, np.full((2, 3, 2, 1), 6.0))
    expected = np.zeros((4, 5))
    expected[1:3, 2:5] = 3.0
    assert np.array_equal(film.mean[:, :, 0], expected)
    assert film.mean.dtype == film.between.dtype == film.standard_error().dtype == np.float32


@settings(max_examples=40)
@given(value=st.floats(-1e6, 1e6), counts=st.lists(st.integers(1, 9), min_size=2, max_size=8))
def test_agreement_is_no_certainty(value: float, counts: list[int]):
    film = pl.rendering.Film((1, 1, 1), counts=np.array(counts))
    film.add(0, 0, (value * np.array(counts)).reshape(1, 1, -1, 1))
    assert film.agreeing().all()
    # A sample of a pixel that has light brings what the others did; of one that has none that float32 can hold, what it
    # brings at most.
    brought = min(value, 3.0) if np.float32(value) > 0 else 3.0
    assert film.standard_error(np.full((1, 1), 3.0))[0, 0, 0] == pytest.approx(brought / sum(counts))


def test_what_one_sample_brings_is_known_from_pixels_around():
    # Dark, but for one in eight samples of the four pixels beside its corners, which brings 16: with the mean m = 2 and
    # the variance of a sample 32, E[x^2] / E[x] is 18.
    film = pl.rendering.Film((9, 3, 1), counts=np.ones(8))
    sums = np.zeros((9, 3, 8, 1))
    sums[:3:2, ::2, 3] = 16.0
    sums[1, 0] = 1e6  # of the other colour of a checkerboard, which must know nothing of this one
    film.add(0, 0, sums)
    error = film.standard_error(np.full((9, 3), 1e9))[..., 0]
    assert error[1, 1] == pytest.approx(18.0 / 8)
    # Where a sample weighs less, it brings less; where all is dark around, it may be the brightest.
    assert film.standard_error(np.full((9, 3), 17.0))[1, 1, 0] == pytest.approx(17.0 / 8)
    assert error[8, 1] == pytest.approx(1e9 / 8)
