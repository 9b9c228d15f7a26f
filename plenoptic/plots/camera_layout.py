"""A camera in section with the rays of one pixel, and beside it the microlens that they pass, at its own scale."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.plots.canvas import figure_or_new
from plenoptic.plots.lens import plot_lens, unfolded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.report.layout import SectionRays

_ARRAY, _SENSOR, _RAYS, _PIXEL = "#00796b", "#222222", "#c23b2c", "#e8590c"
_LEAD, _LEAD_OF_FLAT = 0.45, 0.5
"""Length of the rays in front of the lens over that of all behind its first vertex, and over its largest diameter: what
a flat camera needs."""
SIZES = ((9.5, 3.2), (9.5, 4.0))
"""Width and height in inches of one panel and of two."""
_BULGE = 0.07
"""Drawn height of the weakest microlens over the distance to the sensor: a symbol, not its sag."""
_DETAIL = 3.0
"""Heights of the detail, in distances of microlenses, up and down."""
_MOST_PIXELS = 300
"""More would be one grey bar."""


def plot_camera_layout(camera: PlenopticCamera, rays: SectionRays, figure: Figure | None = None) -> Figure:
    """Draw a camera in section, with rays that have been traced, for `PlenopticCamera.layout`.

    Left to scale, in the lens's frame; right, for cameras with microlenses, the one that the rays pass, its neighbours
    and the pixels, each axis at its own scale.
    """
    figure = figure_or_new(figure, SIZES[rays.array is not None])
    if rays.array is None:
        draw_section(camera, rays, figure.subplots())
        return figure
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    draw_section(camera, rays, left)
    _draw_detail(camera, rays, right)
    return figure


def _line(at: Any, half: float) -> Floats:
    """(2, 3): the part in section of a flat thing, up and down from its middle."""
    return np.asarray(at.points(np.array([[0.0, -half, 0.0], [0.0, half, 0.0]])))


def draw_section(camera: PlenopticCamera, rays: SectionRays, ax: Axes) -> None:
    """Draw lens, array and sensor as built, true to scale, and the rays."""
    plot_lens(camera.lens, ax)
    half = 0.5 * camera.sensor.size[0]
    paths = np.concatenate([rays.paths, _extend(camera, rays)[:, None]], axis=1)
    ax.plot(paths[:, :, 2].T, paths[:, :, 1].T, color=_RAYS, linewidth=0.7, zorder=1.5)
    if rays.array is not None:
        _mark(ax, _line(rays.array, half), _ARRAY, "array", (0, (2.0, 0.6)))
    _mark(ax, _line(rays.sensor, half), _SENSOR, "sensor", "-")
    row, column = rays.pixel
    ax.plot([], [], color=_RAYS, linewidth=0.7, label=f"rays of pixel ({row}, {column})")
    ax.legend(frameon=False, fontsize="small", loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)
    ax.set_anchor("N")
    ax.set(title="", xlabel=f"z / mm (scene on the left, iris at 0{unfolded(camera.lens)})")
    ax.margins(0.03)


def _mark(ax: Axes, ends: Floats, colour: str, label: str, style: Any) -> None:
    ax.plot(ends[:, 2], ends[:, 1], color=colour, linewidth=2.2, linestyle=style, label=label, zorder=2.0)


def _extend(camera: PlenopticCamera, rays: SectionRays) -> Floats:
    """Points at which the rays leave the picture in front of the lens; nan for lost ones."""
    front = float(camera.lens.vertices[0])
    widest = 2.0 * max(element.semi_diameter for element in camera.lens.elements)
    lead = front - max(_LEAD * (float(rays.sensor.shift[2]) - front), _LEAD_OF_FLAT * widest)
    last, towards = rays.paths[:, -1], rays.directions
    return np.asarray(last + (lead - last[:, 2:]) / towards[:, 2:] * towards)


def _draw_detail(camera: PlenopticCamera, rays: SectionRays, ax: Axes) -> None:
    """In the array's own axes: distances behind its front principal plane, and heights."""
    assert rays.array is not None and rays.lenses is not None and camera.microlenses is not None
    to_array, lenses = rays.array.inverse(), rays.lenses
    sensor, pixel = to_array.of(rays.sensor), to_array.points(rays.paths[0, 0])
    across = to_array.points(rays.paths[:, 1])
    b, pitch = float(pixel[2]), camera.microlenses.pitches[1]
    middle = float(across[:, 1].mean())
    for y, power, kind in zip(lenses.centre[:, 1].tolist(), lenses.power.tolist(), lenses.type.tolist(), strict=True):
        bulge = -_BULGE * b * power / np.abs(lenses.power).max() if power else 0.0
        arc = np.linspace(-0.5, 0.5, 31)
        ax.plot(bulge * (1.0 - 4.0 * arc**2), y + pitch * arc, color=_ARRAY, linewidth=1.8)
        if len(camera.microlenses.focal_lengths) > 1:
            ax.text(-0.12 * b, y, f"type {kind}", color=_ARRAY, fontsize="small", ha="right", va="center", clip_on=True)
    behind = np.stack([np.broadcast_to(pixel, across.shape), across], axis=1)
    ax.plot(behind[:, :, 2].T, behind[:, :, 1].T, color=_RAYS, linewidth=0.7)
    before = to_array.directions(np.diff(rays.paths[:, 1:3], axis=1)[:, 0])
    ends = np.stack([across, across - before * (b / before[:, 2:])], axis=1)
    ax.plot(ends[:, :, 2].T, ends[:, :, 1].T, color=_RAYS, linewidth=0.7)
    _draw_pixels(camera, rays, sensor, _DETAIL * pitch, ax)
    ax.set_ylim(middle - _DETAIL * pitch, middle + _DETAIL * pitch)
    ax.set(xlabel="distance behind the array / mm", ylabel="y / mm")
    ax.set_title("a microlens and its pixels, each axis at its own scale", fontsize="small")
    ax.axvline(0.0, color=_ARRAY, linewidth=0.6, linestyle=":", zorder=0)


