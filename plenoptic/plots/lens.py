"""Sections of a lens, rays through it and holes of its stops, true to scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import Floats, check_has
from plenoptic.errors import InvalidValueError
from plenoptic.plots.canvas import COLOURS, axes_or_new, literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.lens.stack import LensStack
    from plenoptic.optics.stops.stop_registry import Stop

_GLASS = "#cfe3f3"
_EDGE = "#31566f"
_IMAGE = "#222222"
_MIRROR = "#8a6d3b"
_STOP = "#222222"
_OTHER_STOP = "#888888"


def unfolding_note(lens: LensStack) -> str:
    """Remark for the picture of a lens with mirrors; empty for others."""
    return ", unfolded at its mirrors" if _mirrors(lens) else ""


def _mirrors(lens: LensStack) -> list[int]:
    return [i for i, element in enumerate(lens.elements) if hasattr(getattr(element, "medium", None), "fold")]


def plot_lens(lens: LensStack, ax: Axes | None = None) -> Axes:
    """Draw the section of a lens, true to scale; mirrors are brown, and elements behind them are drawn as seen in them.

    Parameters
    ----------
    lens : LensStack
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        z in mm to the right, towards the sensor, y in mm upwards; the iris is at z = 0 and darkest.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ax = pl.plots.plot_lens(pl.load_lens("double-gauss-100mm-f2"))
    >>> ax.get_xlabel()
    'z / mm'
    """
    check_has(lens, "lens", "LensStack", "camera.lens", "profiles")
    ax = axes_or_new(ax, (7.0, 5.0))
    profiles, thick = lens.profiles(), 2.5
    _fill_glass(lens, profiles, ax)
    reach = 1.05 * max(element.semi_diameter for element in lens.elements)
    for i, (z, element, profile) in enumerate(zip(lens.vertices.tolist(), lens.elements, profiles, strict=True)):
        if hasattr(element, "medium"):
            colour, width = (_MIRROR, thick) if i in _mirrors(lens) else (_EDGE, 1.0)
            ax.plot(profile[:, 0], profile[:, 1], color=colour, linewidth=width)
        else:
            colour = _STOP if i == lens.iris_index else _OTHER_STOP
            hole, outer = element.semi_diameter, max(reach, 1.15 * element.semi_diameter)
            ax.plot([z, z, np.nan, z, z], [-outer, -hole, np.nan, hole, outer], color=colour, linewidth=thick)
        if hasattr(element, "inner_semi_diameter") and not element.contains(0.0, 0.0):  # type: ignore[union-attr]
            radius = element.inner_semi_diameter
            ax.plot([z, z], [-radius, radius], color=_STOP, linewidth=thick)
    ax.axhline(0.0, color=_OTHER_STOP, linewidth=0.6, linestyle="--")
    ax.set_aspect("equal")
    ax.set(xlabel="z / mm", ylabel="y / mm", title=literal(lens.name or "lens") + unfolding_note(lens))
    return ax


def _fill_glass(lens: LensStack, profiles: Sequence[Floats], ax: Axes) -> None:
    """Glass with closed outlines: from rim to rim along the axis and, where these differ in height, across."""
    for i, j in lens.glasses:
        front, rear = profiles[i], profiles[j]
        low, high = (max(front[end, 1], rear[end, 1], key=abs) for end in (0, -1))
        top = [(front[-1, 0], high), (rear[-1, 0], high)]
        bottom = [(rear[0, 0], low), (front[0, 0], low)]
        outline = np.concatenate([front, top, rear[::-1], bottom])
        ax.fill(outline[:, 0], outline[:, 1], facecolor=_GLASS, edgecolor=_EDGE, linewidth=1.0, zorder=0.9)


def plot_stop(stop: Stop, ax: Axes | None = None) -> Axes:
    """Draw the hole of a stop as seen from behind, from the sensor: opaque is dark, and the circle around it dashed.

    Parameters
    ----------
    stop : Stop
        Its placement is left out.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        x in mm to the right, y in mm upwards.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ax = pl.plots.plot_stop(pl.PolygonStop(blades=6, semi_diameter=5.0, blade_radius=8.0))
    >>> ax.get_xlabel()
    'x / mm'
    """
    check_has(stop, "stop", "stop", "camera.lens.stop", "outline")
    ax = axes_or_new(ax, (4.0, 4.0))
    reach = 1.15 * stop.semi_diameter
    ax.set_facecolor(_STOP)
    if hasattr(stop, "transmission"):
        rows, columns = np.shape(stop.transmission)
        x, y = 0.5 * columns * stop.cell_size, 0.5 * rows * stop.cell_size  # type: ignore[union-attr]
        ax.imshow(stop.transmission, cmap="gray", vmin=0.0, vmax=1.0, extent=(-x, x, -y, y), interpolation="nearest")
    else:
        ax.fill(*stop.outline(256).T, facecolor="white", edgecolor="none")
        if hasattr(stop, "inner_semi_diameter") and not stop.contains(0.0, 0.0):
            inner = stop.inner_semi_diameter / stop.semi_diameter
            ax.fill(*(inner * stop.outline(256)).T, facecolor=_STOP, edgecolor="none")
    angle = np.linspace(0.0, 2 * np.pi, 129)
    circle = stop.semi_diameter * np.stack([np.cos(angle), np.sin(angle)])
    ax.plot(*circle, color=_OTHER_STOP, linewidth=0.8, linestyle="--")
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x / mm", ylabel="y / mm", title=type(stop).__name__)
    ax.set_aspect("equal")
    return ax


def plot_layout(
    lens: LensStack,
    paths: Sequence[Floats],
    *,
    labels: Sequence[str] = (),
    z_image: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the section of a lens, with closed glass outlines, and rays that have been traced, for `LensStack.layout`.

    `paths` has one array (n_rays, n_points, 3) a field, drawn in one colour: points x, y, z in mm, to the first nan.
    `labels` name the fields, and an image plane is drawn at `z_image`, mm.
    """
    check_has(lens, "lens", "LensStack", "camera.lens", "profiles")
    if len(labels) not in (0, len(paths)):
        raise InvalidValueError(f"there are {len(labels)} labels for {len(paths)} fields; give one for each, or none")
    ax = axes_or_new(ax, (10.0, 5.0))
    for k, field in enumerate(paths):
        label = labels[k] if labels else None
        joined = np.pad(np.asarray(field, dtype=np.float64), ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)
        z, y = joined[..., 2].ravel(), joined[..., 1].ravel()
        ax.plot(z, y, color=COLOURS[k % len(COLOURS)], linewidth=0.7, label=label, zorder=1.5)
    plot_lens(lens, ax)
    if z_image is not None:
        heights = [np.abs(field[:, -1, 1]) for field in paths]
        reach = max((float(np.nanmax(h, initial=0.0)) for h in heights), default=0.0)
        reach = 1.05 * reach or lens.stop.semi_diameter
        ax.plot([z_image, z_image], [-reach, reach], color=_IMAGE, linewidth=1.2)
    if labels:
        ax.legend(title="field", loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize="small")
    return ax
