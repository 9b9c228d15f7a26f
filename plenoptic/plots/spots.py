"""Spot diagrams, through the focus too, ray fans, and ghosts by their size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import Floats, check_has, wrong_kind
from plenoptic.errors import InvalidValueError
from plenoptic.plots.canvas import axes_or_new, figure_or_new, literal, wavelength_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.optics.lens.analysis.best_focus import ThroughFocus
    from plenoptic.optics.lens.analysis.spot_diagram import RayFan, SpotDiagram
    from plenoptic.optics.lens.ghosts.ghost_table import GhostTable

MICROMETRES = 1e3
_MOST_DOTS = 3000
"""Dots of one panel: more of them are one blot, and a slow file."""
LIMIT = "#777777"
_SMALLEST_SPOT = 0.1
"""um; a panel of a perfect image still needs an extent."""
_NAMED_GHOSTS = 6
"""Ghosts with a name in the figure: those of the largest irradiance."""


def field_label(field: Floats, z_object: float) -> str:
    """Name of an object point in titles: its angle, or its height."""
    x, y = (float(component) + 0.0 for component in field)  # -0.0 becomes 0.0
    if math.isinf(z_object):
        x, y, unit = math.degrees(x), math.degrees(y), "°"
    else:
        unit = " mm"
    position = f"{y:.3g}{unit}" if x == 0 else f"({x:.3g}, {y:.3g}){unit}"
    return f"field {position}"


def _rows(spots: Any) -> list[list[SpotDiagram]]:
    """The diagrams as a rectangle: one row where a plain sequence is given."""
    if hasattr(spots, "rms_radius"):
        return [[spots]]
    try:
        rows = [[row] if hasattr(row, "rms_radius") else list(row) for row in spots]
    except TypeError:
        rows = []
    if rows and all(len(row) == 1 for row in rows):
        rows = [[row[0] for row in rows]]
    if not rows or not all(hasattr(spot, "rms_radius") for row in rows for spot in row):
        raise wrong_kind(spots, "spots", "SpotDiagram or a sequence", "pl.aberrations.spot_diagram(lens)")
    if len({len(row) for row in rows}) != 1 or not rows[0]:
        raise InvalidValueError(f"spots has rows of {[len(row) for row in rows]} diagrams; give rows of equal length")
    return rows


def _draw_spot(ax: Axes, spot: SpotDiagram, half: float, *, airy: bool) -> None:
    from matplotlib.colors import to_rgba_array

    if len(spot.x):
        centre = spot.centroid
        # In an order that lets no wavelength lie on top of the others.
        drawn = np.random.default_rng(0).permutation(np.arange(0, len(spot.x), -(-len(spot.x) // _MOST_DOTS)))
        colours = to_rgba_array(wavelength_colours(spot.wavelengths))
        x, y = spot.x[drawn] - centre[0], spot.y[drawn] - centre[1]
        size = 5.0 if len(drawn) < 1000 else 2.0
        ax.scatter(
            MICROMETRES * x, MICROMETRES * y, s=size, c=colours[spot.colour[drawn]], linewidths=0, rasterized=True
        )
        rms = MICROMETRES * spot.rms_radius
        label = f"RMS {rms:.3g} µm" if rms >= 1e-3 else "RMS < 0.001 µm"
        ax.text(0.03, 0.03, label, transform=ax.transAxes, fontsize="small")
    else:
        ax.text(0.5, 0.5, "no light", transform=ax.transAxes, ha="center", va="center")
    if airy and math.isfinite(spot.airy_radius):
        angle = np.linspace(0.0, 2.0 * math.pi, 181)
        radius = MICROMETRES * spot.airy_radius
        ax.plot(radius * np.cos(angle), radius * np.sin(angle), color=LIMIT, linewidth=0.9)
    ax.set_xlim(-half, half)
    ax.set_ylim(-half, half)
    ax.locator_params(nbins=4)
    ax.set_aspect("equal")


def _wavelength_legend(figure: Figure, wavelengths: Sequence[float], **shown: Any) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, label=f"{w:g} nm", **shown)
        for w, colour in zip(wavelengths, wavelength_colours(wavelengths), strict=True)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)


def plot_spots(
    spots: SpotDiagram | Sequence[SpotDiagram] | Sequence[Sequence[SpotDiagram]],
    *,
    airy: bool = False,
    titles: Sequence[str] = (),
    figure: Figure | None = None,
) -> Figure:
    """Draw spot diagrams side by side, or in rows and columns, all at one scale.

    Parameters
    ----------
    spots : SpotDiagram, or a sequence of them, or a sequence of rows of them
        For example one row for each field and one column for each defocus.
    airy : bool, optional
        Draw a circle of the radius of the Airy disc, for comparison, around the centroid.
    titles : sequence of str, optional
        Of the diagrams, row by row, in place of their fields and planes.
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        x and y on the image plane in micrometres from the centroid of the light, with equal axes; one colour for
        each wavelength. Labels that are the same in a row or a column are written once. Of many rays, every k-th is
        drawn.

    Raises
    ------
    InvalidValueError
        If `spots` holds no spot diagrams, or rows of different lengths.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens, spot = pl.load_lens("double-gauss-100mm-f2"), pl.aberrations.spot_diagram
    >>> grid = [[spot(lens, field=(0, y), z_image=z) for z in (102, 102.5)] for y in (0, 0.1)]
    >>> figure = pl.plots.plot_spots(grid)
    >>> len(figure.axes), figure.axes[0].get_title()
    (4, 'z = 102 mm')
    """
    rows = _rows(spots)
    flat, count = [spot for row in rows for spot in row], (len(rows), len(rows[0]))
    wavelengths = flat[0].wavelengths
    if len(titles) not in (0, len(flat)):
        raise InvalidValueError(f"there are {len(titles)} titles for {len(flat)} diagrams; give one each")
    several = len(wavelengths) > 1
    figure = figure_or_new(figure, (1.0 + 2.3 * count[1], 1.1 + 0.35 * several + 2.3 * count[0]))
    axes = figure.subplots(*count, sharex=True, sharey=True, squeeze=False)
    radii = [spot.geometric_radius for spot in flat] + [spot.airy_radius for spot in flat if airy]
    largest = max((radius for radius in radii if math.isfinite(radius)), default=0.0)
    half = 1.15 * max(MICROMETRES * largest, _SMALLEST_SPOT)
    by_row = count[0] > 1 and all(len({tuple(spot.field) for spot in row}) == 1 for row in rows)
    by_column = count[0] > 1 and all(len({spot.z_image for spot in column}) == 1 for column in zip(*rows, strict=True))
    for i, row in enumerate(rows):
        for j, spot in enumerate(row):
            ax = axes[i, j]
            _draw_spot(ax, spot, half, airy=airy)
            title = [] if by_row else [field_label(spot.field, spot.z_object)]
            if not by_column or i == 0:
                title.append(f"z = {spot.z_image:.6g} mm")
            heading = titles[i * count[1] + j] if titles else "\n".join(title)
            ax.set_title(heading, fontsize="medium")
        label = "y / µm"
        axes[i, 0].set_ylabel(f"{field_label(row[0].field, row[0].z_object)}\n{label}" if by_row else label)
    for ax in axes[-1]:
        ax.set_xlabel("x / µm")
    if several:
        _wavelength_legend(figure, wavelengths, marker="o", markersize=4, linestyle="")
    return figure


def plot_ray_fan(fan: RayFan, *, figure: Figure | None = None) -> Figure:
    """Draw transverse aberrations against the coordinate in the iris.

    Parameters
    ----------
    fan : RayFan
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        Left the tangential component of the tangential fan, right the sagittal component of the sagittal fan, in
        micrometres at one scale; blank where rays are lost.

    Examples
    --------
    >>> import plenoptic as pl
    >>> figure = pl.plots.plot_ray_fan(pl.aberrations.ray_fan(pl.load_lens("double-gauss-100mm-f2"), field=(0, 0.1)))
    >>> [ax.get_title() for ax in figure.axes]
    ['tangential fan', 'sagittal fan']
    """
    check_has(fan, "fan", "RayFan", "pl.aberrations.ray_fan(lens)", "tangential", "pupil")
    figure = figure_or_new(figure, (7.6, 3.6))
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    for ax, curves, title, name in (
        (axes[0], fan.tangential[:, :, 1], "tangential fan", "y"),
        (axes[1], fan.sagittal[:, :, 0], "sagittal fan", "x"),
    ):
        ax.axhline(0.0, color=LIMIT, linewidth=0.6)
        ax.axvline(0.0, color=LIMIT, linewidth=0.6)
        for curve, colour in zip(curves, wavelength_colours(fan.wavelengths), strict=True):
            ax.plot(fan.pupil, MICROMETRES * curve, color=colour, linewidth=1.3)
        ax.set_title(title)
        ax.set_xlabel(f"{name} in the iris / its semi-diameter")
        ax.set_xlim(-1.0, 1.0)
    axes[0].set_ylabel("transverse aberration / µm")
    figure.suptitle(f"{field_label(fan.field, fan.z_object)}, z = {fan.z_image:.6g} mm", fontsize="medium")
    if len(fan.wavelengths) > 1:
        _wavelength_legend(figure, fan.wavelengths)
    return figure


def plot_through_focus(found: ThroughFocus, ax: Axes | None = None) -> Axes:
    """The radius of the spot against the plane in which it is looked at.

    Parameters
    ----------
    found : ThroughFocus
        From `aberrations.through_focus`.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        z in mm to the right, RMS and largest radius in micrometres upwards; the best RMS focus is dashed.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ax = pl.plots.plot_through_focus(pl.aberrations.through_focus(pl.load_lens("singlet-100mm-f4")))
    >>> ax.get_xlabel()
    'z / mm'
    """
    check_has(found, "found", "ThroughFocus", "pl.aberrations.through_focus(lens)", "geometric_radius", "best")
    ax = axes_or_new(ax, (6.0, 4.0))
    ax.plot(found.z, 1e3 * found.rms_radius, color="#31566f", label="RMS")
    ax.plot(found.z, 1e3 * found.geometric_radius, color="#c8553d", linestyle="--", label="largest")
    ax.axvline(found.best, color="#888888", linewidth=0.8, linestyle=":")
    ax.set_ylim(bottom=0.0)
    ax.set(
        xlabel="z / mm", ylabel="radius of the spot / µm", title=f"Through focus, best RMS at z = {found.best:.3f} mm"
    )
    ax.legend(frameon=False)
    return ax


def plot_ghosts(ghosts: GhostTable, ax: Axes | None = None) -> Axes:
    """Draw the light of each ghost against the RMS radius of its blur, both on logarithmic scales.

    Small and bright ghosts, which images show first, lie at the upper left; dashed lines have equal irradiance.

    Parameters
    ----------
    ghosts : GhostTable
        From `LensStack.ghosts`.
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        RMS radius in mm to the right, light over that of the image upwards; the colour is the distance of the focus
        behind the image plane, up to 100 mm.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ax = pl.plots.plot_ghosts(pl.load_lens("double-gauss-100mm-f2").ghosts())
    >>> ax.get_xlabel()
    'RMS radius / mm'
    """
    check_has(ghosts, "ghosts", "GhostTable", "lens.ghosts()", "energy_error")
    ax = axes_or_new(ax, (6.4, 4.4))
    lit = np.flatnonzero((ghosts.energy > 0) & (ghosts.radius > 0))
    radius, energy = ghosts.radius[lit], ghosts.energy[lit]
    limit = 100.0
    points = ax.scatter(radius, energy, c=np.clip(ghosts.focus[lit], -limit, limit), cmap="coolwarm", s=28, zorder=3)
    points.set_clim(-limit, limit)
    points.set_edgecolor("#444444")
    ax.set(xscale="log", yscale="log")
    ax.margins(0.12)
    limits = ax.get_xlim(), ax.get_ylim()
    r = np.array(limits[0])
    densities = np.log10(energy / radius**2) if len(lit) else np.zeros(1)
    for density in range(int(np.floor(densities.min())), int(np.ceil(densities.max())) + 1):
        ax.plot(r, 10.0**density * r * r, color="#bbbbbb", linewidth=0.7, linestyle="--", zorder=0)
    ax.set(xlim=limits[0], ylim=limits[1])
    for k in np.argsort(-energy / radius**2, kind="stable")[:_NAMED_GHOSTS]:
        name = ghosts.names[lit[k]]
        ax.annotate(name, (radius[k], energy[k]), (5, 3), textcoords="offset points", fontsize="small")
    ax.figure.colorbar(points, ax=ax, label="focus behind the image plane / mm", extend="both")
    title = f"{literal(ghosts.lens.name or 'lens')}, {field_label(ghosts.field, ghosts.z_object)}\n"
    ax.set(
        xlabel="RMS radius / mm",
        ylabel="light over that of the image",
        title=title + f"ghosts, {ghosts.total:.2g} in all",
    )
    return ax
