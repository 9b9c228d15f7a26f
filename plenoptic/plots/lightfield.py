"""Sub-aperture views, side by side as they lie in the pupil."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.color.srgb import linear_to_srgb
from plenoptic.core.files.codes import white_point
from plenoptic.core.values import check_has, whole
from plenoptic.errors import InvalidValueError
from plenoptic.plots.canvas import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.lightfield.views import LightField

_GAP = 1
"""Pixels between views."""
_UNLIT = 0.5
"""Grey where a view holds nothing."""


def plot_views(field: LightField, *, every: int = 1, ax: Axes | None = None) -> Axes:
    """Draw the sub-aperture views of a light field as a mosaic: u to the right, v down.

    Parameters
    ----------
    field : LightField
    every : int, optional
        Draw every second, third, ... view, counted from the central one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.axes.Axes
        Axes are the offsets u and v in pixels of the raw image. One scale for all views, from 0 to the 99.8th
        percentile; grey ones are linear, coloured ones encoded for the screen (sRGB). Middle grey holds nothing.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(80, 80), pixel_pitch=0.01),
    ...     stop_to_microlenses=134.6, microlenses_to_sensor=2.0)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> ax = pl.plots.plot_views(pl.lightfield.decode(white, white, views=5))
    >>> ax.get_xlabel()
    'u / pixel'
    """
    check_has(field, "field", "LightField", "pl.lightfield.decode(shot, white)", "views", "u")
    step = whole(every, "every", at_least=1)
    ax = axes_or_new(ax, (6.4, 6.4))
    chosen = [np.arange(len(o) // 2 % step, len(o), step) for o in (field.u, field.v)]
    views = np.asarray(field.views[np.ix_(*chosen)], dtype=np.float64)
    across, down, rows, columns, channels = views.shape
    if not np.isfinite(views).any():
        raise InvalidValueError("no view of the light field holds any light; decode one with a larger region")
    framed = np.full((across, down, rows + _GAP, columns + _GAP, channels), np.nan)
    framed[:, :, :rows, :columns] = views
    mosaic = framed.transpose(1, 2, 0, 3, 4).reshape(down * (rows + _GAP), across * (columns + _GAP), channels)
    scaled = np.clip(mosaic / white_point(views), 0.0, 1.0)
    encoded = scaled if channels == 1 else linear_to_srgb(np.nan_to_num(scaled))
    filled = np.where(np.isfinite(scaled), encoded, _UNLIT)
    ax.imshow(np.broadcast_to(filled, (*filled.shape[:2], 3)), interpolation="nearest")
    for offsets, picked, size, name in ((field.u, chosen[0], columns, "x"), (field.v, chosen[1], rows, "y")):
        places = (size + _GAP) * np.arange(len(picked)) + (size - 1) / 2
        shown_ticks = np.unique(np.linspace(0, len(picked) - 1, min(len(picked), 7)).round().astype(int))
        labels = [f"{offsets[picked[k]]:g}" for k in shown_ticks]
        ax.set(**{f"{name}ticks": places[shown_ticks], f"{name}ticklabels": labels})
    ax.set(xlabel="u / pixel", ylabel="v / pixel")
    return ax
