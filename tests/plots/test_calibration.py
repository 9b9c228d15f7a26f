"""Figures of small_calibration: rows are down and columns to the right, arrows and bars as long as they say."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
import small_calibration
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.plots.points import draw_arrows


def only(ax, kind):
    (found,) = (part for part in ax.collections if isinstance(part, kind))
    return found


def test_circles_and_arrows_are_those_of_the_lattice():
    grid = small_calibration.grid(offset=(0.1, -0.2))
    white = np.arange(160.0)[:, None] + np.zeros(240)
    left, right = pl.plots.plot_grid(grid, white).axes
    assert left.images[0].get_extent() == [-0.5, 239.5, 159.5, -0.5]
    circles = only(left, EllipseCollection)
    index = grid.indices_of(circles.get_offsets()[:, ::-1])
    np.testing.assert_allclose(grid.centres_of(index)[:, ::-1], circles.get_offsets(), atol=1e-9)
    assert len(index) > 40 and len(np.unique(circles.get_edgecolors(), axis=0)) == 3
    np.testing.assert_allclose(circles.get_widths(), 17.0)
    arrows = only(right, Quiver)
    assert right.get_title().startswith("centres minus lattice\nRMS 0.158 pixel")
    times = float(right.get_title().split()[-4])
    np.testing.assert_allclose(arrows.U, -0.2 * times)
    np.testing.assert_allclose(arrows.V, 0.1 * times)
    for ax in (left, right):
        assert ax.get_xlabel() == "column / pixel" and ax.get_ylim()[0] > ax.get_ylim()[1]


def test_titles_of_a_lattice_fit_into_a_small_figure():
    figure = Figure(figsize=(6.4, 3.2), dpi=30, layout="constrained")
    pl.plots.plot_grid(small_calibration.grid(offset=(0.1, -0.2)), figure=figure)
    figure.draw_without_rendering()
    left, right = (ax.title.get_window_extent() for ax in figure.axes)
    assert left.x0 > 0 and left.x1 < right.x0 and right.x1 < figure.bbox.x1


def test_a_lattice_alone_is_drawn():
    grid = pl.calibration.MicroImageGrid(pl.Lattice.SQUARE, origin=(0, 0), basis=[(0, -9), (9, 0)], shape=(60, 90))
    left, right = pl.plots.plot_grid(grid).axes
    assert not left.images and right.get_title() == "no measured centres"


@pytest.mark.parametrize("frame", [None, 2])
def test_corners_are_drawn_where_they_are(frame):
    observations = small_calibration.observations()
    raw = pl.Exposure(np.ones((20, 30, 1)), region=(100, 120, 200, 230))
    ax = pl.plots.plot_corners(observations, raw, frame=frame)
    drawn = np.concatenate([line.get_xydata() for line in ax.lines])[:, ::-1]
    expected = observations.pixel if frame is None else observations.pixel[observations.frame == frame]
    np.testing.assert_array_equal(np.sort(drawn, axis=0), np.sort(expected, axis=0))
    assert ax.images[0].get_extent() == [199.5, 229.5, 119.5, 99.5]
    assert ax.get_xlim() == (-0.5, 399.5) and ax.get_ylim() == (349.5, -0.5)
    # Points of one colour are those of one frame, or of every seventh board point.
    row = observations.pixel.tolist().index(ax.lines[1].get_xydata()[0, ::-1].tolist())
    assert observations.frame[row] == 1 if frame is None else observations.point[row] % 7 == 1


def test_other_frames_images_and_observations_are_refused():
    observations, calibration = small_calibration.observations(), small_calibration.calibration()
    with pytest.raises(InvalidValueError, match=r"frame is 9; there are corners of \[0, 1, 2, 3\]"):
        pl.plots.plot_corners(observations, frame=9)
    with pytest.raises(InvalidValueError, match="give rows and columns"):
        pl.plots.plot_corners(observations, np.ones(3), frame=0)
    fewer = pl.calibration.Observations(
        observations.index, observations.pixel, observations.frame, observations.point, observations.board,
        observations.centre_index[1:], observations.centre_pixel[1:], observations.sensor,
    )  # fmt: skip
    with pytest.raises(InvalidValueError, match="not those of the calibration"):
        pl.plots.plot_residuals(calibration, fewer)


def test_residuals_are_drawn_over_the_sensor_and_their_histograms_are_densities():
    calibration, observations = small_calibration.calibration(), small_calibration.observations()
    *maps, histogram = pl.plots.plot_residuals(calibration, observations).axes
    for ax, residual in zip(maps, (calibration.corner_residual, calibration.centre_residual), strict=True):
        arrows, times = only(ax, Quiver), float(ax.get_title().split(", ")[1].split()[0])
        means = np.column_stack([arrows.V, arrows.U]) / times
        # The mean over all is that over the cells, up to the number of places in them.
        np.testing.assert_allclose(means.mean(axis=0), residual.mean(axis=0), atol=0.3 * residual.std())
        assert np.abs(means).max() < np.abs(residual).max()
    for polygon in histogram.patches:
        x, y = polygon.get_xy().T
        assert np.sum(np.diff(x) * y[:-1]) == pytest.approx(1.0, abs=0.01)
    assert "RMS 0.0" in histogram.get_legend().get_texts()[0].get_text()


def test_errors_and_heights_are_those_of_the_calibration():
    calibration = small_calibration.calibration()
    errors, correlations, board = pl.plots.plot_calibration(calibration).axes[:3]
    (dots,) = errors.lines
    np.testing.assert_allclose(dots.get_xdata(), [calibration.standard_error(p) for p in calibration.fitted])
    ends = [bar.get_x() + bar.get_width() for bar in errors.patches]
    np.testing.assert_allclose(ends, [0.5 * np.ptp(calibration.interval(p)) for p in calibration.fitted])
    labels = [label.get_text() for label in errors.get_yticklabels()]
    assert labels[:2] == ["focal length / mm", "lens to array / mm"] and "axis row / px" in labels
    drawn = correlations.images[0].get_array()
    np.testing.assert_allclose(np.diag(drawn), 1.0)
    assert drawn[0, 1] > 0.9, "focal length and distance move together"
    heights = board.collections[0].get_array()
    x, y, z = calibration.board.T
    # They differ from z by a plane, and have none themselves.
    table = np.column_stack([x, y, np.ones(len(x))])
    np.testing.assert_allclose(table.T @ heights, 0.0, atol=1e-9)
    assert np.linalg.lstsq(table, z - heights, rcond=None)[1] < 1e-20


def test_arrows_stand_where_places_are_dense():
    """One cell with 100 places, another with 1."""
    places = np.concatenate([np.random.default_rng(0).uniform(0, 1, (100, 2)), [[99.0, 99.0]]])
    ax = plt.figure().subplots()
    times = draw_arrows(ax, np.concatenate([places, places[:100] + 50.0]), np.tile([0.25, -0.5], (201, 1)))
    arrows = only(ax, Quiver)
    np.testing.assert_allclose(arrows.U, 0.25 * times)
    assert len(arrows.U) == 2 and times * np.hypot(0.25, 0.5) == pytest.approx(0.8 * 99 / 15, rel=0.1)
