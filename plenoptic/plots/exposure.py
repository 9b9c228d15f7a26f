"""Image, standard error and truth of an exposure, and raw images, side by side with a detail."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.codes import block_means, white_point
from plenoptic.core.relative_error import lit_pixels, mean_square
from plenoptic.core.values import check_has
from plenoptic.plots.canvas import NOTHING, draw_map, encode, figure_or_new, frame_axes, pixel_extent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    from plenoptic.readout.raw import RawImage
    from plenoptic.rendering.exposure import Exposure

_IRRADIANCE = "scene radiance x sr"

_MOST = 2048
"""Pixels along a side that are drawn; of larger images, means over blocks."""
_DETAIL, _TIMES, _TRIED = 48, 3, 20
"""Pixels along a side of the detail, how many times as large an image must be for one, and places along a side."""
_STRIP = 16
"""Rows that are drawn, of errors that are found at a time."""
_ENOUGH = 0.7
"""Part of the greatest contrast that the detail has at least."""
_FRAME = "#ff6b00"
_BRIGHTENED = 1 / 2.2
"""Power with which raw images are shown, as photographs are."""
_PANEL, RAW_SIZE = (3.2, 3.3), (2.2 * 3.2, 3.3)
"""Inches, in notebooks: of a panel of an exposure, and of a raw image."""


class _Frame(NamedTuple):
    """Displayed part of the sensor."""

    row: int
    column: int
    block: int

    @classmethod
    def of(cls, image: NDArray[Any], region: tuple[int, ...] | None) -> _Frame:
        """Frame of an image of a region of the sensor; None: of all of it."""
        row, column = (0, 0) if region is None else (region[0], region[2])
        return cls(row, column, min(-(-max(image.shape[:2]) // _MOST), *image.shape[:2]))

    def reduced(self, values: NDArray[Any]) -> NDArray[Any]:
        """Means over blocks, where an image is large."""
        return block_means(values, self.block)

    def extent(self, shape: tuple[int, ...]) -> tuple[float, float, float, float]:
        """Extent of reduced values."""
        return pixel_extent(self.row, self.column, (shape[0] * self.block, shape[1] * self.block))


def _draw_pixels(
    ax: Axes, image: NDArray[Any], missing: NDArray[np.bool_], extent: tuple[float, float, float, float], norm: Any
) -> Any:
    """Draw an image up to `norm.vmax`; the scale of its greys, None of colours, which are encoded for the screen."""
    if image.shape[2] == 3:
        ax.imshow(encode(image, norm.vmax, missing), interpolation="antialiased", extent=extent)
        return None
    ax.set_facecolor(NOTHING)
    grey = np.ma.array(image[:, :, 0], mask=missing)
    return ax.imshow(grey, interpolation="antialiased", extent=extent, cmap="gray", norm=norm)


def _draw_image(
    ax: Axes, image: NDArray[Any], missing: NDArray[np.bool_], frame: _Frame, norm: Normalize, labels: tuple[str, str]
) -> None:
    """Draw an image with its scale, or the value that is white; labels are its name and its unit."""
    small, (title, unit) = frame.reduced(image), labels
    scale = _draw_pixels(ax, small, frame.reduced(missing) == 1, frame.extent(small.shape), norm)
    if scale is None:
        ax.set_title(f"{title} (white: {norm.vmax:.3g} {unit})", fontsize="small")
    else:
        ax.figure.colorbar(scale, ax=ax, label=unit, extend="max", shrink=0.8)
        ax.set_title(title, fontsize="medium")


def _detail_of(image: NDArray[Any]) -> tuple[slice, slice] | None:
    """Detail of an image with much contrast, near its middle; None for a small one, which is seen as it is."""
    if min(image.shape[:2]) < _TIMES * _DETAIL:
        return None
    starts = [
        np.linspace(0, length - _DETAIL, min(length // _DETAIL, _TRIED)).astype(int) for length in image.shape[:2]
    ]
    windows = [(slice(r, r + _DETAIL), slice(c, c + _DETAIL)) for r in starts[0] for c in starts[1]]
    middle = np.array(image.shape[:2]) / 2
    windows.sort(key=lambda window: np.hypot(*(middle - [part.start + _DETAIL / 2 for part in window])))
    contrast = [float(np.nan_to_num(image[w], posinf=0.0, neginf=0.0).std(dtype=np.float64)) for w in windows]
    return windows[int(np.argmax(np.array(contrast) >= _ENOUGH * max(contrast)))]


def _draw_detail(
    ax: Axes,
    whole: Axes,
    image: NDArray[Any],
    missing: NDArray[np.bool_],
    window: tuple[slice, slice],
    frame: _Frame,
    norm: Normalize,
) -> None:
    """Draw a part of an image as bright as in the whole, and frame it in both panels."""
    from matplotlib.patches import Rectangle

    rows, columns = window
    extent = pixel_extent(frame.row + rows.start, frame.column + columns.start, (_DETAIL, _DETAIL))
    _draw_pixels(ax, image[window], missing[window], extent, norm)
    whole.add_patch(Rectangle((extent[0], extent[3]), _DETAIL, _DETAIL, fill=False, edgecolor=_FRAME, linewidth=1.5))
    frame_axes(ax, _FRAME, "detail")
    ax.set_xlabel("column / pixel")


def _truth(exposure: Exposure) -> tuple[str, NDArray[Any], str] | None:
    """Depth, or else the first truth that is one number a pixel: its name, its values and their unit."""
    if exposure.truth is None:
        return None
    units = {field.name: field.metadata["channel"].unit for field in dataclasses.fields(exposure.truth)}
    plain = {name: array for name, array in exposure.truth.arrays().items() if array.ndim == 2}
    name = "depth" if "depth" in plain else next(iter(plain), None)
    return None if name is None else (name.replace("_", " "), plain[name], units[name])


def notebook_size(exposure: Exposure) -> tuple[float, float]:
    """Inches of an exposure's figure in notebooks."""
    return _PANEL[0] * _panels_of(exposure), _PANEL[1]


