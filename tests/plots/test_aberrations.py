"""Figures of third-order aberrations and of colour; those of waves are in `test_wavefront.py`."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import plenoptic as pl
from plenoptic.plots.aberrations import plot_chromatic_shift, plot_seidel

LENS = pl.load_lens("double-gauss-100mm-f2")
SUMS = pl.aberrations.seidel_sums(LENS, field=0.2)


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
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("element", "Seidel sum / mm")
    assert "587.6 nm" in ax.get_title()


def test_the_focus_is_drawn_against_the_reference():
    lines = [656.3, 486.1, 587.6]
    shift = pl.aberrations.chromatic_shift(LENS, wavelengths=lines, reference=587.6)
    ax = plot_chromatic_shift(shift)
    (curve,) = [line for line in ax.lines if len(line.get_ydata()) == 3]
    assert curve.get_ydata().tolist() == sorted(lines)
    assert curve.get_xdata() == pytest.approx((shift.focus - shift.focus[2])[[1, 2, 0]])
    assert ax.get_xlabel() == "shift of the focus / mm"
    assert ax.get_legend() is None


def test_the_height_is_drawn_where_there_is_a_field():
    shift = pl.aberrations.chromatic_shift(LENS, wavelengths=np.arange(440.0, 681.0, 40.0), field=0.2)
    ax = plot_chromatic_shift(shift)
    names = ["shift of the focus / mm", "shift of the height of the image / mm"]
    assert [part.get_xlabel() for part in ax.figure.axes] == names
    assert all(sum(part.get_xlim()) == 0 for part in ax.figure.axes)
    height = ax.figure.axes[1].lines[0]
    assert height.get_xdata() == pytest.approx(shift.height - shift.height[3])


def test_axes_that_are_given_are_used_and_something_else_is_refused():
    for draw, result in ((plot_seidel, SUMS), (plot_chromatic_shift, pl.aberrations.chromatic_shift(LENS))):
        _, ax = plt.subplots()
        assert draw(result, ax) is ax
        with pytest.raises(pl.errors.InvalidValueError, match=f"LensStack; give a {type(result).__name__}"):
            draw(LENS)
    assert len(plt.get_fignums()) == 2
