"""Figures of calibrations: lattices on white images, corners, residuals, errors of parameters, and the board."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.codes import white_point
from plenoptic.core.values import Floats, check_has, plain_array
from plenoptic.errors import InvalidValueError
from plenoptic.plots.canvas import COLOURS, axes_or_new, encode, figure_or_new, pixel_extent
from plenoptic.plots.points import draw_arrows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.calibration.calibration_result import Calibration
    from plenoptic.calibration.corners.find_corners import BoardCorners
    from plenoptic.calibration.observations import Observations
    from plenoptic.camera.points.micro_image_grid import MicroImageGrid

SIZE = (9.6, 4.4)
"""Inches."""
_NEAR = 4.5
"""Pitches from the middle of the detail to its border."""
_BINS, _REACH = 60, 5.0
"""Bars of a histogram, and its half width in standard deviations."""


def plot_grid(grid: MicroImageGrid, white: Any = None, *, figure: Figure | None = None) -> Figure:
    """Draw the lattice of micro images over a white image, and the distances of measured centres from it.

    Parameters
    ----------
    grid : MicroImageGrid
    white : Exposure, RawImage or array, optional
        White image in which it was found.
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        Left, the middle of the sensor: circles of the lattice, with their smooth deviation, a colour for each type, of
        the median measured radius or half a pitch; dots at measured centres. Right, over the whole sensor, arrows from
        the lattice to measured centres, means over cells, drawn longer as the title says.

    Examples
    --------
    >>> import plenoptic as pl
    >>> white = pl.render_white(pl.camera.example_camera(shape=(128, 128)), samples=64, progress=False)
    >>> grid = pl.calibration.find_micro_images(white)
    >>> figure = pl.plots.plot_grid(grid, white)
    >>> [ax.get_xlabel() for ax in figure.axes]
    ['column / pixel', 'column / pixel']
    """
    check_has(grid, "grid", "MicroImageGrid", "pl.calibration.find_micro_images(white)", "centres_of", "type_pattern")
    figure = figure_or_new(figure, SIZE)
    left, right = figure.subplots(1, 2)
    _draw_lattice(left, grid, white)
    rows, columns = grid.shape
    right.set(xlabel="column / pixel", ylabel="row / pixel", aspect="equal", title="no measured centres")
    if grid.index is not None and grid.centre is not None and len(grid.index):
        place = grid.centres_of(grid.index)
        offset = grid.centre - place
        times = draw_arrows(right, place[:, ::-1], offset[:, ::-1])
        rms = float(np.sqrt(np.mean(offset**2)))
        right.set_title(f"centres minus lattice\nRMS {rms:.3f} pixel, {times:g} times as long", fontsize="medium")
    right.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
    return figure


def _draw_lattice(ax: Axes, grid: MicroImageGrid, white: Any) -> None:
    from matplotlib.collections import EllipseCollection

    if white is not None:
        _draw_pixels(ax, white)
    index = grid.on_sensor
    centre, kind = grid.centres_of(index), grid.types_of(index)
    middle, reach = 0.5 * (np.array(grid.shape) - 1.0), _NEAR * max(grid.pitches)
    near = np.abs(centre - middle).max(axis=1) <= reach + grid.pitch
    size = grid.pitch if grid.radius is None or not len(grid.radius) else 2.0 * float(np.median(grid.radius))
    sizes = np.full(np.count_nonzero(near), size)
    colours = [COLOURS[k % len(COLOURS)] for k in kind[near].tolist()]
    circles: dict[str, Any] = {"units": "xy", "facecolors": "none", "edgecolors": colours, "linewidths": 1.2}
    ax.add_collection(
        EllipseCollection(
            sizes, sizes, np.zeros(len(sizes)), offsets=centre[near, ::-1], offset_transform=ax.transData, **circles
        )
    )
    if grid.centre is not None:
        ax.plot(grid.centre[:, 1], grid.centre[:, 0], ".", color=COLOURS[1], markersize=3)
    ax.set(xlim=(middle[1] - reach, middle[1] + reach), ylim=(middle[0] + reach, middle[0] - reach), aspect="equal")
    ax.set(xlabel="column / pixel", ylabel="row / pixel")
    ax.set_title(f"{grid.lattice.name.lower()}, around the middle\npitch {grid.pitch:.5g} pixels", fontsize="medium")


def _draw_pixels(ax: Axes, raw: Any) -> None:
    """Draw an exposure, a raw image or an array in grey, at its place on the sensor."""
    numbers = raw.image if hasattr(raw, "image") else raw.data if hasattr(raw, "electrons") else raw
    pixels = plain_array(numbers, "the image").astype(np.float64)
    if pixels.ndim not in (2, 3) or not pixels.size:
        raise InvalidValueError(f"the image has shape {pixels.shape}; give rows and columns of pixels")
    grey = pixels.reshape(*pixels.shape[:2], -1).mean(axis=2, keepdims=True)
    region = getattr(raw, "region", None) or (0, 0, 0, 0)
    extent = pixel_extent(region[0], region[2], grey.shape)
    low = float(np.nanmin(grey))
    ax.imshow(encode(grey - low, white_point(grey - low)), interpolation="nearest", extent=extent)


def plot_corners(
    corners: Observations | BoardCorners, raw: Any = None, *, frame: int | None = None, ax: Axes | None = None
) -> Axes:
    """Draw corners of boards in micro images, over a raw image.

    Parameters
    ----------
    corners : Observations or BoardCorners
    raw : Exposure, RawImage or array, optional
        Raw image of the frame.
    frame : int, optional
        Number of the frame, as in `Observations.frames`; None: all frames, a colour for each.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        Rows and columns of the sensor, row 0 at the top. Corners of one frame have a colour for each point of the
        board. Colours repeat after the seventh.

    Raises
    ------
    InvalidValueError
        If no corner is of the frame.

    Examples
    --------
    See `Observations`.
    """
    check_has(corners, "corners", "Observations", "pl.calibration.observe(raws, white, board, ...)", "pixel", "point")
    frames = getattr(corners, "frame", np.zeros(len(corners.point), np.int64))
    chosen = np.ones(len(frames), dtype=bool) if frame is None else frames == frame
    if frame is not None and not chosen.any():
        numbers = f"{np.unique(frames).tolist()}" if len(frames) else "no frame: they are a white image alone"
        raise InvalidValueError(f"frame is {frame}; there are corners of {numbers}")
    ax = axes_or_new(ax, (6.4, 5.0))
    if raw is not None:
        _draw_pixels(ax, raw)
    pixel, point, number = corners.pixel[chosen], corners.point[chosen], len(np.unique(frames[chosen]))
    group = (frames[chosen] if number > 1 else point) % len(COLOURS)
    for k, colour in enumerate(COLOURS):
        row, column = pixel[group == k].T
        ax.plot(column, row, "+", color=colour, markersize=5 if number == 1 else 3)
    ax.set(xlabel="column / pixel", ylabel="row / pixel", aspect="equal")
    if hasattr(corners, "sensor"):
        height, width = corners.sensor.shape
        ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    elif raw is None:
        ax.invert_yaxis()
    title = f"{number} frames: " * (number > 1) if frame is None else f"frame {frame}: "
    ax.set_title(f"{title}{len(point)} images of {len(np.unique(point))} points", fontsize="medium")
    return ax


def plot_residuals(calibration: Calibration, observations: Observations, *, figure: Figure | None = None) -> Figure:
    """Draw the residuals of a calibration over the sensor, and their distribution.

    Parameters
    ----------
    calibration : Calibration
    observations : Observations
        The observations it was made from.
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        Left and middle, projection minus observation of corners and centres: arrows are means over cells, drawn longer
        as the title says; what the model lacks shows as a pattern. Right, histograms of both coordinates in units of
        their root mean square, and the normal distribution.

    Raises
    ------
    InvalidValueError
        If the observations are others.

    Examples
    --------
    See `Calibration`.
    """
    check_has(calibration, "calibration", "Calibration", "pl.calibrate(observations, start=...)", "corner_residual")
    check_has(observations, "observations", "Observations", "pl.calibration.Observations(...)", "pixel", "centre_pixel")
    pairs = (
        ("corners", observations.pixel, calibration.corner_residual),
        ("centres", observations.centre_pixel, calibration.centre_residual),
    )
    if any(place.shape != residual.shape for _, place, residual in pairs):
        sizes = [(len(observations.pixel), len(observations.centre_pixel))]
        sizes += [(len(each.corner_residual), len(each.centre_residual)) for each in calibration.settings]
        setting = f"; those of its settings[{sizes.index(sizes[0], 1) - 1}]" if sizes[0] in sizes[1:] else ""
        raise InvalidValueError(
            f"the observations are not those of the calibration{setting}; give the ones it was made from"
        )
    figure = figure_or_new(figure, (13.0, 4.0))
    *maps, histogram = figure.subplots(1, 3)
    height, width = observations.sensor.shape
    for ax, (name, place, residual), colour in zip(maps, pairs, COLOURS, strict=False):
        if not len(place):
            ax.set_axis_off()
            continue
        ax.set(xlabel="column / pixel", ylabel="row / pixel")
        times, rms = draw_arrows(ax, place[:, ::-1], residual[:, ::-1], colour), float(np.sqrt(np.mean(residual**2)))
        ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
        ax.set_title(f"{name}, {times:g} times as long", fontsize="medium")
        style: dict[str, Any] = {"histtype": "step", "density": True, "color": colour}
        edges = np.linspace(-_REACH, _REACH, _BINS + 1)
        histogram.hist(residual.ravel() / (rms or 1.0), bins=edges, label=f"{name}, RMS {rms:.3f} pixel", **style)
    x = np.linspace(-_REACH, _REACH, 201)
    histogram.plot(x, np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi), color="0.5", linewidth=1.0, label="normal")
    histogram.set(xlabel="residual / RMS", ylabel="probability density", yscale="log", ylim=(1e-4, 9.0))
    histogram.legend(fontsize="small", frameon=False, loc="upper right")
    return figure


def plot_calibration(calibration: Calibration, *, figure: Figure | None = None) -> Figure:
    """Draw the errors of a calibration's parameters, their correlations, and the shape of the board.

    Parameters
    ----------
    calibration : Calibration
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        Left, the standard error of each fitted parameter as a dot and half the width of its 95 % interval as a bar, in
        the unit of the parameter. Middle, correlations: what is near 1 or -1 moves together. Right, if the board was
        fitted, the distances of its points from their plane.

    Examples
    --------
    See `Calibration`.
    """
    check_has(calibration, "calibration", "Calibration", "pl.calibrate(observations, start=...)", "board_error")
    has_board = bool(np.any(calibration.board_error))
    figure = figure_or_new(figure, (9.6 + 4.4 * has_board, 4.4))
    panels: NDArray[Any] = figure.subplots(1, 2 + has_board)
    _draw_errors(panels[0], calibration)
    _draw_correlations(panels[1], calibration)
    if has_board:
        _draw_board(panels[2], calibration)
    return figure


def _labels(calibration: Calibration) -> list[str]:
    return [p.name.lower().replace("_", " ") + (f" / {p.unit}" if p.unit else "") for p in calibration.fitted]


def _draw_errors(ax: Axes, calibration: Calibration) -> None:
    bars = [0.5 * float(np.diff(calibration.interval(p))[0]) for p in calibration.fitted]
    dots = [calibration.standard_error(p) for p in calibration.fitted]
    rows = np.arange(len(dots))
    low = 10.0 ** np.floor(np.log10(min(dots)))
    ax.barh(rows, np.array(bars) - low, left=low, color=COLOURS[5], label="half the 95 % interval")
    ax.plot(dots, rows, "o", color=COLOURS[0], label="standard error")
    ax.set(xscale="log", xlim=(low, None), yticks=rows, yticklabels=_labels(calibration))
    ax.invert_yaxis()
    ax.set(xlabel="error, in the unit of the parameter")
    cluster = calibration.error_cluster.name.lower().replace("_", " ")
    ax.set_title(f"errors clustered by {cluster}", fontsize="medium")
    ax.legend(fontsize="small", frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.06), ncols=2)


def _draw_correlations(ax: Axes, calibration: Calibration) -> None:
    covariance = calibration.covariance[np.ix_(calibration.fitted, calibration.fitted)]
    scale = np.sqrt(np.diag(covariance))
    names = [p.name.lower().replace("_", " ") for p in calibration.fitted]
    drawn = ax.imshow(covariance / np.outer(scale, scale), cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    ax.figure.colorbar(drawn, ax=ax, label="correlation", shrink=0.8)
    rows = np.arange(len(names))
    ax.set(xticks=rows, yticks=rows, xticklabels=names, yticklabels=names)
    ax.tick_params(axis="x", rotation=90)
    ax.set_title("correlations of the errors", fontsize="medium")


def _draw_board(ax: Axes, calibration: Calibration) -> None:
    height, error = _heights(calibration.board), float(np.median(calibration.board_error[:, 2]))
    limit = float(np.abs(height).max()) or 1.0
    x, y, _ = calibration.board.T
    drawn = ax.scatter(x, y, c=height, cmap="RdBu_r", vmin=-limit, vmax=limit, s=60, edgecolors="0.4", linewidths=0.5)
    ax.figure.colorbar(drawn, ax=ax, label="z / mm", shrink=0.8)
    ax.set(xlabel="x / mm", ylabel="y / mm", aspect="equal")
    ax.margins(0.1)
    ax.set_title(f"board from its plane, +- {error:.2g} mm", fontsize="medium")


def _heights(points: Floats) -> Floats:
    """Distances of points (n, 3) along z from the plane that fits them best."""
    table = np.column_stack([points[:, :2], np.ones(len(points))])
    return np.asarray(points[:, 2] - table @ np.linalg.lstsq(table, points[:, 2], rcond=None)[0])
