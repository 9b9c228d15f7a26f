"""Plots of a camera: its section, the images of neighbouring microlenses on its sensor, point spreads."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.camera.report.layout import section_rays
from plenoptic.core.values import Floats, check_has
from plenoptic.plots.camera_layout import draw_section
from plenoptic.plots.canvas import COLOURS, axes_or_new, draw_map, figure_or_new, pixel_extent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.psf.psf_results import CameraSpread
    from plenoptic.camera.report.report import CameraReport
    from plenoptic.wave.wave_spread import WaveSpread

_ARRAY, _SENSOR = COLOURS[2], "#222222"
_COLOURS = ("#1f5fbf", "#b07a00")
_NEIGHBOURS = 2
_BULGE = 0.06
"""Drawn height of a microlens over its width: a symbol, not its sag."""
_MARGIN = 2
"""Dark pixels left around the light of a smaller point among several."""
_MARK = "#35c4ff"


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
        Left: section as in `PlenopticCamera.layout`. Right, for cameras with microlenses: the light that passes the
        centres of five microlenses, from the exit pupil to the sensor, by the traced f-number; where colours overlap,
        micro images do.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> pl.plots.plot_camera(camera).axes[1].get_title()
    'f/7.83 under f/8.26: images 0.94 as wide as their distance'
    """
    check_has(camera, "camera", "PlenopticCamera", "pl.PlenopticCamera(...)", "stop_to_microlenses")
    report = camera.report() if report is None else report
    check_has(report, "report", "CameraReport", "camera.report()", "working_f_number")
    panels = 1 if camera.microlenses is None else 2
    figure = figure_or_new(None, (3.0 + 4.0 * panels, 4.5))
    draw_section(camera, section_rays(camera), figure.add_subplot(1, panels, 1))
    if panels == 2:
        _draw_microlenses(camera, report, figure.add_subplot(1, 2, 2))
    return figure


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


def plot_camera_spread(spread: CameraSpread | WaveSpread, ax: Axes | None = None) -> Axes:
    """Draw the light of one point, or of several together, on the sensor.

    Parameters
    ----------
    spread : CameraSpread or wave.WaveSpread
        From `plenoptic.point_spread` or `wave.point_spread`.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        The part of the sensor that the light reaches, with rows and columns as axes (pixel centres are whole numbers,
        row 0 at the top, as in images). Brightness grows with the root of the value. Crosses are centroids of rays.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
    >>> ax = pl.plots.plot_camera_spread(pl.point_spread(camera, (5.0, 0.0, -404.0)))
    >>> ax.get_xlabel()
    'column / pixel'
    """
    check_has(spread, "spread", "CameraSpread", "pl.point_spread(camera, point)", "corner", "points", "sensor")
    ax = axes_or_new(ax, (6.2, 5.0))
    from matplotlib.colors import PowerNorm

    image, row, column = _together(spread)
    # Brightness by the root: the light of a point is a few bright pixels and a faint flare.
    scale = PowerNorm(0.5, vmin=0.0, vmax=float(image.max()) or 1.0)
    extent, unit = pixel_extent(row, column, image.shape), "light per area / (sr/mm²)"
    draw_map(ax, image, unit, _title(spread), extent=extent, cmap="inferno", norm=scale)
    if not image.any():
        ax.text(0.5, 0.5, "no light", transform=ax.transAxes, ha="center", va="center", color="white")
    ax.locator_params(integer=True, min_n_ticks=1)
    if hasattr(spread, "centroid"):
        places = spread.sensor.pixel_of(np.atleast_2d(spread.centroid))
        ax.plot(places[:, 1], places[:, 0], linestyle="none", marker="+", color=_MARK, markersize=9)
    ax.set(xlabel="column / pixel", ylabel="row / pixel")
    return ax


def _together(spread: CameraSpread | WaveSpread) -> tuple[Floats, int, int]:
    """Sum of the images of all points on the rectangle that holds their light; its first row and column."""
    images = spread.image.reshape(-1, *spread.image.shape[-2:])
    corners = np.atleast_2d(spread.corner)
    first, size = corners.min(axis=0), np.array(images.shape[1:])
    total = np.zeros(corners.max(axis=0) + size - first)
    for image, (row, column) in zip(images, (corners - first).tolist(), strict=True):
        total[row : row + size[0], column : column + size[1]] += image
    lit = np.argwhere(total)
    if not len(lit):
        return total, int(first[0]), int(first[1])
    low = np.maximum(lit.min(axis=0) - _MARGIN, 0)
    high = lit.max(axis=0) + 1 + _MARGIN
    return total[low[0] : high[0], low[1] : high[1]], int(first[0] + low[0]), int(first[1] + low[1])


def _title(spread: CameraSpread | WaveSpread) -> str:
    points, light = np.atleast_2d(spread.points), 1e3 * spread.image.sum() * spread.sensor.pixel_pitch**2
    if len(points) > 1:
        return f"{len(points)} points, {light:.3g} msr in all"
    return f"point ({', '.join(f'{x:.4g}' for x in points[0])}) mm, {light:.3g} msr"
