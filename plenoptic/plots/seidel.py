"""Figures of third-order aberrations and of colour."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import check_has
from plenoptic.plots.canvas import COLOURS, axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.lens.analysis.seidel import ChromaticShift, SeidelSums

_NAMES = ("spherical", "coma", "astigmatism", "Petzval", "distortion")
_RULE = "#888888"


def plot_seidel(sums: SeidelSums, ax: Axes | None = None) -> Axes:
    """Bars of Seidel's sums, a group for each surface and one for their total.

    Parameters
    ----------
    sums : SeidelSums
        From `aberrations.seidel_sums`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.axes.Axes
        Elements that have sums, by their index, to the right, the sum of all last; sums in mm upwards.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ax = pl.plots.plot_seidel(pl.aberrations.seidel_sums(pl.load_lens("double-gauss-100mm-f2"), field=0.17))
    >>> ax.get_ylabel()
    'Seidel sum / mm'
    """
    check_has(sums, "sums", "SeidelSums", "what pl.aberrations.seidel_sums(lens, field=0.2) returns", "petzval")
    ax = axes_or_new(ax, (8.0, 4.0))
    rows = [i for i, row in enumerate(sums.table) if row.any()]
    table = np.vstack([sums.table[rows], sums.total])
    place, width = np.arange(len(table)), 0.16
    for k, (name, colour) in enumerate(zip(_NAMES, COLOURS[: len(_NAMES)], strict=True)):
        ax.bar(place + (k - 2) * width, table[:, k], width, color=colour, label=name)
    for i in range(1, len(rows), 2):
        ax.axvspan(i - 0.5, i + 0.5, color="#f1f1f1", linewidth=0, zorder=0)
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.axvline(len(rows) - 0.5, color=_RULE, linewidth=0.8, linestyle="--")
    ax.set_xlim(-0.6, len(rows) + 0.6)
    ax.set_xticks(place, [*map(str, rows), "sum"])
    ax.set(xlabel="element", ylabel="Seidel sum / mm", title=f"Third-order aberrations at {sums.wavelength:g} nm")
    ax.legend(frameon=False, fontsize="small", ncols=5, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    return ax


def plot_chromatic_shift(shift: ChromaticShift, ax: Axes | None = None) -> Axes:
    """The paraxial focus against the wavelength, and the height of the image where it was asked for.

    Parameters
    ----------
    shift : ChromaticShift
        From `aberrations.chromatic_shift`; a dozen wavelengths make a smooth curve.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.axes.Axes
        Shifts against the reference wavelength in mm to the right, wavelength in nm upwards. The height is drawn if
        `shift` was made with a field, dashed and with an axis of its own above.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> lens = pl.load_lens("achromat-100mm-f4.4")
    >>> shift = pl.aberrations.chromatic_shift(lens, wavelengths=np.arange(420.0, 701.0, 20.0))
    >>> pl.plots.plot_chromatic_shift(shift).get_ylabel()
    'wavelength / nm'
    """
    check_has(shift, "shift", "ChromaticShift", "what pl.aberrations.chromatic_shift(lens) returns", "focus")
    ax = axes_or_new(ax, (5.0, 4.0))
    order = np.argsort(shift.wavelengths)
    middle = int(np.flatnonzero(shift.wavelengths == shift.reference)[0])
    places = [(ax, shift.focus, "shift of the focus / mm", "-")]
    if shift.height.any():
        places.append((ax.twiny(), shift.height, "shift of the height of the image / mm", "--"))
    for (part, values, label, style), colour in zip(places, COLOURS, strict=False):
        moved = (values - values[middle])[order]
        part.plot(moved, shift.wavelengths[order], style, color=colour, marker=".")
        part.set_xlabel(label, color="black" if len(places) == 1 else colour)
        if len(places) > 1:  # two scales have one zero
            reach = 1.1 * float(np.nanmax(np.abs(moved))) or 1.0
            part.set_xlim(-reach, reach)
            part.locator_params(axis="x", nbins=5)
    ax.axvline(0.0, color=_RULE, linewidth=0.8, linestyle="--", zorder=0)
    title = f"{'Axial colour' if len(places) == 1 else 'Colour'}, against {shift.reference:.5g} nm"
    ax.set(ylabel="wavelength / nm", title=title)
    return ax
