"""What the channels of a sensor see."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plenoptic.core.values import check_has
from plenoptic.plots.canvas import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.core.color.spectra import Sensitivity

_RULE = "#888888"


def plot_sensitivity(sensitivity: Sensitivity, ax: Axes | None = None) -> Axes:
    """Draw the normalised response of each channel against the wavelength, or a line for each channel.

    Parameters
    ----------
    sensitivity : Sensitivity
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.axes.Axes
        Wavelength in nm to the right, response in 1/nm upwards, whose integral is 1; the response of lines has no
        unit, since each sees one wavelength only. Three channels are red, green and blue.

    Examples
    --------
    >>> from plenoptic import sensitivities
    >>> from plenoptic.plots.spectra import plot_sensitivity
    >>> plot_sensitivity(sensitivities.colour_camera()).get_xlabel()
    'wavelength / nm'
    """
    check_has(sensitivity, "sensitivity", "Sensitivity", "sensitivities.colour_camera()", "normalised")
    ax = axes_or_new(ax, (6.0, 3.6))
    colours = ("#c8553d", "#5b8e7d", "#31566f") if sensitivity.channels == 3 else ("black",)
    response = sensitivity.normalised.response
    for channel, colour in enumerate(colours):
        name = f"channel {channel}"
        if response is None:
            line = sensitivity.wavelengths[channel]
            ax.plot([line, line], [0.0, 1.0], color=colour, label=f"{name}, {line:g} nm")
        else:
            ax.plot(sensitivity.wavelengths, response[:, channel], color=colour, label=name)
    ax.axhline(0.0, color=_RULE, linewidth=0.6, zorder=0)
    ax.set(xlabel="wavelength / nm", ylabel="response" if response is None else "response / (1/nm)")
    if response is None:
        ax.margins(x=0.5)  # room for the legend, and for a single line
    if sensitivity.channels == 3:
        ax.legend(frameon=False, fontsize="small")
    return ax
