"""Plots over the field, as lens design programs draw them: the field upwards, the quantity to the right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from plenoptic.core.values import Floats, check_has
from plenoptic.plots.canvas import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.lens.analysis.field_aberrations import Coma, DepthDistortion, Distortion, FieldCurvature
    from plenoptic.optics.lens.analysis.illumination import RelativeIllumination, Vignetting

_SAGITTAL, _TANGENTIAL, _OTHER = "#1f5fbf", "#c23b2c", "#888888"


def _check(result: Any, attribute: str, kind: str, maker: str) -> None:
    check_has(result, "result", kind, f"what pl.aberrations.{maker}(lens, fields) returns", attribute)


def _field_axis(result: Any) -> tuple[Floats, str]:
    """Fields as figures show them, and their label: degrees of an object infinitely far away, otherwise mm."""
    if result.z_object == -np.inf:
        return np.degrees(result.fields), "half field / °"
    return np.asarray(result.fields), "object height / mm"


def _upwards(result: Any, ax: Axes | None, curves: Sequence[Floats], label: str, title: str) -> Axes:
    """Draw curves to the right, the field upwards from 0: a single one, or the sagittal and the tangential one."""
    ax = axes_or_new(ax, (3.6, 4.6))
    fields, field_label = _field_axis(result)
    if len(curves) > 1:
        ax.plot(curves[0], fields, color=_SAGITTAL, label="sagittal")
        ax.plot(curves[1], fields, color=_TANGENTIAL, linestyle="--", label="tangential")
        ax.legend(frameon=False, fontsize="small")
    else:
        ax.plot(curves[0], fields, color=_TANGENTIAL)
    ax.axvline(0.0, color=_OTHER, linewidth=0.8, zorder=0)
    ax.set_ylim(min(0.0, float(np.min(fields))), max(float(np.max(fields)), 1e-9))
    ax.margins(x=0.15)
    ax.set(xlabel=label, ylabel=field_label, title=title)
    return ax


def plot_distortion(result: Distortion, ax: Axes | None = None) -> Axes:
    """Draw distortion in percent to the right, the field upwards.

    Parameters
    ----------
    result : Distortion
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> import plenoptic as pl
    >>> ax = pl.plots.plot_distortion(pl.aberrations.distortion(pl.load_lens("singlet-100mm-f4"), [0.0, 0.1, 0.2]))
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('distortion / %', 'half field / °')
    """
    _check(result, "projection", "Distortion", "distortion")
    percent = 100.0 * result.relative
    ax = _upwards(result, ax, [percent], "distortion / %", f"distortion, {result.projection.name.lower()}")
    reach = 1.15 * max(float(np.nanmax(np.abs(percent), initial=0.0)), 0.1)
    ax.set_xlim(-reach, reach)
    return ax


def plot_field_curvature(result: FieldCurvature, ax: Axes | None = None) -> Axes:
    """Draw the shifts of the sagittal and the tangential focus to the right, the field upwards.

    Parameters
    ----------
    result : FieldCurvature
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        Shifts from the paraxial image plane in mm, the lens on the left; the difference is the astigmatism.

    Examples
    --------
    >>> import plenoptic as pl
    >>> found = pl.aberrations.field_curvature(pl.load_lens("singlet-100mm-f4"), [0.0, 0.1, 0.2])
    >>> ax = pl.plots.plot_field_curvature(found)
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['sagittal', 'tangential']
    """
    _check(result, "astigmatism", "FieldCurvature", "field_curvature")
    return _upwards(result, ax, [result.sagittal, result.tangential], "focus shift / mm", "field curvature")


def plot_coma(result: Coma, ax: Axes | None = None) -> Axes:
    """Draw sagittal and tangential coma to the right, the field upwards.

    Parameters
    ----------
    result : Coma
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> import plenoptic as pl
    >>> ax = pl.plots.plot_coma(pl.aberrations.coma(pl.load_lens("singlet-100mm-f4"), [0.0, 0.1], zone=0.5))
    >>> ax.get_title()
    'coma, zone 0.5'
    """
    _check(result, "zone", "Coma", "coma")
    return _upwards(result, ax, [result.sagittal, result.tangential], "coma / mm", f"coma, zone {result.zone:g}")


def plot_vignetting(result: Vignetting, ax: Axes | None = None) -> Axes:
    """Draw the part of the iris that is filled, and the rim rays, against the field.

    Parameters
    ----------
    result : Vignetting
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        The field to the right, the part of the iris that is filled upwards. A second axis on the right has the rim
        rays: y on the iris over its semi-diameter, between which light passes.

    Examples
    --------
    >>> import plenoptic as pl
    >>> found = pl.aberrations.vignetting(pl.load_lens("double-gauss-100mm-f2"), [0.0, 0.2, 0.35])
    >>> ax = pl.plots.plot_vignetting(found)
    >>> [part.get_ylabel() for part in ax.figure.axes]
    ['part of the iris filled', 'y of the rim rays / semi-diameter of the iris']
    """
    _check(result, "fraction", "Vignetting", "vignetting")
    ax = axes_or_new(ax, (5.4, 4.0))
    fields, field_label = _field_axis(result)
    rims = ax.twinx()
    rims.fill_between(fields, result.lower, result.upper, color=_TANGENTIAL, alpha=0.15, linewidth=0)
    for rim in (result.lower, result.upper):
        rims.plot(fields, rim, color=_TANGENTIAL, linewidth=0.8, linestyle="--")
    ax.plot(fields, result.fraction, color=_SAGITTAL, linewidth=1.8)
    ax.set(ylim=(0.0, 1.05), xlabel=field_label, title="vignetting")
    rims.set_ylim(-1.05, 1.05)
    for part, label, colour in (
        (ax, "part of the iris filled", _SAGITTAL),
        (rims, "y of the rim rays / semi-diameter of the iris", _TANGENTIAL),
    ):
        part.set_ylabel(label, color=colour)
        part.tick_params(axis="y", colors=colour)
    return ax


def plot_relative_illumination(result: RelativeIllumination, ax: Axes | None = None) -> Axes:
    """Draw the illumination of the image plane against that on the axis, with the fourth power of the cosine.

    Parameters
    ----------
    result : RelativeIllumination
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        The field to the right. cos^4 of the half field is drawn where that is an angle below 90 degrees.

    Examples
    --------
    >>> import plenoptic as pl
    >>> found = pl.aberrations.relative_illumination(pl.load_lens("double-gauss-100mm-f2"), [0.0, 0.2, 0.35])
    >>> ax = pl.plots.plot_relative_illumination(found)
    >>> ax.get_title()
    'relative illumination'
    """
    _check(result, "projected_solid_angle", "RelativeIllumination", "relative_illumination")
    ax = axes_or_new(ax, (5.4, 4.0))
    fields, field_label = _field_axis(result)
    ax.plot(fields, result.relative, color=_SAGITTAL, label="lens")
    if result.z_object == -np.inf and np.all(np.abs(result.fields) < np.pi / 2):
        angle = np.linspace(float(np.min(result.fields)), float(np.max(result.fields)), 101)
        ax.plot(np.degrees(angle), np.cos(angle) ** 4, color=_OTHER, linestyle=":", label="cos⁴")
        ax.legend(frameon=False, fontsize="small")
    ax.set_ylim(0.0, 1.05 * max(1.0, float(np.nanmax(result.relative, initial=1.0))))
    ax.set(xlabel=field_label, ylabel="illumination / that on the axis", title="relative illumination")
    return ax


def plot_depth_distortion(result: DepthDistortion, ax: Axes | None = None) -> Axes:
    """Draw by how much the sharp distance differs from that on the axis, against the height on the sensor.

    Parameters
    ----------
    result : DepthDistortion
    ax : matplotlib.axes.Axes, default: those of a new figure

    Returns
    -------
    matplotlib.axes.Axes
        One line a sensor plane: z of the medial focus minus z of the paraxial object plane in percent of that z.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> found = pl.aberrations.depth_distortion(lens, [0.0, 10.0, 20.0], z_image=[120.0, 134.6])
    >>> ax = pl.plots.plot_depth_distortion(found)
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['-668.4 mm', '-404.2 mm']
    """
    _check(result, "medial", "DepthDistortion", "depth_distortion")
    ax = axes_or_new(ax, (5.4, 4.0))
    for plane, medial in zip(result.z_object.tolist(), result.medial, strict=True):
        ax.plot(result.heights, 100.0 * (medial / plane - 1.0), label=f"{plane:.4g} mm")
    ax.axhline(0.0, color=_OTHER, linewidth=0.8, zorder=0)
    ax.legend(title="z of the object", frameon=False, fontsize="small")
    ax.set(xlabel="height on the sensor / mm", ylabel="change of the sharp distance / %", title="depth distortion")
    return ax