def _panels_of(exposure: Exposure) -> int:
    """Number of panels that `plot_exposure` draws."""
    return 1 + sum(part is not None for part in (_detail_of(exposure.image), exposure.standard_error, _truth(exposure)))


def plot_exposure(exposure: Exposure, *, figure: Figure | None = None) -> Figure:
    """Draw an exposure's image, a detail, its standard error and depth side by side, as far as it has them.

    Parameters
    ----------
    exposure : Exposure
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        One panel each, with rows and columns of the sensor as axes (pixel centres are whole numbers). A grey
        image is shown linearly from 0; a coloured one is encoded for the screen (sRGB). Scales end at the 99.9th
        percentile, that of the error over the lit pixels of the drawn image (`lit_pixels`). The error of a coloured
        image is the root mean square over its channels. Depth is in mm and blank where nothing is met; without depth,
        the first truth of one number a pixel stands there. The detail has 48 x 48 pixels where there is much contrast,
        of images three times as large. Pixels that were not rendered are pale blue. Beyond 2048 pixels along a side,
        means over blocks are drawn.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> shot = pl.Exposure(np.ones((4, 6, 1)), standard_error=np.full((4, 6, 1), 0.01))
    >>> figure = pl.plots.plot_exposure(shot)
    >>> [ax.get_title() for ax in figure.axes if ax.get_title()]
    ['image', 'standard error']
    """
    check_has(exposure, "exposure", "Exposure", "pl.Exposure(image)", "standard_error")
    image, counts = exposure.image, exposure.sample_counts
    window, truth, panels = _detail_of(image), _truth(exposure), _panels_of(exposure)
    figure = figure_or_new(figure, (4.6 * panels, 4.2))
    from matplotlib.colors import Normalize

    frame = _Frame.of(image, exposure.region)
    full = figure.add_subplot(1, panels, 1, xlabel="column / pixel", ylabel="row / pixel")
    axes = [figure.add_subplot(1, panels, k + 2) for k in range(panels - 1)]

    missing = np.zeros(image.shape[:2], dtype=bool) if counts is None else counts == 0
    if missing.any():
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
        text = "pale blue: not rendered"
        full.annotate(text, (0, 0), (4, 4), "axes fraction", "offset points", fontsize="small", bbox=box)
    norm = Normalize(0.0, white_point(image))
    _draw_image(full, image, missing, frame, norm, ("image", _IRRADIANCE))
    if window is not None:
        _draw_detail(axes.pop(0), full, image, missing, window, frame, norm)
    for ax in axes:
        ax.sharex(full)
        ax.sharey(full)
        ax.set_xlabel("column / pixel")
        ax.tick_params(labelleft=False)
    if missing.any():
        for ax in (full, *axes):
            ax.set_facecolor(NOTHING)
    if exposure.standard_error is not None:
        _draw_error(axes.pop(0), exposure, missing, frame)
    if truth is not None:
        name, values, unit = truth
        drawn = np.ma.masked_invalid(values[:: frame.block, :: frame.block])
        draw_map(axes.pop(0), drawn, unit, name, extent=frame.extent(drawn.shape), cmap="viridis")
    return figure


