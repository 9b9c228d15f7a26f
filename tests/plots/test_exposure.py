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
    return pl.Exposure(
        image,
        standard_error=0.01 * image if error else None,
        truth=GroundTruth(depth=where) if depth else None,
        region=region,
    )


def _panels(figure):
    return {ax.get_title().split(" (")[0]: ax for ax in figure.axes if ax.get_title()}


def test_panels_are_those_that_exist():
    for channels, error, depth in itertools.product((1, 3), (False, True), (False, True)):
        panels = _panels(pl.plots.plot_exposure(_shot(channels, error=error, depth=depth)))
        assert list(panels) == ["image"] + ["standard error"] * error + ["depth"] * depth


def test_axes_count_pixels_of_the_sensor_and_depth_is_blank_where_nothing_is_met():
    panels = _panels(pl.plots.plot_exposure(_shot(region=(100, 106, 200, 208))))
    for ax in panels.values():
        # Row 0 is at the top.
        assert ax.images[0].get_extent() == pytest.approx([199.5, 207.5, 105.5, 99.5])
        bottom, top = ax.get_ylim()
        assert bottom > top and ax.get_xlabel() == "column / pixel"
    drawn = panels["depth"].images[0].get_array()
    assert drawn.mask[0].all() and not drawn.mask[1:].any()


def test_depth_that_is_infinite_everywhere_is_drawn():
    shot = pl.Exposure(np.zeros((2, 2, 1)), truth=GroundTruth(depth=np.full((2, 2), np.inf)))
    pl.plots.plot_exposure(shot).canvas.draw()


def test_the_scale_of_errors_is_that_of_lit_pixels():
    image, error = np.ones((20, 20, 1)), np.full((20, 20, 1), 0.01)
    image[:, 10:], error[:, 10:] = 0.0, 7.0  # black, and told no better than one sample
    drawn = _panels(pl.plots.plot_exposure(pl.Exposure(image, standard_error=error)))["standard error"].images[0]
    assert drawn.get_clim() == (0.0, pytest.approx(0.01))


def test_what_was_not_rendered_is_neither_black_nor_grey():
    counts = np.full((6, 8), 4)
    counts[2:] = 0
    for channels in (1, 3):
        image = np.where(counts[..., None] > 0, np.ones((6, 8, channels)), 0.0)
        error = np.where(counts[..., None] > 0, 0.1 * image, np.inf)
        shot = pl.Exposure(image, standard_error=error, samples=4, sample_counts=counts)
        panels = _panels(pl.plots.plot_exposure(shot))
        drawn = panels["image"].images[0].get_array()
        blue = panels["image"].get_facecolor()[:3]
        if channels == 1:
            assert np.array_equal(np.ma.getmaskarray(drawn), counts == 0)
        else:
            np.testing.assert_allclose(drawn[2:], np.broadcast_to(blue, (4, 8, 3)), atol=1e-6)
        assert blue[2] > blue[0]
        assert np.ma.getmaskarray(panels["standard error"].images[0].get_array())[2:].all()
        assert [text.get_text() for text in panels["image"].texts] == ["pale blue: not rendered"]


def test_a_bright_pixel_does_not_darken_the_others():
    image = np.ones((40, 40, 1))
    image[3, 4] = 1e6
    drawn = _panels(pl.plots.plot_exposure(pl.Exposure(image)))["image"].images[0]
    assert drawn.get_clim() == (0.0, 1.0)


def test_error_of_colours_is_their_root_mean_square():
    error = np.broadcast_to([3.0, 4.0, 0.0], (2, 2, 3))
    drawn = _panels(pl.plots.plot_exposure(pl.Exposure(np.ones((2, 2, 3)), standard_error=error)))["standard error"]
    np.testing.assert_allclose(drawn.images[0].get_array(), np.sqrt(25 / 3), rtol=1e-7)


def test_colours_are_encoded_for_the_screen():
    # IEC 61966-2-1: linear 0.5 is shown as 0.7354.
    image = np.full((4, 4, 3), 1.0)
    image[0, 0] = 0.5
    drawn = _panels(pl.plots.plot_exposure(pl.Exposure(image)))["image"].images[0].get_array()
    np.testing.assert_allclose(drawn[0, 0], 0.7354, atol=1e-4)


def test_draws_into_a_given_figure():
    given = plt.figure()
    assert pl.plots.plot_exposure(_shot(), figure=given) is given
    given.canvas.draw()


def test_what_is_no_exposure_or_lens_is_named():
    with pytest.raises(pl.errors.InvalidValueError, match=r"is an ndarray; give an Exposure, such as pl\.Exposure"):
        pl.plots.plot_exposure(np.zeros((4, 4, 1)))
    with pytest.raises(pl.errors.InvalidValueError, match=r"is an Exposure; give a LensStack, such as camera\.lens"):
        pl.plots.plot_lens(_shot())


def test_without_matplotlib_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    for draw, given in ((pl.plots.plot_exposure, _shot()), (pl.plots.plot_lens, pl.load_lens("singlet-100mm-f4"))):
        with pytest.raises(pl.PlenopticError, match="pip install matplotlib") as caught:
            draw(given)
        assert isinstance(caught.value, ImportError)
