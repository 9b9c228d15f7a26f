"""Points on the sensor: centres of micro images, and where points of the world appear."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import Floats, check_has
from plenoptic.plots.canvas import COLOURS, axes_or_new, figure_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.camera.points.centres import MicrolensCentres
    from plenoptic.camera.points.projection import Projection

_MARKS = "osD^vP*"
_ARROWS = 15
"""Along a side."""
_NEAR = 3.5
"""The detail reaches this many distances of microlenses from the middle."""
_MOST = 4000
"""Rows that are drawn, evenly chosen of more."""


def plot_centres(centres: MicrolensCentres, *, figure: Figure | None = None) -> Figure:
    """Draw how centres of micro images are displaced over the sensor, and those around its middle.

    Parameters
    ----------
    centres : MicrolensCentres
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        Left, arrows from the microlenses (their place on the array) to the centres of their images on the sensor, means
        over cells, 15 along a side, drawn longer as the title says; right, each type of microlens around the middle
        with its own mark, with rows and columns as axes.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(64, 64))
    >>> figure = pl.plots.plot_centres(pl.microlens_centres(camera))
    >>> [ax.get_xlabel() for ax in figure.axes]
    ['x / mm', 'column / pixel']
    """
    check_has(centres, "centres", "MicrolensCentres", "pl.microlens_centres(camera)", "on_array", "pixel")
    figure = figure_or_new(figure, (9.6, 4.4))
    left, right = figure.subplots(1, 2)
    for ax in (left, right):
        ax.set_aspect("equal")
    left.set(xlabel="x / mm", ylabel="y / mm")
    right.set(xlabel="column / pixel", ylabel="row / pixel")
    left.set_title("no microlens has its image on the sensor", fontsize="medium")
    right.set_title("around the middle, with lattice indices", fontsize="medium")
    if len(centres):
        _draw_displacements(centres, left)
        _draw_middle(centres, right)
    return figure


def _draw_displacements(centres: MicrolensCentres, ax: Axes) -> None:
    times = draw_arrows(ax, centres.on_array, centres.position - centres.on_array)
    ax.set_title(f"from microlens to image, {times:g} times as long", fontsize="medium")


def draw_arrows(ax: Axes, places: Floats, moved: Floats, colour: str = COLOURS[0]) -> float:
    """Draw displacements (n, 2) of places (n, 2), means over square cells; the factor by which they are longer.

    Cells with less than a quarter of the median number of places are left out.
    """
    low, high = places.min(axis=0), places.max(axis=0)
    span = float((high - low).max()) or 1.0
    _, cell, count = np.unique(
        np.floor((places - low) / span * (_ARROWS - 1e-9)).astype(int), axis=0, return_inverse=True, return_counts=True
    )
    start, step = (
        np.column_stack([np.bincount(cell.ravel(), column) / count for column in part.T])[count >= np.median(count) / 4]
        for part in (places, moved)
    )
    longest = float(np.hypot(*step.T).max())
    times = 0.8 * span / _ARROWS / longest if longest else 1.0
    times = float(f"{times:.1g}") if times < 1e6 else 1.0
    to_scale: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.004}
    ax.quiver(*start.T, *(times * step).T, color=colour, **to_scale)
    ax.plot(*start.T, ".", color=colour, markersize=3)
    ax.margins(0.1)
    return times


def _draw_middle(centres: MicrolensCentres, ax: Axes) -> None:
    pixel = centres.pixel
    middle = 0.5 * (pixel.min(axis=0) + pixel.max(axis=0))
    away = np.hypot(*(pixel - middle).T)
    first = pixel[int(np.argmin(away))]
    distances = np.sort(np.hypot(*(pixel - first).T))
    reach = _NEAR * float(distances[1] if len(distances) > 1 and distances[1] > 0 else 1.0)
    near = np.abs(pixel - first).max(axis=1) <= 0.97 * reach
    for kind in np.unique(centres.type[near]).tolist():
        of_kind = pixel[near & (centres.type == kind)]
        colour, mark = COLOURS[kind % len(COLOURS)], _MARKS[kind % len(_MARKS)]
        ax.plot(of_kind[:, 1], of_kind[:, 0], mark, color=colour, markersize=5, label=f"type {kind}")
    for place, (i, j) in zip(pixel[near], centres.index[near].tolist(), strict=True):
        ax.annotate(f"{i}, {j}", place[::-1], (3, 3), textcoords="offset points", fontsize="xx-small", color="#555555")
    ax.set(xlim=(first[1] - reach, first[1] + reach), ylim=(first[0] + reach, first[0] - reach))
    if np.ptp(centres.type):
        ax.legend(fontsize="small", frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def plot_projection(projection: Projection, ax: Axes | None = None) -> Axes:
    """Draw where points of the world appear in the images of all microlenses.

    Parameters
    ----------
    projection : Projection
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        Rows and columns of the sensor, row 0 at the top: centroids of the light, or chief rays where none is known; a
        colour and a mark for each point, which repeat after the seventh. Points that nothing sees are hollow.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
    >>> pl.plots.plot_projection(camera.project([(5.0, 0.0, -404.0)])).get_title()
    '1 point, seen 1 time'
    """
    check_has(projection, "projection", "Projection", "camera.project(points)", "centroid_pixel", "visible")
    ax = axes_or_new(ax, (6.0, 5.0))
    lit = np.asarray(np.isfinite(projection.centroid_pixel).all(axis=1))
    place = np.where(lit[:, None], projection.centroid_pixel, projection.pixel)
    rows = np.flatnonzero(np.isfinite(place).all(axis=1))
    rows = rows[:: -(-len(rows) // _MOST) or 1]
    for k in range(min(len(COLOURS), len(projection.points))):
        group = rows[projection.point[rows] % len(COLOURS) == k]
        for is_visible, filled in ((True, COLOURS[k]), (False, "none")):
            part = place[group[projection.visible[group] == is_visible]]
            style: dict[str, Any] = {"color": COLOURS[k], "markerfacecolor": filled, "markersize": 5}
            ax.plot(part[:, 1], part[:, 0], _MARKS[k], label=f"point {k}" if is_visible else None, **style)
    ax.set(xlabel="column / pixel", ylabel="row / pixel")
    count, visible_count = len(projection.points), int(np.count_nonzero(projection.visible))
    ax.set_title(
        f"{count} point{'s' * (count != 1)}, seen {visible_count} time{'s' * (visible_count != 1)}", fontsize="medium"
    )
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    if len(rows):
        ax.invert_yaxis()
    if 0 < count <= len(COLOURS):
        ax.legend(fontsize="small", frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return ax