def _draw_pixels(camera: PlenopticCamera, rays: SectionRays, sensor: Any, reach: float, ax: Axes) -> None:
    """The sensor around a pixel, as a line with a tick at each border of pixels."""
    (row, column), pitch, thick = rays.pixel, camera.sensor.pixel_pitch, 0.05 * float(sensor.shift[2])
    x, y = camera.sensor.centre_of(row, column).tolist()
    half = 0.5 * camera.sensor.size[0]
    ends = np.clip([y - 2.0 * reach, y + 2.0 * reach], -half, half)

    def placed(heights: Floats) -> Floats:
        return np.asarray(sensor.points(np.column_stack([np.full(len(heights), x), heights, np.zeros(len(heights))])))

    line, edges = placed(ends), placed(np.array([y - 0.5 * pitch, y + 0.5 * pitch]))
    ax.plot(line[:, 2], line[:, 1], color=_SENSOR, linewidth=1.6)
    if 2.0 * reach / pitch <= _MOST_PIXELS:
        borders = placed(np.arange(np.ceil(ends[0] / pitch), np.floor(ends[1] / pitch) + 1) * pitch)
        ax.hlines(borders[:, 1], borders[:, 2], borders[:, 2] + thick, color=_SENSOR, linewidth=0.5)
    corners = np.concatenate([edges[:, 1:], edges[::-1, 1:] + [0.0, thick]])
    ax.fill(corners[:, 1], corners[:, 0], color=_PIXEL, linewidth=0, zorder=2.5)
    place = (edges[0, 2] + thick, edges[:, 1].mean())
    text: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": "small"}
    ax.annotate("pixel", place, (4, 0), color=_PIXEL, **text)
    ax.margins(x=0.16)  # room for that word
