"""Figures of third-order aberrations and of colour."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from plenoptic.plots import _pyplot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.analysis.seidel import ChromaticShift, SeidelSums

_NAMES = ("spherical", "coma", "astigmatism", "Petzval", "distortion")
_COLOURS = ("#31566f", "#c8553d", "#5b8e7d", "#8f8f8f", "#d9a441")


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
        Elements by their index to the right, the sum last; sums in mm upwards.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ax = pl.plot_seidel(pl.aberrations.seidel_sums(pl.load_lens("double-gauss-100mm-f2"), field=0.17))
    >>> ax.get_ylabel()
    'Seidel sum / mm'
    """
    plt = _pyplot()
    if ax is None:
        _, ax = plt.subplots(figsize=(8.0, 4.0), layout="constrained")
    rows = [i for i, row in enumerate(sums.table) if row.any()]
    table = np.vstack([sums.table[rows], sums.total])
    place, width = np.arange(len(table)), 0.16
    for k, (name, colour) in enumerate(zip(_NAMES, _COLOURS, strict=True)):
        ax.bar(place + (k - 2) * width, table[:, k], width, color=colour, label=name)
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.axvline(len(rows) - 0.5, color="#888888", linewidth=0.8, linestyle="--")
    ax.set_xticks(place, [*map(str, rows), "sum"])
    ax.set_xlabel("element")
    ax.set_ylabel("Seidel sum / mm")
    ax.set_title(f"Third-order aberrations at {sums.wavelength:g} nm")
    ax.legend(frameon=False, fontsize="small", ncols=5, loc="upper center", bbox_to_anchor=(0.5, -0.14))
    return ax


def plot_chromatic_shift(shift: ChromaticShift, ax: Axes | None = None) -> Axes:
    """The paraxial focus against the wavelength.

    Parameters
    ----------
    shift : ChromaticShift
        From `aberrations.chromatic_shift`; a dozen wavelengths make a smooth curve.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.axes.Axes
        Shift of the focus against that of the reference wavelength in mm to the right, wavelength in nm upwards.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> lens = pl.load_lens("achromat-100mm-f4.4")
    >>> shift = pl.aberrations.chromatic_shift(lens, wavelengths=np.arange(420.0, 701.0, 20.0))
    >>> pl.plot_chromatic_shift(shift).get_ylabel()
    'wavelength / nm'
    """
    plt = _pyplot()
    if ax is None:
        _, ax = plt.subplots(figsize=(5.0, 4.0), layout="constrained")
    order = np.argsort(shift.wavelengths)
    at_reference = shift.focus[np.flatnonzero(shift.wavelengths == shift.reference)[0]]
    ax.plot(shift.focus[order] - at_reference, shift.wavelengths[order], color=_COLOURS[0], marker=".")
    ax.axvline(0.0, color="#888888", linewidth=0.8, linestyle="--")
    ax.set_xlabel("shift of the focus / mm")
    ax.set_ylabel("wavelength / nm")
    ax.set_title(f"Axial colour, against {shift.reference:g} nm")
    return ax
