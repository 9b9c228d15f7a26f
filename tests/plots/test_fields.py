"""Figures of what varies over the field."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest

import plenoptic as pl
from plenoptic import aberrations, plots

LENS = pl.load_lens("double-gauss-100mm-f2")
ANGLES = [0.0, 0.15, 0.3]


def test_the_field_runs_upwards_in_degrees_or_heights():
    found = aberrations.field_curvature(LENS, ANGLES)
    ax = plots.plot_field_curvature(found)
    sagittal, tangential = ax.lines[:2]
    assert sagittal.get_ydata() == pytest.approx(np.degrees(ANGLES))
    assert sagittal.get_xdata().tolist() == found.sagittal.tolist()
    assert tangential.get_xdata().tolist() == found.tangential.tolist()
    assert ax.get_ylabel() == "half field / °" and ax.get_ylim()[0] == 0.0
    ax = plots.plot_distortion(aberrations.distortion(LENS, [0.0, 50.0], z_object=-404.0))
    assert ax.get_ylabel() == "object height / mm" and ax.lines[0].get_ydata().tolist() == [0.0, 50.0]
    # Given axes are used, and fields without rays are left out.
    figure, ax = plt.subplots()
    assert plots.plot_field_curvature(aberrations.field_curvature(LENS, [0.0, 0.3, 1.5]), ax) is ax
    assert len(figure.axes) == 1
    figure.canvas.draw()


def test_distortion_is_in_percent_around_zero():
    found = aberrations.distortion(LENS, ANGLES)
    ax = plots.plot_distortion(found)
    assert ax.lines[0].get_xdata() == pytest.approx(100 * found.relative)
    assert sum(ax.get_xlim()) == 0
    fish = aberrations.distortion(LENS, ANGLES, projection=aberrations.Projection.EQUIDISTANT)
    assert "equidistant" in plots.plot_distortion(fish).get_title()


def test_all_others_draw_what_they_are_given():
    found = aberrations.coma(LENS, ANGLES, zone=0.3)
    assert plots.plot_coma(found).lines[1].get_xdata().tolist() == found.tangential.tolist()
    seen = aberrations.vignetting(LENS, ANGLES)
    assert plots.plot_vignetting(seen).lines[0].get_ydata().tolist() == seen.fraction.tolist()
    light = aberrations.relative_illumination(LENS, ANGLES)
    ax = plots.plot_relative_illumination(light)
    assert ax.lines[0].get_ydata().tolist() == light.relative.tolist()
    assert ax.lines[1].get_ydata()[-1] == pytest.approx(math.cos(ANGLES[-1]) ** 4)
    near = plots.plot_relative_illumination(aberrations.relative_illumination(LENS, [0.0, 50.0], z_object=-404.0))
    assert len(near.lines) == 1 and near.get_legend() is None
    depth = aberrations.depth_distortion(LENS, [0.0, 10.0], z_image=[110.0, 134.6])
    ax = plots.plot_depth_distortion(depth)
    assert ax.lines[0].get_ydata()[0] == pytest.approx(0.0, abs=1e-9) and len(ax.get_legend().get_texts()) == 2
