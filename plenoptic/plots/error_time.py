"""Error against time: slopes, bias floors and the Pareto front of an error study."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import check_has, wrong_kind
from plenoptic.plots.canvas import axes_or_new, figure_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.study.error_time.error_table import ErrorTable

_FRONT = "0.35"
"""Grey of the Pareto front."""

_MARKERS = "osD^vP*X<>"


def plot_error_against_time(table: ErrorTable, ax: Axes | None = None) -> Axes:
    """Draw the error of each variant against its CPU time, both logarithmic.

    Parameters
    ----------
    table : ErrorTable
        Table of `pl.study.error_against_time`.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        One line a variant, with the slope of its noise in the legend; dashed the bias floors that were found; dots and
        a grey line mark the Pareto front: settings that no other beats in time and error, and their numbers of
        samples.

    Examples
    --------
    >>> import plenoptic as pl
    >>> rows = [pl.study.ErrorRow("THIN lens", n, cpu_seconds=0.001 * n, wall_seconds=0.001 * n, setup_cpu_seconds=0.0,
    ...     setup_wall_seconds=0.0, variance=0.01 / n, variance_error=1e-3 / n, bias_squared=1e-4,
    ...     bias_squared_error=1e-6) for n in (16, 64)]
    >>> table = pl.study.ErrorTable("an example", rows, pixels=4096, lit_pixels=4000, seeds=8, threads=1,
    ...     reference_samples=4096, reference_error=0.001)
    >>> pl.plots.plot_error_against_time(table).get_ylabel()
    'relative RMS error / %'
    """
    check_has(table, "table", "ErrorTable", "pl.study.error_against_time(scene, camera)", "pareto")
    ax = axes_or_new(ax, (7.2, 6.0))
    for i, name in enumerate(table.variants):
        _draw_variant(ax, table, name, f"C{i % 10}", _MARKERS[i % len(_MARKERS)])
    front = table.pareto()
    seconds, errors = [row.cpu_seconds for row in front], [100 * row.error for row in front]
    style: dict[str, Any] = {"color": _FRONT, "linewidth": 4.0, "alpha": 0.35, "zorder": 1}
    ax.plot(seconds, errors, "o-", drawstyle="steps-post", label="Pareto front, with n", **style)
    for row, place in zip(front, zip(seconds, errors, strict=True), strict=True):
        text: dict[str, Any] = {
            "textcoords": "offset points",
            "ha": "right",
            "va": "top",
            "fontsize": "x-small",
            "color": _FRONT,
        }
        ax.annotate(str(row.samples), place, xytext=(-6, -6), **text)
    ax.set(xscale="log", yscale="log", xlabel=f"CPU time of {table.pixels} pixels / s", ylabel="relative RMS error / %")
    _plain_ticks(ax)
    ax.set_title(f"Error against time: {table.title}", fontsize="medium")
    ax.grid(which="both", linewidth=0.4, alpha=0.4)
    ax.legend(fontsize="small", frameon=False, title="noise falls as a power of n, the samples per pixel")
    return ax


def plot_error_studies(tables: Sequence[ErrorTable], figure: Figure | None = None) -> Figure:
    """Draw several error studies, two in a row.

    Parameters
    ----------
    tables : sequence of ErrorTable
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        One panel a table, see `plot_error_against_time`.

    Raises
    ------
    InvalidValueError
        If there is no table.

    Examples
    --------
    See `plot_error_against_time`.
    """
    if not isinstance(tables, Sequence) or not tables:
        raise wrong_kind(tables, "tables", "sequence of ErrorTable", "[pl.study.error_against_time(scene, camera)]")
    columns = min(len(tables), 2)
    rows = -(-len(tables) // columns)
    figure = figure_or_new(figure, (6.4 * columns, 6.0 * rows))
    for k, table in enumerate(tables):
        plot_error_against_time(table, figure.add_subplot(rows, columns, k + 1))
    return figure


def _draw_variant(ax: Axes, table: ErrorTable, name: str, colour: str, marker: str) -> None:
    rows = table.of(name)
    slope = table.slope(name)
    label = name if np.isnan(slope) else f"{name}: $n^{{{slope:.2f}}}$"
    seconds, errors = [row.cpu_seconds for row in rows], [100 * row.error for row in rows]
    ax.plot(seconds, errors, color=colour, marker=marker, markersize=5, linewidth=1.3, label=label)
    floor = table.bias_floor(name)
    if floor > 0:
        ax.axhline(100 * floor, color=colour, linestyle="--", label=f"bias of {name}, {100 * floor:.2g} %")


def _plain_ticks(ax: Any) -> None:
    """Per cent and seconds in full, 0.5 and not 5 x 10^-1, at 1, 2 and 5 of each decade."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda number, _: f"{number:g}"))
        axis.set_minor_formatter(NullFormatter())
