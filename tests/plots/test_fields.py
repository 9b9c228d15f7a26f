"""Figures of what varies over the field."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.lens.analysis.fields import Projection, coma, depth_distortion, distortion, field_curvature
from plenoptic.optics.lens.analysis.illumination import relative_illumination, vignetting
from plenoptic.plots.fields import (
    plot_coma,
    plot_depth_distortion,
    plot_distortion,
    plot_field_curvature,
    plot_relative_illumination,
    plot_vignetting,
)

LENS = pl.load_lens("double-gauss-100mm-f2")
ANGLES = [0.0, 0.15, 0.3]


def test_the_field_runs_upwards_in_degrees():
    found = field_curvature(LENS, ANGLES)
    ax = plot_field_curvature(found)
    sagittal, tangential = ax.lines[:2]
    assert sagittal.get_ydata() == pytest.approx(np.degrees(ANGLES))
    assert sagittal.get_xdata().tolist() == found.sagittal.tolist()
    assert tangential.get_xdata().tolist() == found.tangential.tolist()
    assert ax.get_ylabel() == "half field / °" and ax.get_ylim()[0] == 0.0


def test_distortion_is_in_percent_around_zero():
    found = distortion(LENS, ANGLES)
    ax = plot_distortion(found)
    assert ax.lines[0].get_xdata() == pytest.approx(100 * found.relative)
    left, right = ax.get_xlim()
    assert left == -right
    assert "equidistant" in plot_distortion(distortion(LENS, ANGLES, projection=Projection.EQUIDISTANT)).get_title()


def test_objects_at_a_finite_distance_have_heights():
    ax = plot_distortion(distortion(LENS, [0.0, 50.0], z_object=-404.0))
    assert ax.get_ylabel() == "object height / mm" and ax.lines[0].get_ydata().tolist() == [0.0, 50.0]
    ax = plot_relative_illumination(relative_illumination(LENS, [0.0, 50.0], z_object=-404.0))
    assert len(ax.lines) == 1 and ax.get_legend() is None


def test_all_others_draw_what_they_are_given():
    found = coma(LENS, ANGLES, zone=0.3)
    assert plot_coma(found).lines[1].get_xdata().tolist() == found.tangential.tolist()
    seen = vignetting(LENS, ANGLES)
    assert plot_vignetting(seen).lines[0].get_ydata().tolist() == seen.fraction.tolist()
    light = relative_illumination(LENS, ANGLES)
    ax = plot_relative_illumination(light)
    assert ax.lines[0].get_ydata().tolist() == light.relative.tolist()
    assert ax.lines[1].get_ydata()[-1] == pytest.approx(math.cos(ANGLES[-1]) ** 4)
    depth = depth_distortion(LENS, [0.0, 10.0], z_image=[110.0, 134.6])
    ax = plot_depth_distortion(depth)
    assert ax.lines[0].get_ydata()[0] == pytest.approx(0.0, abs=1e-9) and len(ax.get_legend().get_texts()) == 2


def test_given_axes_are_used_and_fields_without_rays_are_left_out():
    figure, ax = plt.subplots()
    assert plot_field_curvature(field_curvature(LENS, [0.0, 0.3, 1.5]), ax) is ax
    assert len(figure.axes) == 1 and plt.get_fignums() == [figure.number]
    figure.canvas.draw()


def test_another_result_is_refused():
    for plot in (plot_coma, plot_depth_distortion, plot_distortion, plot_field_curvature, plot_vignetting):
        with pytest.raises(pl.errors.InvalidValueError, match="result is a LensStack"):
            plot(LENS)
    with pytest.raises(pl.errors.InvalidValueError, match="result is a LensStack"):
        plot_relative_illumination(LENS)
