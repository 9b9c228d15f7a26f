"""A lens with rays, true to scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import Floats, check_has
from plenoptic.errors import InvalidValueError
from plenoptic.plots.canvas import axes_or_new
from plenoptic.plots.lens import EDGE, GLASS, plot_lens

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.lens.stack import LensStack

_IMAGE = "#222222"
_COLOURS = ("#1f5fbf", "#2c8a3d", "#c23b2c", "#b07a00", "#7c4fa8", "#008b8b")


def _joined(paths: Floats) -> tuple[Floats, Floats]:
    """Coordinates z and y of all paths as one line with gaps."""
    gap = np.full((len(paths), 1, 3), np.nan)
    points = np.concatenate([paths, gap], axis=1).reshape(-1, 3)
    return points[:, 2], points[:, 1]


def _fill_glass(lens: LensStack, ax: Axes) -> None:
    """Glass with closed outlines: from rim to rim along the axis and, where these differ in height, across."""
    profiles = lens.profiles()
    for i, j in lens.glasses:
        front, rear = profiles[i], profiles[j]
        ends = []
        for end in (0, -1):
            outer = max(front[end, 1], rear[end, 1], key=abs)
            ends.append(np.array([[front[end, 0], outer], [rear[end, 0], outer]]))
        outline = np.concatenate([front, ends[1], rear[::-1], ends[0][::-1]])
        ax.fill(outline[:, 0], outline[:, 1], facecolor=GLASS, edgecolor=EDGE, linewidth=1.0, zorder=0.9)


def plot_layout(
    lens: LensStack,
    paths: Sequence[Floats],
    *,
    labels: Sequence[str] = (),
    z_image: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the section of a lens, with closed glass outlines, and rays that have been traced.

    `LensStack.layout` traces rays and calls this.

    Parameters
    ----------
    lens : LensStack
    paths : sequence of (n_rays, n_points, 3) arrays
        One array a field, drawn in one colour: points x, y, z in mm. A path ends at its first nan.
    labels : sequence of str, optional
        Names of the fields.
    z_image : float, optional
        Where an image plane is drawn, mm; none if left out.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

    Returns
    -------
    matplotlib.axes.Axes
        z in mm to the right, towards the sensor, y in mm upwards.

    Examples
    --------
    >>> import numpy as np
    >>> import plenoptic as pl
    >>> from plenoptic.plots.layout import plot_layout
    >>> way = np.array([[[0.0, 0.0, -20.0], [0.0, 0.0, 100.0]]])
    >>> ax = plot_layout(pl.load_lens("singlet-100mm-f4"), [way], labels=["axis"], z_image=100.0)
    >>> ax.get_ylabel()
    'y / mm'
    """
    check_has(lens, "lens", "LensStack", "camera.lens", "profiles")
    if len(labels) not in (0, len(paths)):
        raise InvalidValueError(f"there are {len(labels)} labels for {len(paths)} fields; give one for each, or none")
    ax = axes_or_new(ax, (10.0, 5.0))
    for k, field in enumerate(paths):
        label = labels[k] if labels else None
        z, y = _joined(np.asarray(field, dtype=np.float64))
        ax.plot(z, y, color=_COLOURS[k % len(_COLOURS)], linewidth=0.7, label=label, zorder=1.5)
    _fill_glass(lens, ax)
    plot_lens(lens, ax)
    if z_image is not None:
        heights = [np.abs(field[:, -1, 1]) for field in paths]
        reach = max((float(np.nanmax(h, initial=0.0)) for h in heights), default=0.0)
        reach = 1.05 * reach or lens.stop.semi_diameter
        ax.plot([z_image, z_image], [-reach, reach], color=_IMAGE, linewidth=1.2)
    if labels:
        ax.legend(title="field", loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize="small")
    return ax
