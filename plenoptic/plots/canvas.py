"""Common parts of figures: axes, and the display of brightness."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.srgb import linear_to_srgb
from plenoptic.core.files.extras import MissingPackageError
from plenoptic.core.values import check_has

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOTHING = (0.72, 0.80, 0.90)
"""Pale blue, where pictures hold nothing: neither black nor a grey of an image."""

COLOURS = ("#1f5fbf", "#d55e00", "#009e73", "#cc79a7", "#444444", "#56b4e9", "#d9b500")
"""Of curves, in this order, told apart by the colour-blind (M. Okabe and K. Ito 2008, some of them darker)."""
PANEL_GAP = 0.06
"""Space between panels over their width, so that the label of a scale stands clear of the next panel's ticks."""
_WARMEST = 0.78
"""Part of the colour map `plasma` that stands out against white: from blue over purple to orange."""


def wavelength_colours(wavelengths: Sequence[float]) -> list[Any]:
    """One colour a wavelength, evenly from blue for the shortest to orange for the longest, the lighter the longer.

    Not the hues of the spectrum, whose red and green are one to many.
    """
    if len(wavelengths) == 1:
        return ["#1f4e79"]
    from matplotlib import colormaps

    places = np.argsort(np.argsort(wavelengths)) / (len(wavelengths) - 1)
    return [tuple(colour) for colour in colormaps["plasma"](_WARMEST * places)[:, :3].tolist()]


def pyplot() -> Any:
    """`matplotlib.pyplot`, or an error that says how to get it."""
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise MissingPackageError(
            f"figures need matplotlib, which cannot be imported ({error}); pip install matplotlib"
        ) from error
    return plt


def literal(text: str) -> str:
    """A name as matplotlib shows it letter by letter: between dollars it would read mathematics."""
    return text.replace("$", r"\$")


def axes_or_new(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """The axes given, or those of a new figure of a width and height in inches."""
    if ax is not None:
        check_has(ax, "ax", "matplotlib Axes", "plt.gca()", "plot")
        return ax
    axes: Axes = figure_or_new(None, size).subplots()
    return axes


def figure_or_new(figure: Figure | None, size: tuple[float, float]) -> Figure:
    """The figure given, or a new one of a width and height in inches."""
    if figure is not None:
        check_has(figure, "figure", "matplotlib Figure", "plt.figure()", "subplots")
        return figure
    plt = pyplot()
    new: Figure = plt.figure(figsize=size)
    new.set_layout_engine("constrained", wspace=PANEL_GAP)
    new._repr_mimebundle_ = partial(_leave_pyplot, new)  # type: ignore[attr-defined]
    return new


def _leave_pyplot(figure: Figure, **_: Any) -> dict[str, Any]:
    """Close a figure that a notebook shows as a cell's result; IPython's own display of it stays as it is.

    The inline backend shows all of pyplot's figures at the end of a cell, one that was just shown as its result too.
    """
    import matplotlib as mpl

    if "inline" in mpl.get_backend():
        pyplot().close(figure)
    return {}


def draw_map(ax: Axes, values: NDArray[Any], unit: str, title: str = "", **shown: Any) -> None:
    """Draw numbers as colours, with their scale; `shown` are options of `imshow`."""
    drawn = ax.imshow(values, **({"interpolation": "nearest"} | shown))
    ax.figure.colorbar(drawn, ax=ax, label=unit, extend="max" if shown.get("vmin") == 0.0 else "neither", shrink=0.8)
    ax.set_title(title, fontsize="medium")


def encode(image: NDArray[Any], white: float, missing: NDArray[np.bool_] | None = None) -> NDArray[Any]:
    """(rows, columns, 3) for the screen, sRGB: pale blue where pixels are missing; None: where a channel is nan.

    Channels other than three are shown as their mean, linearly.
    """
    colours = image.shape[2] == 3
    image = image if colours else np.mean(image, axis=2, keepdims=True)
    scaled = np.clip(np.asarray(image, dtype=np.float64) / white, 0.0, 1.0)
    unknown = np.asarray(~np.isfinite(scaled).all(axis=2) if missing is None else missing)
    encoded = linear_to_srgb(np.nan_to_num(scaled)) if colours else scaled
    return np.where(unknown[:, :, None], NOTHING, encoded)


def frame_axes(ax: Axes, colour: str, title: str) -> None:
    """Title and frame of a panel that shows a part of another one, in the colour that marks it there."""
    for spine in ax.spines.values():
        spine.set(edgecolor=colour, linewidth=1.5)
    ax.set_title(title, fontsize="medium")


def pixel_extent(row: int, column: int, shape: tuple[int, ...]) -> tuple[float, float, float, float]:
    """Extent for `imshow` of pixels from a first row and column on, with whole numbers at their centres."""
    return column - 0.5, column + shape[1] - 0.5, row + shape[0] - 0.5, row - 0.5
