"""Figures of aberrations: third-order sums, colour, wavefronts, Zernike polynomials; curves are told apart."""

import itertools

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgb

import plenoptic as pl
from plenoptic.core.color.srgb import srgb_to_linear
from plenoptic.plots.aberrations import plot_chromatic_shift, plot_seidel, plot_wavefront, plot_zernike
from plenoptic.plots.canvas import COLOURS, wavelength_colours

LENS = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(6.0))
SUMS = pl.aberrations.seidel_sums(LENS, field=0.2)
FOUND = pl.aberrations.wavefront(LENS, field=(0.0, 0.15), pupil=pl.aiming.square_grid(32))


def test_bars_are_the_sums_of_each_surface_and_of_the_lens():
    ax = plot_seidel(SUMS)
    surfaces = [i for i, e in enumerate(LENS.elements) if isinstance(e, pl.Surface)]
    assert [label.get_text() for label in ax.get_xticklabels()] == [*map(str, surfaces), "sum"]
    assert len(ax.containers) == 5
    for k, bars in enumerate(ax.containers):
        heights = [bar.get_height() for bar in bars]
        assert heights == pytest.approx([*SUMS.table[surfaces, k], SUMS.total[k]])
    # Bars of one surface do not reach those of the next.
    left = min(bar[1].get_x() for bar in ax.containers)
    right = max(bar[0].get_x() + bar[0].get_width() for bar in ax.containers)
    assert right < left
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names == ["spherical", "coma", "astigmatism", "Petzval", "distortion"]
    _, given = plt.subplots()
    assert plot_seidel(SUMS, given) is given and len(plt.get_fignums()) == 2


def test_focus_and_height_are_drawn_against_the_reference():
    lines = [656.3, 486.1, 587.6]
    shift = pl.aberrations.chromatic_shift(LENS, wavelengths=lines, reference=587.6)
    ax = plot_chromatic_shift(shift)
    (curve,) = [line for line in ax.lines if len(line.get_ydata()) == 3]
    assert curve.get_ydata().tolist() == sorted(lines)
    assert curve.get_xdata() == pytest.approx((shift.focus - shift.focus[2])[[1, 2, 0]])
    shift = pl.aberrations.chromatic_shift(LENS, wavelengths=np.arange(440.0, 681.0, 40.0), field=0.2)
    focus, height = plot_chromatic_shift(shift).figure.axes
    assert (focus.get_xlabel(), height.get_xlabel()[:19]) == ("shift of the focus / mm", "shift of the height")
    assert sum(focus.get_xlim()) == sum(height.get_xlim()) == 0
    assert height.lines[0].get_xdata() == pytest.approx(shift.height - shift.height[3])


def test_wavefronts_are_squares_of_a_grid_or_dots():
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
    for pupil in (pl.aiming.hexapolar(6), [[0.1, 0.2], [0.1, -0.3]]):
        found = pl.aberrations.wavefront(LENS, field=(0.0, 0.15), pupil=pupil)
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
    for shown in (FOUND, fit, pl.aberrations.wave_spread(LENS, shape=(9, 9))):
        assert "<img" in shown._repr_html_()


# F. Vienot, H. Brettel and J. D. Mollon, Color Res. Appl. 24, 243 (1999), on linear sRGB.
PROTANOPE = np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]])
DEUTERANOPE = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]])
# IEC 61966-2-1.
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(colour, seen_by):
    """CIELAB of a colour as somebody sees it."""
    xyz = TO_XYZ @ np.clip(seen_by @ srgb_to_linear(np.array(to_rgb(colour))), 0.0, 1.0)
    x, y, z = np.cbrt(np.maximum(xyz / TO_XYZ.sum(axis=1), 1e-6))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def test_colours_are_told_apart_and_longer_wavelengths_are_lighter():
    # A difference of 2.3 is just seen side by side; thin lines and dots apart take several times as much.
    kinds = ((COLOURS, 18), (wavelength_colours([400, 500, 600]), 35), (wavelength_colours(range(5)), 10))
    for seen_by in (np.eye(3), PROTANOPE, DEUTERANOPE):
        for colours, least in kinds:
            seen = [lab(colour, seen_by) for colour in colours]
            assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(seen, 2)) > least, (seen_by, least)
    lightness = [lab(colour, np.eye(3))[0] for colour in wavelength_colours([650.0, 450.0, 550.0])]
    assert lightness[1] < lightness[2] < lightness[0] < 80  # and lines stand out against white


def test_results_of_another_kind_are_refused():
    for draw in ("seidel", "chromatic_shift", "wavefront", "zernike", "through_focus", "coma", "depth_distortion",
                 "distortion", "field_curvature", "vignetting", "relative_illumination", "point_spread", "ray_fan",
                 "spots", "mtf", "exposure", "views", "scene"):  # fmt: skip
        with pytest.raises(pl.errors.InvalidValueError, match="is a LensStack; give an? [A-Z]"):
            getattr(pl.plots, f"plot_{draw}")(LENS)
    with pytest.raises(pl.errors.InvalidValueError, match=r"is a SeidelSums; give a LensStack, such as camera\.lens"):
        pl.plots.plot_lens(SUMS)
