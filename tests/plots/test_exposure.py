"""Figures of exposures: what is there is drawn, what is not is left out."""

import itertools
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest

import plenoptic as pl
from plenoptic.truth.channels import GroundTruth


def _shot(channels=1, *, error=True, depth=True, region=None):
    shape = (6, 8, channels)
    image = np.arange(np.prod(shape), dtype=float).reshape(shape)
    where = np.full(shape[:2], 400.0)
    where[0] = np.inf
    error, truth = 0.01 * image if error else None, GroundTruth(depth=where) if depth else None
    return pl.Exposure(image, standard_error=error, truth=truth, region=region)


def _panels(shot):
    drawn = pl.plots.plot_exposure(shot)
    return {ax.get_title().split(" (")[0]: ax for ax in drawn.axes if ax.get_title()}


def test_panels_are_those_that_exist():
    for channels, error, depth in itertools.product((1, 3), (False, True), (False, True)):
        panels = _panels(_shot(channels, error=error, depth=depth))
        assert list(panels) == ["image"] + ["standard error"] * error + ["depth"] * depth
    given = plt.figure()
    assert pl.plots.plot_exposure(_shot(), figure=given) is given
    given.canvas.draw()


def test_labels_of_scales_stand_clear_of_the_next_panel():
    """By more than half a letter, 5 pixels at 100 dots an inch."""
    image = np.random.default_rng(1).random((160, 200, 1))
    figure = pl.plots.plot_exposure(pl.Exposure(image, standard_error=0.01 * image))
    figure.canvas.draw()
    boxes = {ax.get_title() or f"scale {k}": ax.get_tightbbox() for k, ax in enumerate(figure.axes)}
    (scale, _) = (box for name, box in boxes.items() if name.startswith("scale"))
    assert boxes["detail"].x0 - scale.x1 > 5.0


def test_axes_count_pixels_of_the_sensor_and_depth_is_blank_where_nothing_is_met():
    panels = _panels(_shot(region=(100, 106, 200, 208)))
    for ax in panels.values():
        # Row 0 is at the top.
        assert ax.images[0].get_extent() == pytest.approx([199.5, 207.5, 105.5, 99.5])
        bottom, top = ax.get_ylim()
        assert bottom > top and ax.get_xlabel() == "column / pixel"
    drawn = panels["depth"].images[0].get_array()
    assert drawn.mask[0].all() and not drawn.mask[1:].any()
    # Also where it is infinite everywhere.
    shot = pl.Exposure(np.zeros((2, 2, 1)), truth=GroundTruth(depth=np.full((2, 2), np.inf)))
    pl.plots.plot_exposure(shot).canvas.draw()


def test_scales_are_those_of_lit_pixels_that_are_no_outliers():
    image, error = np.ones((20, 20, 1)), np.full((20, 20, 1), 0.01)
    image[:, 10:], error[:, 10:] = 0.0, 7.0  # black, and told no better than one sample
    drawn = _panels(pl.Exposure(image, standard_error=error))["standard error"].images[0]
    assert drawn.get_clim() == (0.0, pytest.approx(0.01))
    image = np.ones((40, 40, 1))
    image[3, 4] = 1e6
    assert _panels(pl.Exposure(image))["image"].images[0].get_clim() == (0.0, 1.0)


def test_what_was_not_rendered_is_neither_black_nor_grey():
    counts = np.full((6, 8), 4)
    counts[2:] = 0
    for channels in (1, 3):
        image = np.where(counts[..., None] > 0, np.ones((6, 8, channels)), 0.0)
        error = np.where(counts[..., None] > 0, 0.1 * image, np.inf)
        panels = _panels(pl.Exposure(image, standard_error=error, samples=4, sample_counts=counts))
        drawn = panels["image"].images[0].get_array()
        blue = panels["image"].get_facecolor()[:3]
        if channels == 1:
            assert np.array_equal(np.ma.getmaskarray(drawn), counts == 0)
        else:
            np.testing.assert_allclose(drawn[2:], np.broadcast_to(blue, (4, 8, 3)), atol=1e-6)
        assert blue[2] > blue[0]
        assert np.ma.getmaskarray(panels["standard error"].images[0].get_array())[2:].all()
        assert [text.get_text() for text in panels["image"].texts] == ["pale blue: not rendered"]


def test_colours_are_encoded_for_the_screen_and_their_error_is_the_root_mean_square():
    image, error = np.full((4, 4, 3), 1.0), np.broadcast_to([3.0, 4.0, 0.0], (4, 4, 3))
    image[0, 0] = 0.5
    panels = _panels(pl.Exposure(image, standard_error=error))
    # IEC 61966-2-1: linear 0.5 is shown as 0.7354.
    np.testing.assert_allclose(panels["image"].images[0].get_array()[0, 0], 0.7354, atol=1e-4)
    np.testing.assert_allclose(panels["standard error"].images[0].get_array(), np.sqrt(25 / 3), rtol=1e-7)


def test_without_matplotlib_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    for draw, given in ((pl.plots.plot_exposure, _shot()), (pl.plots.plot_lens, pl.load_lens("singlet-100mm-f4"))):
        with pytest.raises(pl.PlenopticError, match="pip install matplotlib") as caught:
            draw(given)
        assert isinstance(caught.value, ImportError)
