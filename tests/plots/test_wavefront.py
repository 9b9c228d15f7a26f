"""Figures of wavefronts, Zernike polynomials, point spreads and contrast with diffraction."""

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import mtf, wave_mtf, wave_spread, wavefront
from plenoptic.plots.aberrations import plot_wavefront, plot_zernike
from plenoptic.plots.contrast import plot_mtf, plot_point_spread

LENS = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(6.0))
FIELD = (0.0, 0.15)
FOUND = wavefront(LENS, field=FIELD, pupil=pl.aiming.square_grid(32))


def test_a_square_grid_is_drawn_as_its_squares():
    ax = plot_wavefront(FOUND)
    (image,) = ax.images
    shown = image.get_array()
    assert shown.shape == (32, 32) and np.ma.count(shown) == len(FOUND.opd)
    column, row = np.rint(16 * (FOUND.pupil + 1) - 0.5).astype(int).T
    np.testing.assert_array_equal(shown[row, column], FOUND.opd)
    # Row 0 is at the lowest y, and no difference is white.
    assert image.get_extent() == [-1, 1, -1, 1] and image.origin == "lower"
    assert sum(image.get_clim()) == 0 and image.get_clim()[1] == np.abs(FOUND.opd).max()
    assert ax.get_title().startswith("field 8.59°, 587.6 nm\nRMS ")
    assert ax.get_aspect() == 1


def test_other_points_are_dots():
    for pupil in (pl.aiming.hexapolar(6), [[0.1, 0.2], [0.1, -0.3]]):
        found = wavefront(LENS, field=FIELD, pupil=pupil)
        ax = plot_wavefront(found)
        assert not ax.images
        np.testing.assert_array_equal(ax.collections[0].get_offsets(), found.pupil)
        np.testing.assert_array_equal(ax.collections[0].get_array(), found.opd)


def test_bars_are_coefficients_without_piston():
    for terms, named in ((15, True), (37, False)):
        fit = FOUND.zernike(terms)
        ax = plot_zernike(fit)
        (bars,) = ax.containers
        assert [bar.get_height() for bar in bars] == fit.coefficients[1:].tolist()
        names = [label.get_text() for label in ax.get_xticklabels()]
        assert ("defocus  4" in names) == named and "NOLL" in ax.get_xlabel()


def test_a_picture_with_diffraction_is_drawn_as_the_geometric_one():
    spread = wave_spread(LENS, field=FIELD, shape=(21, 31))
    ax = plot_point_spread(spread)
    size = 1e3 * spread.pixel_size
    np.testing.assert_allclose(ax.images[0].get_array(), spread.image / size**2)
    assert f"Strehl {spread.strehl:.3g}" in ax.get_title()


def test_contrast_with_diffraction_stands_beside_the_geometric_one():
    frequencies = [0.0, 30.0, 60.0]
    curves = [make(LENS, frequencies, field=(0.0, y)) for y in (0.0, 0.15) for make in (mtf, wave_mtf)]
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
    assert plot_mtf(curves[0]).get_title() == "Geometric MTF, without diffraction"


def test_results_show_in_notebooks():
    for shown in (FOUND, FOUND.zernike(15), wave_spread(LENS, shape=(9, 9))):
        assert "<img" in shown._repr_html_()


def test_something_else_is_refused():
    for draw, wanted in ((plot_wavefront, "Wavefront"), (plot_zernike, "ZernikeFit")):
        with pytest.raises(pl.errors.InvalidValueError, match=f"LensStack; give a {wanted}"):
            draw(LENS)
