"""Light fields: all views, the central one with slices through the others; pictures and depth from them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.codes import white_point
from plenoptic.core.values import check_has, whole
from plenoptic.errors import InvalidValueError
from plenoptic.plots.canvas import axes_or_new, draw_map, encode, figure_or_new, frame_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.lightfield.depth_map import DepthMap
    from plenoptic.lightfield.focused.view import View
    from plenoptic.lightfield.views import LightField

_GAP = 1
"""Pixels between views."""

_SAME = 1e-6
"""Relative range of numbers below which they are one: the scale shall not spread their rounding."""
_ROW, _COLUMN = "#ff6b00", "#00a5cf"
"""Where slices are taken, and their frames."""
_WIDTH, _HEIGHTS, _SLICE = 5.4, (2.0, 5.0), 0.3
"""Of a central view in inches, and of slices over it."""


def plot_views(field: LightField, *, every: int = 1, ax: Axes | None = None) -> Axes:
    """Draw the sub-aperture views of a light field as a mosaic: u to the right, v down.

    Parameters
    ----------
    field : LightField
    every : int, optional
        Draw every second, third, ... view, counted from the central one.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        Axes are the offsets u and v in pixels of the raw image. One scale for all views, from 0 to the 99.9th
        percentile; grey ones are linear, coloured ones encoded for the screen (sRGB). Pale blue holds nothing.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(80, 80))
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> ax = pl.plots.plot_views(pl.lightfield.decode(white, white, views=5))
    >>> ax.get_xlabel()
    'u / pixel'
    """
    check_has(field, "field", "LightField", "pl.lightfield.decode(shot, white)", "views", "u")
    step = whole(every, "every", at_least=1)
    ax = axes_or_new(ax, (6.4, 6.4))
    chosen = [np.arange(len(o) // 2 % step, len(o), step) for o in (field.u, field.v)]
    views = np.asarray(field.views[np.ix_(*chosen)], dtype=np.float64)
    across, down, rows, columns, channels = views.shape
    if not np.isfinite(views).any():
        raise InvalidValueError("no view of the light field holds any light; decode one with a larger region")
    framed = np.full((across, down, rows + _GAP, columns + _GAP, channels), np.nan)
    framed[:, :, :rows, :columns] = views
    mosaic = framed.transpose(1, 2, 0, 3, 4).reshape(down * (rows + _GAP), across * (columns + _GAP), channels)
    ax.imshow(encode(mosaic, white_point(views)), interpolation="antialiased")
    for offsets, picked, size, name in ((field.u, chosen[0], columns, "x"), (field.v, chosen[1], rows, "y")):
        places = (size + _GAP) * np.arange(len(picked)) + (size - 1) / 2
        shown_ticks = np.unique(np.linspace(0, len(picked) - 1, min(len(picked), 7)).round().astype(int))
        labels = [f"{offsets[picked[k]]:g}" for k in shown_ticks]
        ax.set(**{f"{name}ticks": places[shown_ticks], f"{name}ticklabels": labels})
    ax.set(xlabel="u / pixel", ylabel="v / pixel")
    return ax


def plot_light_field(field: LightField, *, figure: Figure | None = None) -> Figure:
    """Draw the central view of a light field, and slices through the epipolar volume along a row and a column of it.

    Parameters
    ----------
    field : LightField
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        The view; below it its middle row in all views of v = 0, u downwards; beside it its middle column in all views
        of u = 0, v to the right. Points in focus are lines across u or v there, all others slant. Scales as in
        `plot_views`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(80, 80))
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> figure = pl.plots.plot_light_field(pl.lightfield.decode(white, white, views=5))
    >>> [ax.get_ylabel() for ax in figure.axes]
    ['row / pixel', 'u / pixel', '']
    """
    check_has(field, "field", "LightField", "pl.lightfield.decode(shot, white)", "views", "u", "centre")
    figure = figure_or_new(figure, light_field_size(field))
    u, v, rows, columns, _ = field.views.shape
    row, column = rows // 2, columns // 2
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, _SLICE), height_ratios=(1.0, 1.2 * _SLICE))
    white = white_point(field.views[u // 2, v // 2])
    view = figure.add_subplot(grid[0, 0], ylabel="row / pixel")
    view.imshow(encode(field.centre, white), interpolation="antialiased", aspect="auto")
    view.axhline(row, color=_ROW, linewidth=1.0)
    view.axvline(column, color=_COLUMN, linewidth=1.0)
    view.set_title("central view", fontsize="medium")
    below = figure.add_subplot(grid[1, 0], xlabel="column / pixel", ylabel="u / pixel")
    extent = (-0.5, columns - 0.5, *_edges(field.u)[::-1])
    below.imshow(encode(field.views[:, v // 2, row], white), interpolation="nearest", aspect="auto", extent=extent)
    right = figure.add_subplot(grid[0, 1], xlabel="v / pixel")
    extent = (*_edges(field.v), rows - 0.5, -0.5)
    slice_ = field.views[u // 2, :, :, column].transpose(1, 0, 2)
    right.imshow(encode(slice_, white), interpolation="nearest", aspect="auto", extent=extent)
    for ax, colour, title in ((below, _ROW, f"row {row}"), (right, _COLUMN, f"column {column}")):
        frame_axes(ax, colour, title)
    for ax in (view, below, right):
        ax.locator_params(integer=True, nbins=6, min_n_ticks=1)
    return figure


def light_field_size(field: LightField) -> tuple[float, float]:
    """Inches of a figure in which pixels of the central view are square, unless it is very long."""
    rows, columns = field.views.shape[2:4]
    height = float(np.clip(_WIDTH * rows / columns, *_HEIGHTS))
    return _WIDTH * (1.0 + _SLICE) + 1.0, height * (1.0 + 1.2 * _SLICE) + 1.2


def _edges(offsets: NDArray[Any]) -> tuple[float, float]:
    """First and last border of evenly spaced offsets."""
    step = float(offsets[1] - offsets[0]) if len(offsets) > 1 else 1.0
    return float(offsets[0] - 0.5 * step), float(offsets[-1] + 0.5 * step)


def plot_view(view: View, *, figure: Figure | None = None) -> Figure:
    """Draw a picture that a focused camera has seen, its disparity and how densely it was seen.

    Parameters
    ----------
    view : View
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        Picture as in `plot_views`, disparity in pixels, and the coverage where it is not the same everywhere.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(shape=(96, 96))
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> figure = pl.plots.plot_view(pl.lightfield.render_view(white, white, z=-404.0))
    >>> [ax.get_title() for ax in figure.axes if ax.get_title()]
    ['picture', 'disparity', 'coverage']
    """
    check_has(view, "view", "View", "pl.lightfield.render_view(shot, white)", "picture", "coverage")
    figure = figure_or_new(figure, (11.0, 3.4))
    first, *map_axes = figure.subplots(1, 3, sharex=True, sharey=True)
    first.imshow(encode(view.picture, white_point(view.picture)), interpolation="antialiased")
    first.set_title("picture", fontsize="medium")
    _draw_maps(map_axes, (("disparity", view.disparity, "pixel", "viridis"), ("coverage", view.coverage, "", "gray")))
    first.set(xlabel="column / pixel", ylabel="row / pixel")
    return figure


def plot_depth_map(found: DepthMap, *, figure: Figure | None = None) -> Figure:
    """Draw disparity, or depth where it is known, and the confidence in it.

    Parameters
    ----------
    found : DepthMap
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        Depth in mm, disparity in pixels, both between their 2nd and 98th percentile, and confidence from 0 to 1. White
        is not known.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> ones = np.ones((4, 6))
    >>> figure = pl.plots.plot_depth_map(pl.lightfield.DepthMap(ones, ones, ones, ones, 400 * ones))
    >>> [ax.get_title() for ax in figure.axes if ax.get_title()]
    ['depth', 'disparity', 'confidence']
    """
    check_has(found, "found", "DepthMap", "pl.lightfield.depth(shot)", "confidence", "disparity")
    figure = figure_or_new(figure, (11.0, 3.4))
    axes = list(figure.subplots(1, 3, sharex=True, sharey=True))
    maps = (("depth", found.depth, "mm", "viridis"), ("disparity", found.disparity, "pixel", "viridis"),
            ("confidence", found.confidence, "", "gray"))  # fmt: skip
    _draw_maps(axes, maps)
    axes[0].set_ylabel("row / pixel")
    return figure


def _draw_maps(axes: list[Axes], maps: tuple[tuple[str, NDArray[Any], str, str], ...]) -> None:
    """Numbers as colours, each with its scale; shares, which have no unit, from 0 to 1."""
    for ax, (title, values, unit, colours) in zip(axes, maps, strict=True):
        finite = values[np.isfinite(values)]
        low, high = (0.0, 1.0) if not unit or not finite.size else np.percentile(finite, (2.0, 98.0)).tolist()
        if unit and high - low <= _SAME * abs(high):
            low, high = low - 0.5, high + 0.5
        draw_map(ax, np.ma.masked_invalid(values), unit, title, cmap=colours, vmin=low, vmax=high)
        ax.set_xlabel("column / pixel")
