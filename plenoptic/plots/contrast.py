"""Figures of point-spread functions and of contrast."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import check_has, wrong_kind
from plenoptic.plots.canvas import COLOURS, axes_or_new, draw_map
from plenoptic.plots.spots import LIMIT, MICROMETRES, field_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.lens.analysis.mtf import Mtf, PointSpread
    from plenoptic.optics.lens.waves.wave_mtf import WaveMtf
    from plenoptic.optics.lens.waves.wave_spread import WaveSpread


def plot_point_spread(spread: PointSpread | WaveSpread, ax: Axes | None = None) -> Axes:
    """Draw a point-spread function, the geometric one or the one with diffraction.

    Parameters
    ----------
    spread : PointSpread or WaveSpread
    ax : matplotlib.axes.Axes, default: those of a new figure

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
    norm = PowerNorm(0.5, vmin=0.0) if spread.image.any() else "linear"
    extent = (-half_x, half_x, -half_y, half_y)
    title = f"{field_label(spread.field, spread.z_object)}, z = {spread.z_image:.6g} mm"
    if hasattr(spread, "strehl"):
        title += f", Strehl {spread.strehl:.3g}"
    if spread.outside > 1e-9:
        title += f"\n{100 * spread.outside:.2g} % outside"
    draw_map(ax, spread.image / size**2, "share of the light per µm²", title, extent=extent, cmap="magma", norm=norm)
    ax.set(xlabel="x / µm", ylabel="y / µm")
    return ax


def plot_mtf(mtfs: Mtf | WaveMtf | Sequence[Mtf | WaveMtf], ax: Axes | None = None) -> Axes:
    """Draw modulation transfer functions, geometric ones, those with diffraction, or both, and the limit.

    Parameters
    ----------
    mtfs : Mtf, WaveMtf or a sequence of them
        For example one for each field. Those of one field have one colour.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        Tangential solid, sagittal dotted; geometric ones each with a band of one standard error, and pale where others
        are beside them; grey and dashed the limit by diffraction of the first geometric one, which these do not
        contain.

    Raises
    ------
    InvalidValueError
        If `mtfs` holds none.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> ax = pl.plots.plot_mtf([pl.aberrations.mtf(lens, np.linspace(0, 50, 11), field=(0, y)) for y in (0, 0.1)])
    >>> ax.get_ylabel()
    'modulation'
    """
    curves: list[Any] = [mtfs] if hasattr(mtfs, "sagittal") else list(mtfs) if isinstance(mtfs, Sequence) else []
    if not curves or not all(hasattr(curve, "sagittal") and hasattr(curve, "frequencies") for curve in curves):
        raise wrong_kind(mtfs, "mtfs", "Mtf or a sequence", "pl.aberrations.mtf(lens, [10, 20])")
    ax = axes_or_new(ax, (6.4, 4.2))
    geometric = [curve for curve in curves if hasattr(curve, "diffraction")]
    both = 0 < len(geometric) < len(curves)
    labels = [field_label(curve.field, curve.z_object) for curve in curves]
    # A colour for each field where two kinds stand beside each other, otherwise one for each curve.
    order = list(dict.fromkeys(labels))
    for i, (curve, label) in enumerate(zip(curves, labels, strict=True)):
        colour = COLOURS[(order.index(label) if both else i) % len(COLOURS)]
        rays = hasattr(curve, "diffraction")
        strength = 0.45 if both and rays else 1.0
        prefix = f"{label}, geometric" if both and rays else label
        for direction, line in (("tangential", "-"), ("sagittal", ":")):
            values = getattr(curve, direction)
            ax.plot(
                curve.frequencies, values, linestyle=line, color=colour, alpha=strength, label=f"{prefix}, {direction}"
            )
            if rays:
                error = getattr(curve, f"{direction}_error")
                low, high = values - error, values + error
                ax.fill_between(curve.frequencies, low, high, color=colour, alpha=0.2 * strength, linewidth=0)
    if geometric and np.isfinite(geometric[0].diffraction).all():
        first = geometric[0]
        ax.plot(first.frequencies, first.diffraction, linestyle="--", color=LIMIT, label="limit by diffraction")
    low, high = (limit(float(limit(curve.frequencies)) for curve in curves) for limit in (min, max))
    ax.set_ylim(0.0, 1.02)
    ax.set_xlim(low, max(high, 1e-9))
    title = "MTF with diffraction"
    if geometric:
        title = "MTF, geometric and with diffraction" if both else "Geometric MTF, without diffraction"
    ax.set(xlabel="spatial frequency / (cycles/mm)", ylabel="modulation", title=title)
    ax.legend(fontsize="small", frameon=False)
    return ax
