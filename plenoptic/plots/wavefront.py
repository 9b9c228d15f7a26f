"""Figures of wavefronts and of the Zernike polynomials in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import Floats, check_has
from plenoptic.plots.canvas import COLOURS, axes_or_new
from plenoptic.plots.spots import field_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.lens.analysis.wavefront import Wavefront
    from plenoptic.optics.lens.analysis.zernike_fit import ZernikeFit

MAP_SIZE, BARS_SIZE = (5.6, 4.6), (8.0, 4.0)
_MOST_NAMES = 22
"""Terms whose names find room below their bars."""


def plot_wavefront(wavefront: Wavefront, ax: Axes | None = None) -> Axes:
    """Draw the optical path differences over the iris.

    Parameters
    ----------
    wavefront : Wavefront
        From `aberrations.wavefront`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

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
    most = max(float(np.abs(wavefront.opd).max()), 1e-9)
    how: dict[str, Any] = {"cmap": "RdBu_r", "vmin": -most, "vmax": most}
    grid = _squares(wavefront.pupil, wavefront.opd)
    drawn: Any
    if grid is None:
        x, y = wavefront.pupil.T
        drawn = ax.scatter(x, y, c=wavefront.opd, s=max(2.0, 9000.0 / len(wavefront.opd)), **how)
    else:
        drawn = ax.imshow(grid, extent=(-1.0, 1.0, -1.0, 1.0), origin="lower", interpolation="nearest", **how)
    ax.figure.colorbar(drawn, ax=ax, label="optical path difference / waves")
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    ax.plot(np.cos(angle), np.sin(angle), color="#888888", linewidth=0.8)
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
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

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
