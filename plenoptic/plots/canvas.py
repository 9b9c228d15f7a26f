"""What figures share: where they are drawn, and how brightness is shown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from plenoptic.errors import PlenopticError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class _MissingMatplotlibError(PlenopticError, ImportError):
    pass


def pyplot() -> Any:
    """`matplotlib.pyplot`, or an error that says how to get it."""
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise _MissingMatplotlibError(
            f'figures need matplotlib, which cannot be imported ({error}); pip install "plenoptic[plot]"'
        ) from error
    return plt


def axes_or_new(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """The axes given, or those of a new figure of a width and height in inches."""
    if ax is not None:
        return ax
    made: Axes = pyplot().subplots(figsize=size, layout="constrained")[1]
    return made


def figure_or_new(figure: Figure | None, size: tuple[float, float]) -> Figure:
    """The figure given, or a new one of a width and height in inches."""
    if figure is not None:
        return figure
    made: Figure = pyplot().figure(figsize=size, layout="constrained")
    return made


def pixel_extent(row: int, column: int, shape: tuple[int, ...]) -> tuple[float, float, float, float]:
    """Where `imshow` puts pixels from a first row and column on, so that their centres are whole numbers."""
    return column - 0.5, column + shape[1] - 0.5, row + shape[0] - 0.5, row - 0.5
