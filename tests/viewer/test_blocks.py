"""Arrays in pages: what the browser unpacks is within half a step of what was put in."""

import gzip

import numpy as np
import pytest

from plenoptic.viewer.blocks import INFINITE, NOTHING, Blocks, Curve


def unpacked(blocks, place, shape, each=2):
    """As web/planes.js does it."""
    start, size = place
    split = np.frombuffer(gzip.decompress(blocks.join()[start : start + size]), np.uint8).reshape(each, -1)
    codes = np.ascontiguousarray(split.T).view(f"<u{each}").reshape(shape)
    return np.cumsum(codes, axis=1, dtype=codes.dtype)


def kept(given, **how):
    """A plane as it is kept, and its values when they are unpacked."""
    blocks = Blocks()
    plane = blocks.plane(given, **how)
    codes = unpacked(blocks, plane["bytes"], given.shape)
    bent = plane["low"] + plane["step"] * codes.astype(float)
    back = {
        Curve.LINEAR: lambda: bent,
        Curve.RECIPROCAL: lambda: 1 / bent,
        Curve.ASINH: lambda: plane["unit"] * np.sinh(bent),
    }
    with np.errstate(over="ignore"):  # of codes that are none
        values = back[Curve(plane["curve"])]()
    return plane, np.where(codes == NOTHING, np.nan, np.where(codes == INFINITE, np.inf, values))


def test_linear_planes_have_steps_of_a_65533rd_of_their_range():
    given = np.random.default_rng(0).normal(size=(17, 23))
    given[3, 4], given[5, 6] = np.nan, np.inf
    _, found = kept(given, curve=Curve.LINEAR)
    known = np.isfinite(given)
    assert np.isnan(found[3, 4]) and found[5, 6] == np.inf
    assert np.abs(found[known] - given[known]).max() <= 0.501 * np.ptp(given[known]) / 65533


def test_distances_keep_their_reciprocals():
    given = np.array([[300.0, 404.0, 1e4, np.inf, np.nan]])
    _, found = kept(given, curve=Curve.RECIPROCAL)
    step = (1 / 300 - 1e-4) / 65533
    assert found[0, 3] == np.inf and np.isnan(found[0, 4])
    assert np.abs(1 / found - 1 / given)[0, :3].max() <= 0.501 * step


def test_values_of_any_size_keep_a_relative_step():
    rng = np.random.default_rng(1)
    given = np.exp(rng.uniform(-12, 20, (30, 40))) * rng.choice([-1.0, 1.0], (30, 40))
    for step in (1e-3, 0.02):
        plane, found = kept(given, curve=Curve.ASINH, step=step, unit=1e-5)
        # sinh(x + d) - sinh(x) is at most sinh(x) d + d near 0, with d half a step, and a little more for large d.
        assert np.all(np.abs(found - given) <= 0.505 * plane["step"] * (np.abs(given) + 1e-5))
        assert plane["step"] == pytest.approx(step)


def test_planes_without_values_or_of_one_value_come_back():
    for given in (np.full((2, 3), np.nan), np.full((2, 3), 7.0), np.zeros((1, 1))):
        for curve in (Curve.LINEAR, Curve.ASINH):
            np.testing.assert_allclose(kept(given, curve=curve)[1], given, rtol=1e-12)


def test_whole_numbers_are_exact_and_widen_where_they_must():
    rng = np.random.default_rng(2)
    for most, each in ((65535, 2), (1 << 31, 4)):
        given = rng.integers(0, most, (9, 11))
        given[0, 0] = most
        blocks = Blocks()
        found = blocks.whole_numbers(given)
        assert found["wide"] is (each == 4)
        assert np.array_equal(unpacked(blocks, found["bytes"], given.shape, each), given)
