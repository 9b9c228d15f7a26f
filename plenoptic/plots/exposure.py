"""Image, standard error and depth of an exposure, side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.srgb import linear_to_srgb
from plenoptic.core.files.codes import white_point
from plenoptic.core.relative_error import lit_pixels
from plenoptic.core.values import check_has
from plenoptic.plots.canvas import figure_or_new, pixel_extent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.rendering.exposure import Exposure

_IRRADIANCE = "scene radiance x sr"

_NOT_RENDERED = (0.72, 0.80, 0.90)
"""Pale blue: neither black nor a grey of the image."""


def _panel(figure: Figure, ax: Axes, values: NDArray[Any], title: str, unit: str, **shown: Any) -> None:
    drawn = ax.imshow(values, interpolation="nearest", **shown)
    figure.colorbar(drawn, ax=ax, label=unit, extend="max" if "vmax" in shown else "neither", shrink=0.8)
    ax.set_title(title)


def _colour_picture(
    ax: Axes, image: NDArray[np.float32], unseen: NDArray[np.bool_], extent: tuple[float, float, float, float]
) -> None:
    white = white_point(image)
    encoded = linear_to_srgb(np.clip(np.nan_to_num(image / white), 0.0, 1.0))
    encoded[unseen] = _NOT_RENDERED
    ax.imshow(encoded, interpolation="nearest", extent=extent)
    ax.set_title(f"image (white: {white:.3g} {_IRRADIANCE})")


def plot_exposure(exposure: Exposure, *, figure: Figure | None = None) -> Figure:
    """Draw an exposure's image, standard error and depth side by side; what it lacks is left out.

    Parameters
    ----------
    exposure : Exposure
    figure : matplotlib.figure.Figure, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.figure.Figure
        One panel each, with rows and columns of the sensor as axes (pixel centres are whole numbers). A grey
        image is shown linearly from 0; a coloured one is encoded for the screen (sRGB). Scales end at the 99.8th
        percentile, that of the error over lit pixels (`lit_pixels`). The error of a coloured image is the root mean
        square over its channels. Depth is in mm and blank where nothing is met. Pixels that were not rendered are pale
        blue.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> shot = pl.Exposure(np.ones((4, 6, 1)), standard_error=np.full((4, 6, 1), 0.01))
    >>> figure = pl.plots.plot_exposure(shot)
    >>> [ax.get_title() for ax in figure.axes if ax.get_title()]
    ['image', 'standard error']
    """
    check_has(exposure, "exposure", "Exposure", "pl.Exposure(image)", "standard_error")
    rows, columns, channels = exposure.image.shape
    panels = 1 + (exposure.standard_error is not None) + (exposure.depth is not None)
    figure = figure_or_new(figure, (5.4 * panels, 4.6))
    axes = list(figure.subplots(1, panels, sharex=True, sharey=True, squeeze=False)[0])
    row, column = (exposure.region[0], exposure.region[2]) if exposure.region is not None else (0, 0)
    extent = pixel_extent(row, column, exposure.image.shape)
    for ax in axes:
        ax.set_xlabel("column / pixel")
    axes[0].set_ylabel("row / pixel")

    unseen = np.zeros((rows, columns), dtype=bool) if exposure.sample_counts is None else exposure.sample_counts == 0
    if unseen.any():
        for ax in axes:
            ax.set_facecolor(_NOT_RENDERED)
        axes[0].annotate("pale blue: not rendered", (0, 1), (2, 2), "axes fraction", "offset points", fontsize="small")
    ax = axes.pop(0)
    if channels == 1:
        top = white_point(exposure.image)
        grey = np.ma.array(exposure.image[:, :, 0], mask=unseen)
        _panel(figure, ax, grey, "image", _IRRADIANCE, extent=extent, cmap="gray", vmin=0.0, vmax=top)
    else:
        _colour_picture(ax, exposure.image, unseen, extent)
    if exposure.standard_error is not None:
        error = np.sqrt(np.mean(np.square(exposure.standard_error, dtype=np.float64), axis=2))
        lit = lit_pixels(np.nan_to_num(exposure.image, posinf=0.0, neginf=0.0))
        top = white_point(error[lit] if lit.any() else error)
        seen = np.ma.array(error, mask=unseen)
        _panel(
            figure, axes.pop(0), seen, "standard error", _IRRADIANCE, extent=extent, cmap="magma", vmin=0.0, vmax=top
        )
    if exposure.depth is not None:
        depth = np.ma.masked_invalid(exposure.depth)
        _panel(figure, axes.pop(0), depth, "depth", "mm", extent=extent, cmap="viridis")
    return figure
