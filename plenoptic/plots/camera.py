"""A camera in section: lens, array and sensor, and how the images of neighbouring microlenses lie on the sensor."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import check_has
from plenoptic.plots.canvas import figure_or_new
from plenoptic.plots.lens import plot_lens

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.report.report import CameraReport

_ARRAY, _SENSOR, _LIGHT = "#2c8a3d", "#222222", "#c23b2c"
_COLOURS = ("#1f5fbf", "#b07a00")
_NEIGHBOURS = 2
_BULGE = 0.06
"""Drawn height of a microlens over its width: a symbol, not its sag."""


def plot_camera(camera: PlenopticCamera, report: CameraReport | None = None) -> Figure:
    """Draw a camera in section, and the light under the microlenses around the axis.

    Parameters
    ----------
    camera : PlenopticCamera
    report : CameraReport, optional
        Of that camera; None: it is made.

    Returns
    -------
    matplotlib.figure.Figure
        Left: lens, array and sensor as designed, true to scale, with the cone of light from the iris to the middle of
        the array. Right, for cameras with microlenses: the light that passes the centres of five microlenses, from the
        exit pupil to the sensor, by the traced f-number; where colours overlap, microlens images do.

    Examples
    --------
    >>> import plenoptic as pl
    >>> from plenoptic.camera.report.report import camera_report
    >>> from plenoptic.plots.camera import plot_camera
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0)),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.010), stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> [ax.get_title() for ax in plot_camera(camera, camera_report(camera)).axes]
    ['double-gauss-100mm-f2', 'f/7.83 under f/8.26: images 0.94 as wide as their distance']
    """
    check_has(camera, "camera", "PlenopticCamera", "pl.PlenopticCamera(...)", "stop_to_microlenses")
    report = camera.report() if report is None else report
    check_has(report, "report", "CameraReport", "camera.report()", "working_f_number")
    two = camera.microlenses is not None
    figure = figure_or_new(None, (11.0, 4.5) if two else (7.0, 4.5))
    _draw_section(camera, report, figure.add_subplot(1, 2 if two else 1, 1))
    if two:
        _draw_microlenses(camera, report, figure.add_subplot(1, 2, 2))
    return figure


def _draw_section(camera: PlenopticCamera, report: CameraReport, ax: Axes) -> None:
    place, name = camera.stop_to_microlenses, camera.lens.name
    plot_lens(camera.lens, ax)
    half = 0.5 * camera.sensor.size[0]
    if camera.microlenses is not None:
        ax.plot([place, place], [-half, half], color=_ARRAY, linewidth=2.0, linestyle=(0, (1, 0.5)), label="array")
    ax.plot([camera.z_sensor] * 2, [-half, half], color=_SENSOR, linewidth=2.0, label="sensor")
    start = float(camera.lens.vertices[-1])
    reach = 0.5 * (place - start) / report.working_f_number
    ax.fill([start, place, start], [-reach, 0.0, reach], color=_LIGHT, alpha=0.25, linewidth=0.0)
    ax.legend(frameon=False, fontsize="small")
    ax.set_title(name or "camera")


def _draw_microlenses(camera: PlenopticCamera, report: CameraReport, ax: Axes) -> None:
    assert report.image_pitch is not None and report.image_diameter is not None
    b, slope = camera.microlenses_to_sensor, 0.5 / report.working_f_number
    ratio = 1.0 if math.isinf(report.exit_pupil_distance) else 1.0 + b / report.exit_pupil_distance
    p = report.image_pitch / abs(ratio)
    arc = np.linspace(-0.5, 0.5, 21)
    for k in range(-_NEIGHBOURS, _NEIGHBOURS + 1):
        colour, centre = _COLOURS[k % 2], k * p
        before, behind = centre * (2.0 - ratio), centre * ratio
        spread = b * slope
        ax.fill([0, b, b], [centre, behind - spread, behind + spread], color=colour, alpha=0.4, linewidth=0.0)
        ax.fill([0, -b, -b], [centre, before - spread, before + spread], color=colour, alpha=0.15, linewidth=0.0)
        ax.plot(-_BULGE * b * (1 - 4 * arc**2), centre + p * arc, color=_ARRAY, linewidth=1.5)
    reach = (_NEIGHBOURS + 1) * p
    ax.plot([b, b], [-reach, reach], color=_SENSOR, linewidth=2.0)
    edges = np.arange(np.ceil(-reach / camera.sensor.pixel_pitch), np.floor(reach / camera.sensor.pixel_pitch) + 1)
    if len(edges) <= 400:
        ax.hlines(edges * camera.sensor.pixel_pitch, b, 1.05 * b, color=_SENSOR, linewidth=0.5)
    ax.set_ylim(-reach, reach)
    ax.set(xlabel="distance behind the array / mm", ylabel="y / mm")
    ax.set_title(
        f"f/{report.microlens_f_number:.3g} under f/{report.working_f_number:.3g}: "
        f"images {report.image_fill:.2f} as wide as their distance",
        fontsize="medium",
    )
