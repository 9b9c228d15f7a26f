"""The error of an image is that of its pixels, or the exposure says that it cannot know: light that few paths meet.

`python tests/benchmarks --only honesty` prints the figures of which these are limits.
"""

import numpy as np
import pytest
from honesty import Converged, films, honesty

import plenoptic as pl
from plenoptic.core.relative_error import (
    expected_brightness,
    is_dominated_by_few,
    lit_threshold,
    relative_error,
    relative_squares,
)

REPLICATES = 8


def bernoulli(rng, brightness, rate, light, samples=32):
    """Image and standard error of pixels that rare light (so many times a sample, so bright) is added to."""
    film = pl.rendering.Film((*brightness.shape, 1), counts=np.full(REPLICATES, samples // REPLICATES))
    lit_samples = rng.poisson(rate * samples / REPLICATES, (*brightness.shape, REPLICATES, 1)) * light
    noise = rng.normal(1.0, 0.5, (*brightness.shape, REPLICATES, 1)) * brightness[..., None, None]
    film.add(0, 0, noise * samples / REPLICATES + lit_samples)
    return film.mean, film.standard_error()


@pytest.mark.parametrize("rate, light, most", [(0.0, 0.0, 1.1), (0.01, 30.0, 1.1), (0.001, 300.0, 1.4)])
def test_the_error_of_an_image_is_that_of_its_pixels(rate, light, most):
    # A ramp of brightness, and what is rare. Where it is a quarter of all light and one pixel in thirty has it, most
    # pixels know nothing of it, are too dark, and the error is told too large.
    rng = np.random.default_rng(3)
    truth = np.linspace(0.7, 1.3, 48) * np.ones((48, 1))
    stated, true = [], []
    for _ in range(24):
        image, error = bernoulli(rng, truth, rate, light)
        stated.append(relative_error(image, error) ** 2)
        true.append(np.mean(((image[..., 0] - truth - rate * light) / (truth + rate * light)) ** 2))
        bright, variance = image[..., 0].astype(float), error[..., 0].astype(float) ** 2
        expected = expected_brightness(bright, variance)
        lit = expected > lit_threshold(expected)
        assert not is_dominated_by_few(relative_squares(expected[lit], variance[lit]))
    # 0.001: 70 bright samples in an image, 1800 in all, known to 1 / (2 sqrt(1800)).
    assert 0.9 < np.sqrt(np.mean(stated) / np.mean(true)) < most


def test_an_error_that_rests_on_few_pixels_is_not_known():
    # Some 2 bright samples in the whole image.
    rng = np.random.default_rng(4)
    image, error = bernoulli(rng, np.ones((48, 48)), 3e-5, 1e4)
    shot = pl.Exposure(image, standard_error=error)
    assert shot.rare_light and "light is rare" in repr(shot)
    assert pl.Exposure(image).rare_light is None
    # Few pixels are not rare light.
    for region in (np.s_[:1, :2], np.s_[:4, :4]):
        plain, noise = bernoulli(rng, np.ones((4, 4))[region], 0.0, 0.0)
        assert not pl.Exposure(plain, standard_error=noise).rare_light
    assert not pl.Exposure(np.zeros((4, 4, 1)), standard_error=np.zeros((4, 4, 1))).rare_light


def test_colours_of_a_checkerboard_know_nothing_of_each_other():
    # Or a pixel would decide upon itself, and be biased.
    bright, variance = np.random.default_rng(5).uniform(0.5, 1.5, (2, 9, 12))
    one = np.add.outer(np.arange(9), np.arange(12)) % 2 == 1
    before = expected_brightness(bright, variance)
    after = expected_brightness(np.where(one, 1e3 * bright, bright), np.where(one, np.inf, variance))
    assert np.array_equal(before[~one], after[~one]) and not np.array_equal(before[one], after[one])
    # What is exact stays, and what nobody stands beside.
    assert np.array_equal(expected_brightness(bright, np.zeros_like(bright)), bright)
    assert np.array_equal(expected_brightness(bright[:1], variance[:1]), bright[:1])


def test_the_noise_of_pixels_is_no_texture():
    # An even image: X = chi^2 / 3 of four neighbours' variance over that of noise has 3 degrees of freedom, and what is
    # beyond 1 is taken for texture: a pixel's own value keeps the weight max(1 - 1 / X, 0), 0.142 in the mean.
    noise = np.random.default_rng(6).normal(size=(64, 64))
    kept = (noise * (expected_brightness(1e3 + noise, np.ones_like(noise)) - 1e3))[1:-1:2, 1:-1]  # independent rows
    assert abs(kept.mean() - 0.142) < 4 * kept.std() / np.sqrt(kept.size) < 0.07


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["white", "`check`", "many lights", "textures, environment", "glass", "`objects`", "caustic", "rare caustic"],
)
def test_reported_errors_are_true_or_said_to_be_unknown(name):
    subject = next(film for film in films(32) if film.name == name)
    report = honesty(Converged(subject, 1024), range(24), samples=64, replicates=2)
    if name == "rare caustic":
        assert report.rare >= 0.75
    else:
        # Blocks of 8 x 8 pixels are honest in the sum; dark pixels among bright ones are told up to a tenth too little,
        # or, where bright ones lose a few paths, too much.
        assert 0.86 < report.stated / report.error < 1.2 and report.rare == 0


def test_paths_that_make_others_dark_are_rare_light():
    # A bulb: 2 % of the pixels have met its lamp, and are a thousand times as bright; the others are a tenth of them.
    rng = np.random.default_rng(5)
    image, error = np.full((64, 64, 1), 0.05), np.full((64, 64, 1), 0.002)
    rare = rng.random(image.shape) < 0.02
    image[rare], error[rare] = 30.0, 30.0
    assert pl.lit_pixels(image).sum() == rare.sum()
    assert pl.Exposure(image, standard_error=error).rare_light
    # The same brightness, known: lamps in view.
    error[rare] = 1.0
    assert not pl.Exposure(image, standard_error=error).rare_light


@pytest.mark.slow
def test_rare_light_misses_its_target(monkeypatch):
    monkeypatch.setattr("plenoptic.rendering.schedule.budget.ENOUGH_OF_RARE", 256)
    subject = next(film for film in films(32) if film.name == "rare caustic")
    with pytest.warns(UserWarning, match="light is so rare"):
        shot = pl.render(subject.scene, subject.camera, target_error=0.5, truth=pl.Truth.NONE, progress=False, seed=2)
    # At 256 samples, or at the next pass in which a path has met it.
    assert shot.stats.stopped_by is pl.rendering.StopReason.TARGET_MISSED and shot.rare_light
    assert 256 <= shot.samples <= 1024