def _draw_error(ax: Axes, exposure: Exposure, missing: NDArray[np.bool_], frame: _Frame) -> None:
    assert exposure.standard_error is not None
    # Some rows of blocks at a time: the errors of all pixels together are larger than the image.
    whole = exposure.standard_error.shape[0] // frame.block * frame.block
    steps = range(0, whole, _STRIP * frame.block)
    strips = (exposure.standard_error[top : min(top + _STRIP * frame.block, whole)] for top in steps)
    error = np.concatenate([frame.reduced(np.sqrt(mean_square(strip))) for strip in strips])
    lit = lit_pixels(np.nan_to_num(frame.reduced(exposure.image), posinf=0.0, neginf=0.0))
    vmax = white_point(error[lit] if lit.any() else error)
    small = np.ma.array(error, mask=frame.reduced(missing) == 1)
    shown = {"extent": frame.extent(small.shape), "cmap": "magma", "vmin": 0.0, "vmax": vmax}
    draw_map(ax, small, _IRRADIANCE, "standard error", interpolation="antialiased", **shown)


def plot_raw(raw: RawImage, *, figure: Figure | None = None) -> Figure:
    """Draw the numbers of a raw image and a detail of them.

    Parameters
    ----------
    raw : RawImage
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        Electrons above the black level, from 0 to the 99.9th percentile and brightened as photographs are, with rows
        and columns of the sensor as axes; behind colour filters the mosaic itself. For the detail see `plot_exposure`.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> raw = pl.Exposure(np.ones((4, 6, 1))).develop(pl.SensorModel(photon_rate=100.0))
    >>> pl.plots.plot_raw(raw).axes[0].get_title()
    'raw image'
    """
    check_has(raw, "raw", "RawImage", "shot.develop(model)", "electrons")
    light = np.maximum(raw.electrons(), 0.0)
    image = light.reshape(*light.shape[:2], -1)
    window, missing = _detail_of(image), np.zeros(image.shape[:2], dtype=bool)
    panels = 1 if window is None else 2
    figure = figure_or_new(figure, (5.4 * panels, 4.6))
    from matplotlib.colors import PowerNorm

    frame, norm = _Frame.of(image, raw.region), PowerNorm(_BRIGHTENED, 0.0, white_point(image))
    ax = figure.add_subplot(1, panels, 1, xlabel="column / pixel", ylabel="row / pixel")
    _draw_image(ax, image, missing, frame, norm, ("raw image", "electrons"))
    if window is not None:
        _draw_detail(figure.add_subplot(1, 2, 2), ax, image, missing, window, frame, norm)
    return figure
