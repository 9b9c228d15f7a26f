"""Scores of maps of disparity: closed forms, and what is counted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield import disparity_edges, disparity_scores


def test_uniform_errors_have_closed_forms():
    """Errors uniform in (-a, a): MSE a^2 / 3, shares 1 - t / a above t, a quarter below a / 4."""
    a, n = 0.1, 400
    error = a * (2 * (np.arange(n * n) + 0.5) / n**2 - 1).reshape(n, n)
    truth = np.full((n, n), 2.0)
    scores = disparity_scores(truth + error, truth)
    assert scores.mse == pytest.approx(100 * a**2 / 3, rel=1e-4)
    np.testing.assert_allclose(scores.bad, [100 * (1 - t / a) for t in (0.07, 0.03, 0.01)], atol=0.01)
    assert scores.q25 == pytest.approx(100 * a / 4, rel=1e-3) and scores.kept == 1.0 and scores.pixels == n * n
    np.testing.assert_allclose(scores.relative, [0, 100 * (1 - 0.06 / a), 100 * (1 - 0.02 / a)], atol=0.01)
    assert abs(scores.bias) < 1e-5


@given(scale=st.floats(0.1, 10), factor=st.floats(0.5, 2), seed=st.integers(0, 99))
def test_relative_scores_do_not_know_units(scale, factor, seed):
    random = np.random.default_rng(seed)
    truth = random.uniform(1, 9, (7, 9))
    found = truth * factor * random.normal(1, 0.03, truth.shape)
    one, other = disparity_scores(found, truth), disparity_scores(scale * found, scale * truth)
    np.testing.assert_allclose(other.relative, one.relative, atol=100 / 63 + 1e-9)
    assert other.bias == pytest.approx(one.bias, abs=1e-12)
    assert other.mse == pytest.approx(one.mse * scale**2)


def test_what_is_not_known_does_not_count_and_types_add_up():
    random = np.random.default_rng(3)
    truth, types = random.uniform(2, 3, (20, 30)), random.integers(-1, 3, (20, 30))
    found = truth + random.normal(0, 0.05, truth.shape)
    found[:5], truth[:, :3] = np.nan, np.nan
    where = np.zeros(truth.shape, dtype=bool)
    where[2:, :] = True
    scores = disparity_scores(found, truth, where=where, types=types)
    assert scores.pixels == 15 * 27 and scores.kept == pytest.approx(15 / 18)
    assert sum(part.pixels for part in scores.of_types) == ((types >= 0)[5:, 3:]).sum()
    alone = disparity_scores(found, truth, where=where & (types == 1))
    assert scores.of_types[1] == alone
    assert str(scores).splitlines()[0].split()[:3] == ["pixels", "kept", "%"] and len(str(scores).splitlines()) == 5
    nothing = disparity_scores(np.full((2, 2), np.nan), np.ones((2, 2)))
    assert nothing.pixels == 0 and nothing.kept == 0 and np.isnan(nothing.mse)


def test_bumpiness_is_the_norm_of_second_derivatives():
    """Of the error a (x^2 + 2 x y): Hessian (2 a, 2 a; 2 a, 0), norm 2 a sqrt(3), exact by central differences."""
    y, x = np.mgrid[0:20, 0:30].astype(float)
    truth = np.full(x.shape, 3.0)
    for a in (1e-3, 0.1):
        found = disparity_scores(truth + a * (x**2 + 2 * x * y), truth)
        assert found.bumpiness == pytest.approx(100 * min(2 * a * np.sqrt(3), 0.05), rel=1e-9)
    slanted = disparity_scores(truth + 0.3 * x - 0.2 * y, truth, where=x < 15)
    assert slanted.bumpiness == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(disparity_scores(truth[:4], truth[:4]).bumpiness)


def test_edges_are_where_the_truth_steps():
    truth = np.full((9, 9), 4.0)
    truth[4, 4], truth[0, 0] = 4.3, np.nan
    edges = disparity_edges(truth)
    expected = np.zeros((9, 9), dtype=bool)
    expected[4, 2:7] = expected[2:7, 4] = expected[0, :3] = expected[:3, 0] = True
    np.testing.assert_array_equal(edges, expected)
    assert not disparity_edges(np.full((5, 5), 4.0) + 0.04 * np.eye(5)).any()
    with pytest.raises(InvalidValueError, match="step"):
        disparity_edges(truth, step=-1.0)


def test_impossible_maps_are_refused():
    for given_, said in (
        ({"estimate": np.ones((2, 3))}, "estimate has shape"),
        ({"truth": np.ones(4)}, "truth has shape"),
        ({"where": np.ones((2, 2))}, "it must be booleans"),
        ({"types": np.full((2, 2), 0.5)}, "whole numbers"),
    ):
        with pytest.raises(InvalidValueError, match=said):
            disparity_scores(**({"estimate": np.ones((2, 2)), "truth": np.ones((2, 2))} | given_))
    assert pl.lightfield.disparity_scores is disparity_scores
