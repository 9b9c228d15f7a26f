"""Figures of point-spread functions and of contrast."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import check_has, wrong_kind
from plenoptic.plots.canvas import COLOURS, axes_or_new
from plenoptic.plots.spots import LIMIT, MICROMETRES, field_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.lens.analysis.mtf import Mtf, PointSpread


def plot_point_spread(spread: PointSpread, ax: Axes | None = None) -> Axes:
    """Draw a geometric point-spread function.

    Parameters
    ----------
    spread : PointSpread
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.axes.Axes
        Share of the light per square micrometre, x and y in micrometres from the middle of the picture.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ax = pl.plots.plot_point_spread(pl.aberrations.point_spread(pl.load_lens("double-gauss-100mm-f2")))
    >>> ax.get_xlabel()
    'x / µm'
    """
    check_has(spread, "spread", "PointSpread", "pl.aberrations.point_spread(lens)", "pixel_size", "outside")
    ax = axes_or_new(ax, (5.6, 4.6))
    from matplotlib.colors import PowerNorm

    size = MICROMETRES * spread.pixel_size
    rows, columns = spread.image.shape
    half_x, half_y = 0.5 * columns * size, 0.5 * rows * size
    drawn = ax.imshow(
        spread.image / size**2,
        extent=(-half_x, half_x, -half_y, half_y),
        interpolation="nearest",
        cmap="magma",
        norm="linear" if not spread.image.any() else PowerNorm(0.5, vmin=0.0),
    )
    ax.figure.colorbar(drawn, ax=ax, label="share of the light per µm²")
    ax.set(xlabel="x / µm", ylabel="y / µm")
    title = f"{field_label(spread.field, spread.z_object)}, z = {spread.z_image:.6g} mm"
    if spread.outside > 1e-9:
        title += f"\n{100 * spread.outside:.2g} % outside"
    ax.set_title(title, fontsize="medium")
    return ax


def plot_mtf(mtfs: Mtf | Sequence[Mtf], ax: Axes | None = None) -> Axes:
    """Draw geometric modulation transfer functions, and the limit by diffraction.

    Parameters
    ----------
    mtfs : Mtf or a sequence of them
        For example one for each field.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.axes.Axes
        Tangential solid, sagittal dotted, each with a band of one standard error; grey and dashed the limit by
        diffraction of the first, which the other curves do not contain.

    Raises
    ------
    InvalidValueError
        If `mtfs` holds no Mtf.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> ax = pl.plots.plot_mtf([pl.aberrations.mtf(lens, np.linspace(0, 50, 11), field=(0, y)) for y in (0, 0.1)])
    >>> ax.get_ylabel()
    'modulation'
    """
    curves: list[Any] = [mtfs] if hasattr(mtfs, "diffraction") else list(mtfs) if isinstance(mtfs, Sequence) else []
    if not curves or not all(hasattr(curve, "diffraction") for curve in curves):
        raise wrong_kind(mtfs, "mtfs", "Mtf or a sequence", "pl.aberrations.mtf(lens, [10, 20])")
    ax = axes_or_new(ax, (6.4, 4.2))
    for i, curve in enumerate(curves):
        colour = COLOURS[i % len(COLOURS)]
        label = field_label(curve.field, curve.z_object)
        for values, error, line, name in (
            (curve.tangential, curve.tangential_error, "-", f"{label}, tangential"),
            (curve.sagittal, curve.sagittal_error, ":", f"{label}, sagittal"),
        ):
            ax.plot(curve.frequencies, values, linestyle=line, color=colour, label=name)
            ax.fill_between(curve.frequencies, values - error, values + error, color=colour, alpha=0.2, linewidth=0)
    first = curves[0]
    if np.isfinite(first.diffraction).all():
        ax.plot(first.frequencies, first.diffraction, linestyle="--", color=LIMIT, label="limit by diffraction")
    ax.set_ylim(0.0, 1.02)
    ax.set_xlim(float(first.frequencies.min()), float(max(first.frequencies.max(), 1e-9)))
    ax.set(xlabel="spatial frequency / (cycles/mm)", ylabel="modulation", title="Geometric MTF, without diffraction")
    ax.legend(fontsize="small", frameon=False)
    return ax
