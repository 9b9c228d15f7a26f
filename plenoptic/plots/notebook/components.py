"""Pictures of sensors and of microlens arrays."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.optics.stops.circle import CircularStop
from plenoptic.plots.canvas import COLOURS, NOTHING
from plenoptic.plots.spots import MICROMETRES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.optics.microlens.array import MicrolensArray
    from plenoptic.optics.sensor.sensor import Sensor

SENSOR_SIZE, ARRAY_SIZE = (7.6, 3.6), (5.6, 4.4)
"""Inches."""
_PIXELS, _LENSES = 3, 3.2
"""Pixels, and pitches on each side of the centre, that are drawn."""
_EDGE = "#31566f"


def draw_sensor(sensor: Sensor, figure: Figure) -> None:
    """Draw the sensor to scale in mm, and the light-sensitive parts of some pixels in micrometres."""
    from matplotlib.patches import Rectangle

    whole, pixels = figure.subplots(1, 2)
    (height, width), pitch = sensor.size, MICROMETRES * sensor.pixel_pitch
    whole.add_patch(Rectangle((-width / 2, -height / 2), width, height, facecolor=NOTHING, edgecolor=_EDGE))
    whole.axhline(0.0, color=_EDGE, linewidth=0.6, linestyle=":")
    whole.axvline(0.0, color=_EDGE, linewidth=0.6, linestyle=":")
    room = 0.54 * max(width, height)
    rows, columns = sensor.shape
    title = f"{rows} x {columns} pixels, {height:.4g} x {width:.4g} mm"
    whole.set(xlim=(-room, room), ylim=(-room, room), xlabel="x / mm", ylabel="y / mm", title=title)
    across, high = pitch * sensor.pixel_aperture[0], pitch * sensor.pixel_aperture[1]
    for row, column in np.ndindex(min(rows, _PIXELS), min(columns, _PIXELS)):
        x, y = column * pitch, row * pitch
        pixels.add_patch(Rectangle((x, y), pitch, pitch, facecolor=COLOURS[4], edgecolor="white", linewidth=0.8))
        corner = x + (pitch - across) / 2, y + (pitch - high) / 2
        pixels.add_patch(Rectangle(corner, across, high, facecolor=NOTHING, edgecolor=_EDGE, linewidth=0.8))
    room = _PIXELS * pitch
    title = f"pixel pitch {pitch:.4g} µm, fill factor {sensor.fill_factor:.3g}"
    pixels.set(xlim=(0.0, room), ylim=(0.0, room), xlabel="x / µm", ylabel="y / µm", title=title)
    for ax in (whole, pixels):
        ax.set_aspect("equal")
        ax.title.set_size("medium")


def draw_array(array: MicrolensArray, ax: Axes) -> None:
    """Draw the openings of microlenses around the centre of the array, one colour for each type."""
    from matplotlib.patches import Polygon

    reach = _LENSES * np.array(array.pitches)
    first = np.zeros(2) if array.centres is None else array.centres[np.hypot(*array.centres.T).argmin()]
    lenses, opening = array.lenses(first - reach - array.cell_radius, first + reach + array.cell_radius), array.opening
    shape = CircularStop(opening.radius).outline() if math.isfinite(opening.radius) else opening.corners
    has_shape = array.centres is None or array.aperture is not None  # cells of listed centres end at their neighbours'
    for centre, kind in zip(lenses.centre, lenses.type.tolist(), strict=True):
        colour = COLOURS[kind % len(COLOURS)]
        if has_shape:
            ax.add_patch(Polygon(centre + shape, facecolor=colour, edgecolor="white", linewidth=0.8, alpha=0.55))
        ax.plot(*centre, ".", color=colour, markersize=3 if has_shape else 9)
    for kind, focal_length in enumerate(array.focal_lengths):
        ax.plot([], [], "o", color=COLOURS[kind % len(COLOURS)], label=f"f = {focal_length:.4g} mm")
    pitch = " x ".join(f"{p:.6g}" for p in dict.fromkeys(array.pitches))
    title = f"{array.lattice.name.lower()}, pitch {pitch} mm, {array.model.name.lower().replace('_', ' ')}"
    ax.set(xlabel="x / mm", ylabel="y / mm", title=title)
    ax.set(xlim=(first[0] - reach[0], first[0] + reach[0]), ylim=(first[1] - reach[1], first[1] + reach[1]))
    ax.set_aspect("equal")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
