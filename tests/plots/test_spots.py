"""Figures of spots, fans, point spreads and modulation: what they show is what they are given."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.lens.analysis.mtf import mtf, point_spread
from plenoptic.optics.lens.analysis.spots import ray_fan, spot_diagram
from plenoptic.plots.contrast import plot_mtf, plot_point_spread
from plenoptic.plots.spots import plot_ray_fan, plot_spots

LENS = pl.load_lens("double-gauss-100mm-f2")
LINES = (486.1, 587.6, 656.3)


def _drawn(figure):
    figure.canvas.draw()
    return figure


def test_one_spot():
    spot = spot_diagram(LENS, rays=256)
    figure = _drawn(plot_spots(spot))
    (ax,) = figure.axes
    assert ax.get_title() == "field 0°\nz = 102.522 mm"
    dots = ax.collections[0].get_offsets()
    assert len(dots) == len(spot.x)
    assert np.max(np.hypot(*np.asarray(dots).T)) == pytest.approx(1e3 * spot.geometric_radius)
    assert ax.get_aspect() == 1.0 and ax.get_xlim() == ax.get_ylim()
    assert ax.texts[0].get_text() == f"RMS {1e3 * spot.rms_radius:.3g} µm"


def test_rows_are_fields_and_columns_planes():
    grid = [
        [spot_diagram(LENS, field=(0, y), z_image=z, wavelength=LINES, rays=64) for z in (102.0, 102.5)]
        for y in (0.0, 0.1, 0.2)
    ]
    figure = _drawn(plot_spots(grid, airy=True))
    assert len(figure.axes) == 6
    assert [ax.get_title() for ax in figure.axes] == ["z = 102 mm", "z = 102.5 mm", "", "", "", ""]
    assert figure.axes[2].get_ylabel().startswith("field 5.73°")
    assert len({ax.get_xlim() for ax in figure.axes}) == 1
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["486.1 nm", "587.6 nm", "656.3 nm"]
    circle = figure.axes[0].lines[0].get_xydata()
    assert np.hypot(*circle.T) == pytest.approx(1e3 * grid[0][0].airy_radius)


def test_a_column_of_fields_lies_in_a_row():
    spots = [spot_diagram(LENS, field=(0, y), z_object=-404.0, rays=64) for y in (0.0, 20.0)]
    for given in (spots, [[spot] for spot in spots]):
        figure = _drawn(plot_spots(given))
        assert [ax.get_title().split("\n")[0] for ax in figure.axes] == ["field 0 mm", "field 20 mm"]


def test_many_rays_are_thinned_and_none_are_said_to_be_none():
    figure = _drawn(plot_spots([spot_diagram(LENS, rays=20_000), spot_diagram(LENS, field=(0, 1.3))]))
    many, none = figure.axes
    assert 1500 < len(many.collections[0].get_offsets()) <= 3000
    assert none.texts[0].get_text() == "no light"


def test_a_perfect_spot_has_an_extent():
    figure = _drawn(plot_spots(spot_diagram(LENS.with_model(pl.LensModel.PARAXIAL), rays=64)))
    assert figure.axes[0].get_xlim()[1] > 0.05
    assert figure.axes[0].texts[0].get_text() == "RMS < 0.001 µm"


def test_what_is_no_spot():
    spot = spot_diagram(LENS, rays=16)
    for spots in (None, 3, [], [[]], "spots", [1, 2]):
        with pytest.raises(pl.errors.InvalidValueError, match="spots is|spots has rows"):
            plot_spots(spots)
    with pytest.raises(pl.errors.InvalidValueError, match=r"spots has rows of \[2, 1\] diagrams"):
        plot_spots([[spot, spot], [spot]])
    with pytest.raises(pl.errors.InvalidValueError, match="1 titles for 2 diagrams"):
        plot_spots([spot] * 2, titles=["one"])


def test_a_ray_fan():
    fan = ray_fan(LENS, field=(0, 0.1), wavelength=LINES, points=9)
    figure = _drawn(plot_ray_fan(fan))
    tangential, sagittal = figure.axes
    curves = [line.get_ydata() for line in tangential.lines if len(line.get_xdata()) == 9]
    assert np.array_equal(curves, 1e3 * fan.tangential[:, :, 1], equal_nan=True)
    curves = [line.get_ydata() for line in sagittal.lines if len(line.get_xdata()) == 9]
    assert np.array_equal(curves, 1e3 * fan.sagittal[:, :, 0], equal_nan=True)
    assert len(figure.legends[0].get_texts()) == 3
    with pytest.raises(pl.errors.InvalidValueError, match="fan is a str; give a RayFan"):
        plot_ray_fan("fan")


def test_a_point_spread():
    spread = point_spread(LENS, field=(0.02, 0.1), shape=(20, 30), pixel_size=0.002, rays=4096)
    ax = plot_point_spread(spread)
    _drawn(ax.figure)
    assert ax.images[0].get_extent() == pytest.approx([-30.0, 30.0, -20.0, 20.0])
    assert ax.images[0].get_array().sum() * 4.0 == pytest.approx(spread.image.sum())
    assert ax.get_title().startswith("field (1.15, 5.73)°") and ax.get_title().endswith("% outside")
    with pytest.raises(pl.errors.InvalidValueError, match="spread is an int; give a PointSpread"):
        plot_point_spread(3)


def test_modulation():
    frequencies = np.linspace(0.0, 40.0, 9)
    several = [mtf(LENS, frequencies, field=(0, y), rays=512) for y in (0.0, 0.1)]
    ax = plot_mtf(several)
    _drawn(ax.figure)
    styles = [line.get_linestyle() for line in ax.lines]
    assert styles == ["-", ":", "-", ":", "--"]
    assert np.array_equal(ax.lines[2].get_ydata(), several[1].tangential)
    assert np.array_equal(ax.lines[4].get_ydata(), several[0].diffraction)
    one = plot_mtf(several[0], ax=plt.figure().add_subplot())
    assert len(one.lines) == 3
    assert one.get_legend().get_texts()[0].get_text() == "field 0°, tangential"
    for mtfs in (None, [], [3], "mtf"):
        with pytest.raises(pl.errors.InvalidValueError, match="mtfs is .*; give an? Mtf"):
            plot_mtf(mtfs)


def test_modulation_without_a_limit():
    lens = LENS.with_model(pl.LensModel.NONE)
    found = mtf(lens, [0.0, 0.1], z_object=-404.0, z_image=50.0, rays=64)
    assert math.isnan(found.diffraction[0])
    assert len(plot_mtf(found).lines) == 2


def test_through_focus_shows_both_radii_around_the_best_plane():
    found = pl.aberrations.through_focus(pl.load_lens("singlet-100mm-f4"))
    ax = pl.plots.plot_through_focus(found)
    assert ax.lines[0].get_ydata() == pytest.approx(1e3 * found.rms_radius)
    assert ax.lines[1].get_ydata() == pytest.approx(1e3 * found.geometric_radius)
    assert ax.lines[2].get_xdata()[0] == found.best
    with pytest.raises(pl.errors.InvalidValueError, match="found is a LensStack; give a ThroughFocus"):
        pl.plots.plot_through_focus(LENS)
