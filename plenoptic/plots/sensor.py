"""Plots of a sensor: sensitivity of its channels, and noise against signal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import check_has
from plenoptic.plots.canvas import COLOURS, axes_or_new, literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.core.color.spectra import Sensitivity
    from plenoptic.readout.photon_transfer import PhotonTransfer

_RULE = "#888888"


def plot_sensitivity(sensitivity: Sensitivity, ax: Axes | None = None) -> Axes:
    """Draw the normalised response of each channel against the wavelength, or a line for each channel.

    Parameters
    ----------
    sensitivity : Sensitivity
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        Wavelength in nm to the right, response in 1/nm upwards, whose integral is 1; the response of lines has no
        unit, since each sees one wavelength only. Three channels are red, green and blue.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.plots.plot_sensitivity(pl.sensitivities.colour_camera()).get_xlabel()
    'wavelength / nm'
    """
    check_has(sensitivity, "sensitivity", "Sensitivity", "sensitivities.colour_camera()", "normalised")
    ax = axes_or_new(ax, (6.0, 3.6))
    colours = (COLOURS[1], COLOURS[2], COLOURS[0]) if sensitivity.channels == 3 else ("black",)
    response = sensitivity.normalised.response
    for channel, colour in enumerate(colours):
        name = f"channel {channel}"
        if response is None:
            line = sensitivity.wavelengths[channel]
            ax.plot([line, line], [0.0, 1.0], color=colour, label=f"{literal(name)}, {line:g} nm")
        else:
            ax.plot(sensitivity.wavelengths, response[:, channel], color=colour, label=literal(name))
    ax.axhline(0.0, color=_RULE, linewidth=0.6, zorder=0)
    ax.set(xlabel="wavelength / nm", ylabel="response" if response is None else "response / (1/nm)")
    if response is None:
        ax.margins(x=0.5)  # room for the legend, and for a single line
    if sensitivity.channels == 3:
        ax.legend(frameon=False, fontsize="small")
    return ax


def plot_photon_transfer(curve: PhotonTransfer, ax: Axes | None = None) -> Axes:
    """Draw variances against the mean signal, both axes logarithmic.

    Parameters
    ----------
    curve : PhotonTransfer
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        Signal above that of the lowest level in DN, variance in DN^2: dots are measured, lines are predicted by the
        parameters of the sensor without saturation. A fixed pattern is drawn if the sensor has one. The
        dashed vertical line is the white level.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> sensor = pl.SensorModel(photon_rate=20000.0, gain=0.25, read_noise=6.0, prnu=0.01)
    >>> ax = pl.plots.plot_photon_transfer(pl.sensor.photon_transfer(sensor, np.append(0.0, np.geomspace(1e-4, 1, 13))))
    >>> ax.get_xlabel()
    'signal above dark / DN'
    """
    check_has(curve, "curve", "PhotonTransfer", "photon_transfer(model, levels)", "expected_pattern_variance")
    ax = axes_or_new(ax, (6.0, 4.4))
    dark = float(np.min(curve.expected_mean))
    order = np.argsort(curve.expected_mean)
    lit = order[curve.expected_mean[order] > dark]  # a logarithmic axis has no place for the darkest level
    for colour, label, measured, expected in (
        ("C0", "temporal noise", curve.variance, curve.expected_variance),
        ("C1", "fixed pattern", curve.pattern_variance, curve.expected_pattern_variance),
    ):
        if not expected.any():
            continue
        ax.plot((curve.mean - dark)[lit], measured[lit], "o", markersize=4, color=colour, label=f"{label}, measured")
        ax.plot((curve.expected_mean - dark)[lit], expected[lit], "-", color=colour, label=f"{label}, expected")
    if np.isfinite(curve.white_level):
        ax.axvline(curve.white_level - dark, linestyle="--", color="0.5", label="white level")
    ax.set_xscale("log", nonpositive="mask")
    ax.set_yscale("log", nonpositive="mask")
    ax.set(
        xlabel="signal above dark / DN",
        ylabel="variance / DN²",
        title=f"Photon transfer: {curve.gain:.4g} DN per electron",
    )
    ax.legend(fontsize="small", frameon=False)
    return ax
