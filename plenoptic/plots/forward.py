"""What the light of points leaves on the sensor of a camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import Floats, check_has
from plenoptic.plots.canvas import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.camera.psf.spread import CameraSpread

_MARGIN = 2
"""Dark pixels left around the light of a smaller point among several."""
_MARK = "#35c4ff"


def plot_camera_spread(spread: CameraSpread, ax: Axes | None = None) -> Axes:
    """Draw what the light of one point, or of several together, leaves on the sensor.

    Parameters
    ----------
    spread : CameraSpread
        From `point_spread`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.axes.Axes
        The part of the sensor that the light reaches, with rows and columns as axes (pixel centres are whole numbers,
        row 0 at the top, as in images). Brightness grows with the root of the value. Crosses are centroids.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01), stop_to_microlenses=133.0)
    >>> ax = pl.plots.plot_camera_spread(pl.point_spread(camera, (5.0, 0.0, -404.0)))
    >>> ax.get_xlabel()
    'column / pixel'
    """
    check_has(spread, "spread", "CameraSpread", "pl.point_spread(camera, point)", "regions", "centroid")
    ax = axes_or_new(ax, (6.2, 5.0))
    from matplotlib.colors import PowerNorm

    image, row, column = _together(spread)
    rows, columns = image.shape
    extent = (column - 0.5, column + columns - 0.5, row + rows - 0.5, row - 0.5)
    # Brightness by the root: the light of a point is a few bright pixels and a faint flare.
    scale = PowerNorm(0.5, vmin=0.0, vmax=float(image.max()) or 1.0)
    drawn = ax.imshow(image, interpolation="nearest", cmap="inferno", norm=scale, extent=extent)
    ax.figure.colorbar(drawn, ax=ax, label="sr/mm²", shrink=0.8)
    if not image.any():
        ax.text(0.5, 0.5, "no light", transform=ax.transAxes, ha="center", va="center", color="white")
    ax.locator_params(integer=True, min_n_ticks=1)
    places = _pixels(spread)
    ax.plot(places[:, 1], places[:, 0], linestyle="none", marker="+", color=_MARK, markersize=9)
    ax.set(xlabel="column / pixel", ylabel="row / pixel")
    ax.set_title(_title(spread), fontsize="medium")
    return ax


def _together(spread: CameraSpread) -> tuple[Floats, int, int]:
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


def _pixels(spread: CameraSpread) -> Floats:
    """Row and column (n, 2) of the centroids: the sensor is read out rotated by 180 degrees."""
    rows, columns = spread.sensor.shape
    x, y = np.atleast_2d(spread.centroid).T / spread.sensor.pixel_pitch
    return np.stack([y + rows / 2 - 0.5, columns / 2 - 0.5 - x], axis=1)


def _title(spread: CameraSpread) -> str:
    points, light = np.atleast_2d(spread.points), np.atleast_1d(spread.light)
    if len(points) > 1:
        return f"{len(points)} points, {_scaled(float(light.sum()))} in all"
    return f"point ({', '.join(f'{x:.4g}' for x in points[0])}) mm, {_scaled(float(light[0]))}"


def _scaled(light: Any) -> str:
    return f"{1e3 * light:.3g} msr"
