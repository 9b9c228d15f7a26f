"""Figures of spots, fans, point spreads and contrast, with diffraction and without: they show what they are given."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import mtf, point_spread, spot_diagram, wave_mtf, wave_spread
from plenoptic.plots import plot_mtf, plot_point_spread, plot_ray_fan, plot_spots

LENS = pl.load_lens("double-gauss-100mm-f2")
LINES = (486.1, 587.6, 656.3)


def _drawn(figure):
    figure.canvas.draw()
    return figure


def test_one_spot():
    spot = spot_diagram(LENS, rays=256)
    (ax,) = _drawn(plot_spots(spot)).axes
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
    assert [ax.get_title() for ax in figure.axes] == ["z = 102 mm", "z = 102.5 mm", "", "", "", ""]
    assert figure.axes[2].get_ylabel().startswith("field 5.73°")
    assert len({ax.get_xlim() for ax in figure.axes}) == 1
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["486.1 nm", "587.6 nm", "656.3 nm"]
    circle = figure.axes[0].lines[0].get_xydata()
    assert np.hypot(*circle.T) == pytest.approx(1e3 * grid[0][0].airy_radius)
    # A column of fields lies in a row.
    spots = [spot_diagram(LENS, field=(0, y), z_object=-404.0, rays=64) for y in (0.0, 20.0)]
    for given in (spots, [[spot] for spot in spots]):
        titles = [ax.get_title().split("\n")[0] for ax in plot_spots(given).axes]
        assert titles == ["field 0 mm", "field 20 mm"]
    for wrong, titles, said in (
        ([], (), "spots is"),
        ([[]], (), "spots has rows"),
        ([1, 2], (), "spots is"),
        ([spots, spots[:1]], (), r"spots has rows of \[2, 1\] diagrams"),
        (spots, ["one"], "1 titles for 2 diagrams"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            plot_spots(wrong, titles=titles)


def test_many_rays_are_thinned_none_are_said_to_be_none_and_perfect_spots_have_an_extent():
    spots = [spot_diagram(LENS, rays=20_000), spot_diagram(LENS, field=(0, 1.3))]
    many, none = _drawn(plot_spots(spots)).axes
    assert 1500 < len(many.collections[0].get_offsets()) <= 3000
    assert none.texts[0].get_text() == "no light"
    (perfect,) = _drawn(plot_spots(spot_diagram(LENS.with_model(pl.LensModel.PARAXIAL), rays=64))).axes
    assert perfect.get_xlim()[1] > 0.05 and perfect.texts[0].get_text() == "RMS < 0.001 µm"


def test_a_ray_fan():
    fan = pl.aberrations.ray_fan(LENS, field=(0, 0.1), wavelength=LINES, points=9)
    figure = _drawn(plot_ray_fan(fan))
    for ax, errors in zip(figure.axes, (fan.tangential[:, :, 1], fan.sagittal[:, :, 0]), strict=True):
        curves = [line.get_ydata() for line in ax.lines if len(line.get_xdata()) == 9]
        assert np.array_equal(curves, 1e3 * errors, equal_nan=True)
    assert len(figure.legends[0].get_texts()) == 3


def test_point_spreads_are_per_square_micrometre():
    spread = point_spread(LENS, field=(0.02, 0.1), shape=(20, 30), pixel_size=0.002, rays=4096)
    ax = plot_point_spread(spread)
    _drawn(ax.figure)
    assert ax.images[0].get_extent() == pytest.approx([-30.0, 30.0, -20.0, 20.0])
    assert ax.get_title().startswith("field (1.15, 5.73)°") and ax.get_title().endswith("% outside")
    np.testing.assert_allclose(ax.images[0].get_array(), spread.image / 2.0**2)
    waves = wave_spread(LENS.with_stop(pl.CircularStop(6.0)), field=(0.0, 0.15), shape=(21, 31))
    ax = plot_point_spread(waves)
    np.testing.assert_allclose(ax.images[0].get_array(), waves.image / (1e3 * waves.pixel_size) ** 2)
    assert f"Strehl {waves.strehl:.3g}" in ax.get_title()


def test_modulation():
    frequencies = np.linspace(0.0, 40.0, 9)
    several = [mtf(LENS, frequencies, field=(0, y), rays=512) for y in (0.0, 0.1)]
    ax = plot_mtf(several)
    _drawn(ax.figure)
    assert [line.get_linestyle() for line in ax.lines] == ["-", ":", "-", ":", "--"]
    assert np.array_equal(ax.lines[2].get_ydata(), several[1].tangential)
    assert np.array_equal(ax.lines[4].get_ydata(), several[0].diffraction)
    one = plot_mtf(several[0], ax=plt.figure().add_subplot())
    assert len(one.lines) == 3 and one.get_title() == "Geometric MTF, without diffraction"
    assert one.get_legend().get_texts()[0].get_text() == "field 0°, tangential"
    for mtfs in (None, [], [3]):
        with pytest.raises(pl.errors.InvalidValueError, match="mtfs is .*; give an? Mtf"):
            plot_mtf(mtfs)
    # Without a lens there is no limit.
    found = mtf(LENS.with_model(pl.LensModel.NONE), [0.0, 0.1], z_object=-404.0, z_image=50.0, rays=64)
    assert np.isnan(found.diffraction[0]) and len(plot_mtf(found).lines) == 2


def test_contrast_with_diffraction_stands_beside_the_geometric_one():
    lens = LENS.with_stop(pl.CircularStop(6.0))
    curves = [make(lens, [0.0, 30.0, 60.0], field=(0.0, y)) for y in (0.0, 0.15) for make in (mtf, wave_mtf)]
    ax = plot_mtf(curves)
    assert ax.get_title() == "MTF, geometric and with diffraction"
    lines = {line.get_label(): line for line in ax.lines}
    assert len(lines) == 9
    np.testing.assert_array_equal(lines["field 8.59°, tangential"].get_ydata(), curves[3].tangential)
    np.testing.assert_array_equal(lines["field 8.59°, geometric, sagittal"].get_ydata(), curves[2].sagittal)
    colours = {label: line.get_color() for label, line in lines.items()}
    assert colours["field 0°, tangential"] == colours["field 0°, geometric, tangential"]
    assert colours["field 0°, tangential"] != colours["field 8.59°, tangential"]
    alone = plot_mtf(curves[1])
    assert alone.get_title() == "MTF with diffraction" and len(alone.lines) == 2


def test_through_focus_shows_both_radii_around_the_best_plane():
    found = pl.aberrations.through_focus(pl.load_lens("singlet-100mm-f4"))
    ax = pl.plots.plot_through_focus(found)
    assert ax.lines[0].get_ydata() == pytest.approx(1e3 * found.rms_radius)
    assert ax.lines[1].get_ydata() == pytest.approx(1e3 * found.geometric_radius)
    assert ax.lines[2].get_xdata()[0] == found.best
