"""Figures of aberrations: third-order sums, colour, wavefronts and the Zernike polynomials in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import Floats, check_has
from plenoptic.plots.canvas import COLOURS, axes_or_new
from plenoptic.plots.spots import field_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.lens.analysis.seidel import ChromaticShift, SeidelSums
    from plenoptic.optics.lens.waves.wavefront import Wavefront
    from plenoptic.optics.lens.waves.zernike_fit import ZernikeFit

_NAMES = ("spherical", "coma", "astigmatism", "Petzval", "distortion")
_RULE = "#888888"
MAP_SIZE, BARS_SIZE = (5.6, 4.6), (8.0, 4.0)
"""Inches, of a wavefront and of bars of polynomials."""
_MOST_NAMES = 22
"""Terms whose names find room below their bars."""


def plot_seidel(sums: SeidelSums, ax: Axes | None = None) -> Axes:
    """Bars of Seidel's sums, a group for each surface and one for their total.

    Parameters
    ----------
    sums : SeidelSums
        From `aberrations.seidel_sums`.
    ax : matplotlib.axes.Axes, default: those of a new figure

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
    ax : matplotlib.axes.Axes, default: those of a new figure

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


def plot_wavefront(wavefront: Wavefront, ax: Axes | None = None) -> Axes:
    """Draw the optical path differences over the iris.

    Parameters
    ----------
    wavefront : Wavefront
        From `aberrations.wavefront`.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        Waves, red where light is ahead of the reference sphere; x and y of the iris over its semi-diameter. Points of a
        square grid are its squares, others dots.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> pl.plots.plot_wavefront(pl.aberrations.wavefront(lens)).get_xlabel()
    'x of the iris'
    """
    check_has(wavefront, "wavefront", "Wavefront", "pl.aberrations.wavefront(lens)", "opd", "pupil")
    ax = axes_or_new(ax, MAP_SIZE)
    largest = max(float(np.abs(wavefront.opd).max()), 1e-9)
    colours: dict[str, Any] = {"cmap": "RdBu_r", "vmin": -largest, "vmax": largest}
    grid = _squares(wavefront.pupil, wavefront.opd)
    drawn: Any
    if grid is None:
        x, y = wavefront.pupil.T
        drawn = ax.scatter(x, y, c=wavefront.opd, s=max(2.0, 9000.0 / len(wavefront.opd)), **colours)
    else:
        drawn = ax.imshow(grid, extent=(-1.0, 1.0, -1.0, 1.0), origin="lower", interpolation="nearest", **colours)
    ax.figure.colorbar(drawn, ax=ax, label="optical path difference / waves")
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    ax.plot(np.cos(angle), np.sin(angle), color=_RULE, linewidth=0.8)
    ax.set_aspect("equal")
    ax.set(xlabel="x of the iris", ylabel="y of the iris", xlim=(-1.05, 1.05), ylim=(-1.05, 1.05))
    ax.set_title(
        f"{field_label(wavefront.field, wavefront.z_object)}, {wavefront.wavelength:.5g} nm\n"
        f"RMS {wavefront.rms:.3g}, peak to valley {wavefront.peak_to_valley:.3g} waves",
        fontsize="medium",
    )
    return ax


def _squares(pupil: Floats, opd: Floats) -> Floats | None:
    """(n, n) of differences, nan where there is none, if points are the middles of n x n equal squares; or None."""
    gaps = np.diff(np.unique(np.round(pupil[:, 0], 9)))
    if not len(gaps):
        return None
    n = round(2.0 / float(gaps.min()))
    places = (0.5 * n * (pupil + 1.0)) - 0.5
    cells = np.rint(places).astype(int)
    if n > len(pupil) or np.abs(places - cells).max() > 1e-6 or cells.min() < 0 or cells.max() >= n:
        return None
    grid = np.full((n, n), np.nan)
    grid[cells[:, 1], cells[:, 0]] = opd
    return grid


def plot_zernike(fit: ZernikeFit, ax: Axes | None = None) -> Axes:
    """Bars of the coefficients of Zernike polynomials.

    Parameters
    ----------
    fit : ZernikeFit
        From `Wavefront.zernike`.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        Terms to the right, with their names as long as there is room, waves upwards. Piston, which no picture sees, is
        left out.

    Examples
    --------
    >>> import plenoptic as pl
    >>> found = pl.aberrations.wavefront(pl.load_lens("double-gauss-100mm-f2"))
    >>> pl.plots.plot_zernike(found.zernike(15)).get_ylabel()
    'coefficient / waves'
    """
    check_has(fit, "fit", "ZernikeFit", "pl.aberrations.wavefront(lens).zernike()", "coefficients", "residual")
    ax = axes_or_new(ax, BARS_SIZE)
    terms = np.arange(2, len(fit.coefficients) + 1)
    ax.bar(terms, fit.coefficients[1:], 0.7, color=COLOURS[0])
    ax.axhline(0.0, color="black", linewidth=0.6)
    if len(terms) <= _MOST_NAMES:
        names = [f"{name}  {j}" for j, name in zip(terms, fit.names[1:], strict=True)]
        ax.set_xticks(terms, names, rotation=60, ha="right", rotation_mode="anchor", fontsize="small")
    ax.set(
        xlabel=f"term, {fit.order.name} order",
        ylabel="coefficient / waves",
        title=f"Zernike polynomials; residual {fit.residual:.2g} waves RMS",
    )
    return ax
