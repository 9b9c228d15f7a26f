"""Common parts of figures: axes, and the display of brightness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.errors import PlenopticError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOTHING = (0.72, 0.80, 0.90)
"""Pale blue, where pictures hold nothing: neither black nor a grey of an image."""

COLOURS = ("#1f5fbf", "#d55e00", "#009e73", "#cc79a7", "#444444", "#56b4e9", "#d9b500")
"""Of curves, in this order, told apart by the colour-blind (M. Okabe and K. Ito 2008, some of them darker)."""
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


class _MissingMatplotlibError(PlenopticError, ImportError):
    pass


def pyplot() -> Any:
    """`matplotlib.pyplot`, or an error that says how to get it."""
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise _MissingMatplotlibError(
            f"figures need matplotlib, which cannot be imported ({error}); pip install matplotlib"
        ) from error
    return plt


def axes_or_new(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """The axes given, or those of a new figure of a width and height in inches."""
    if ax is not None:
        return ax
    axes: Axes = figure_or_new(None, size).subplots()
    return axes


def figure_or_new(figure: Figure | None, size: tuple[float, float]) -> Figure:
    """The figure given, or a new one of a width and height in inches."""
    if figure is not None:
        return figure
    plt = pyplot()
    from plenoptic.plots.notebook.shown_once import ShownOnce

    figure_of_pyplot: Figure = plt.figure(figsize=size, layout="constrained", FigureClass=ShownOnce)
    return figure_of_pyplot


def pixel_extent(row: int, column: int, shape: tuple[int, ...]) -> tuple[float, float, float, float]:
    """Extent for `imshow` of pixels from a first row and column on, with whole numbers at their centres."""
    return column - 0.5, column + shape[1] - 0.5, row + shape[0] - 0.5, row - 0.5
