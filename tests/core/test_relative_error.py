"""The error of an image, computed in strips, equals that of the whole image at once."""

import itertools
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core import relative_error as module
from plenoptic.core.color.percentile import HighPercentile


def test_a_percentile_of_parts_is_that_of_all():
    cases = [(99, 1), (99, 2), (99, 101), (99.9, 50_000), (50, 999), (100, 40)]
    for (percentile, count), kind in itertools.product(cases, (np.float32, np.float64)):
        numbers = np.random.default_rng(1).normal(size=count).astype(kind)
        level = HighPercentile(percentile, max_count=count + 1000)  # fewer may come
        for part in np.array_split(numbers, 7):
            level.add(part)
        # In float64 the place between two numbers is exact; between 32-bit ones there are a few roundings.
        reference = np.percentile(numbers.astype(float), percentile)
        assert level.value() == pytest.approx(reference, rel=4 * float(np.finfo(kind).eps)), (percentile, count, kind)
    assert math.isnan(HighPercentile(99, max_count=5).value())


def test_rows_are_taken_some_at_a_time(monkeypatch):
    for shape in [(37, 23, 3), (1, 90, 1), (90, 1, 3)]:
        rng = np.random.default_rng(2)
        image = rng.gamma(1.0, size=shape).astype(np.float32)
        error = (image * rng.uniform(0.0, 1.0, shape)).astype(np.float32)
        error[rng.random(shape) < 0.05] = np.nan
        errors = []
        for rows in (1, 2, 16, 1000):
            monkeypatch.setattr(module, "_STRIP", 1)
            monkeypatch.setattr(module, "_ROWS", rows)
            errors.append(module.image_error(image, error))
        # Sums of some thousand numbers above 0 in another order.
        relative, *flags = zip(*errors, strict=True)
        assert all(len(set(flag)) == 1 for flag in flags), shape
        np.testing.assert_allclose(relative, relative[0], rtol=image.size * 2.3e-16)


def test_the_error_of_an_exposure_is_found_once(monkeypatch):
    calls = []
    monkeypatch.setattr(
        "plenoptic.rendering.exposure.image_error", lambda *_: calls.append(1) or module.ImageError(0.25, True)
    )
    shot = pl.Exposure(np.ones((2, 3, 1)), standard_error=np.ones((2, 3, 1)))
    assert "25 % or more" in repr(shot) and shot.relative_error == 0.25 and shot.rare_light and len(calls) == 1
