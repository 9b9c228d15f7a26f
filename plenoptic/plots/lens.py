"""Sections of a lens, rays through it and holes of its stops, true to scale."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.core.values import Floats, check_has
from plenoptic.errors import InvalidValueError
from plenoptic.plots.canvas import COLOURS, axes_or_new

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


def _glass_sections(lens: LensStack, profiles: tuple[Floats, ...]) -> list[Floats]:
    return [np.concatenate([profiles[i], profiles[j][::-1]]) for i, j in lens.glasses]


def _bars(lens: LensStack) -> dict[int, tuple[float, float, float]]:
    """By the index of each stop: its z, y at the hole and y at the outer end of its upper bar."""
    reach = 1.05 * max(element.semi_diameter for element in lens.elements)
    return {
        i: (float(lens.vertices[i]), element.semi_diameter, max(reach, 1.15 * element.semi_diameter))
        for i, element in enumerate(lens.elements)
        if not hasattr(element, "medium")
    }


def _discs(lens: LensStack) -> list[tuple[float, float]]:
    """Places z and radii of the opaque discs in the middle of stops."""
    return [
        (float(z), element.inner_semi_diameter)
        for z, element in zip(lens.vertices, lens.elements, strict=True)
        if hasattr(element, "inner_semi_diameter") and not element.contains(0.0, 0.0)  # type: ignore[union-attr]
    ]


def unfolded(lens: LensStack) -> str:
    """Remark for the picture of a lens with mirrors; empty for others."""
    return ", unfolded at its mirrors" if _mirrors(lens) else ""


def _mirrors(lens: LensStack) -> list[int]:
    return [i for i, element in enumerate(lens.elements) if hasattr(getattr(element, "medium", None), "fold")]


def _path(points: Floats, close: str = "") -> str:
    return "M" + " L".join(f"{z:.5g},{-y:.5g}" for z, y in points) + close


def lens_svg(lens: LensStack, width: int = 480) -> str:
    """A small drawing as an `<svg>` element `width` pixels wide whose unit is 1 mm: glass filled, stops as bars."""
    profiles = lens.profiles()
    bars = _bars(lens)
    ends = [np.array([[z, -outer], [z, outer]]) for z, _, outer in bars.values()]
    points = np.concatenate([*profiles, *ends])
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    margin, line = 0.04 * float(size.max()), float(size.max()) / 300
    box = (low[0] - margin, low[1] - margin, size[0] + 2 * margin, size[1] + 2 * margin)
    height = width * box[3] / box[2]
    scale = min(1.0, width / height)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width * scale:.0f}" height="{height * scale:.0f}" '
        f'viewBox="{box[0]:.5g} {box[1]:.5g} {box[2]:.5g} {box[3]:.5g}" fill="none" stroke-width="{line:.4g}" '
        'style="background:white">',
        f"<title>{html.escape(lens.name or 'lens')}</title>",
        f'<path d="M{box[0]:.5g},0 h{box[2]:.5g}" stroke="{_OTHER_STOP}" stroke-dasharray="{6 * line:.4g}"/>',
    ]
    parts += [f'<path d="{_path(section, " Z")}" fill="{_GLASS}"/>' for section in _glass_sections(lens, profiles)]
    parts += [f'<path d="{_path(p)}" stroke="{_EDGE}"/>' for i, p in enumerate(profiles) if i not in bars]
    for i, (z, inner, outer) in bars.items():
        colour = _STOP if i == lens.iris_index else _OTHER_STOP
        bar = f"M{z:.5g},{-outer:.5g} V{-inner:.5g} M{z:.5g},{inner:.5g} V{outer:.5g}"
        parts.append(f'<path d="{bar}" stroke="{colour}" stroke-width="{3 * line:.4g}"/>')
    thick = [(_path(profiles[i]), _MIRROR) for i in _mirrors(lens)]
    thick += [(f"M{z:.5g},{-r:.5g} V{r:.5g}", _STOP) for z, r in _discs(lens)]
    parts += [f'<path d="{path}" stroke="{colour}" stroke-width="{3 * line:.4g}"/>' for path, colour in thick]
    return "".join([*parts, "</svg>"])


def plot_lens(lens: LensStack, ax: Axes | None = None) -> Axes:
    """Draw the section of a lens, true to scale; mirrors are brown, and elements behind them are drawn as seen in them.

    Parameters
    ----------
    lens : LensStack
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

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
    profiles, bars = lens.profiles(), _bars(lens)
    for section in _glass_sections(lens, profiles):
        ax.fill(section[:, 0], section[:, 1], facecolor=_GLASS, edgecolor="none")
    for i, profile in enumerate(profiles):
        if i not in bars:
            ax.plot(profile[:, 0], profile[:, 1], color=_EDGE, linewidth=1.0)
    for i, (z, inner, outer) in bars.items():
        colour = _STOP if i == lens.iris_index else _OTHER_STOP
        ax.plot([z, z, np.nan, z, z], [-outer, -inner, np.nan, inner, outer], color=colour, linewidth=2.5)
    for i in _mirrors(lens):
        ax.plot(profiles[i][:, 0], profiles[i][:, 1], color=_MIRROR, linewidth=2.5)
    for z, radius in _discs(lens):
        ax.plot([z, z], [-radius, radius], color=_STOP, linewidth=2.5)
    ax.axhline(0.0, color=_OTHER_STOP, linewidth=0.6, linestyle="--")
    ax.set_aspect("equal")
    ax.set(xlabel="z / mm", ylabel="y / mm", title=(lens.name or "lens") + unfolded(lens))
    return ax


def plot_stop(stop: Stop, ax: Axes | None = None) -> Axes:
    """Draw the hole of a stop as seen from behind, from the sensor: opaque is dark, and the circle around it dashed.

    Parameters
    ----------
    stop : Stop
        Its placement is left out.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if it is left out.

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


def _join(paths: Floats) -> tuple[Floats, Floats]:
    """Coordinates z and y of all paths as one line with gaps."""
    gap = np.full((len(paths), 1, 3), np.nan)
    points = np.concatenate([paths, gap], axis=1).reshape(-1, 3)
    return points[:, 2], points[:, 1]


def fill_glass(lens: LensStack, ax: Axes) -> None:
    """Glass with closed outlines: from rim to rim along the axis and, where these differ in height, across."""
    profiles = lens.profiles()
    for i, j in lens.glasses:
        front, rear = profiles[i], profiles[j]
        low, high = (max(front[end, 1], rear[end, 1], key=abs) for end in (0, -1))
        top = [(front[-1, 0], high), (rear[-1, 0], high)]
        bottom = [(rear[0, 0], low), (front[0, 0], low)]
        outline = np.concatenate([front, top, rear[::-1], bottom])
        ax.fill(outline[:, 0], outline[:, 1], facecolor=_GLASS, edgecolor=_EDGE, linewidth=1.0, zorder=0.9)


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
        z, y = _join(np.asarray(field, dtype=np.float64))
        ax.plot(z, y, color=COLOURS[k % len(COLOURS)], linewidth=0.7, label=label, zorder=1.5)
    fill_glass(lens, ax)
    plot_lens(lens, ax)
    if z_image is not None:
        heights = [np.abs(field[:, -1, 1]) for field in paths]
        reach = max((float(np.nanmax(h, initial=0.0)) for h in heights), default=0.0)
        reach = 1.05 * reach or lens.stop.semi_diameter
        ax.plot([z_image, z_image], [-reach, reach], color=_IMAGE, linewidth=1.2)
    if labels:
        ax.legend(title="field", loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize="small")
    return ax
