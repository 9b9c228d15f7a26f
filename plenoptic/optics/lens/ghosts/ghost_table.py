"""Table of the ghosts of a lens: energy, focus and size of the light reflected at each pair of surfaces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.rays import RayBundle
from plenoptic.core.sampling import sobol_points
from plenoptic.core.values import MAX_POINTS, Floats, finite, result, wavelength_in_nm, whole
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.paraxial import image_position
from plenoptic.optics.lens.ghosts.unfolded import ghost_stack, pairs_of, reflecting_lens
from plenoptic.optics.lens.placement import to_lens_axes
from plenoptic.optics.lens.pupil.object_point import checked_aim, checked_pair, directions_of, field_text
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

_REPLICATES = 32
"""Independent scramblings of the rays, whose differences give the errors."""

_RINGS, _ANGLES = 5, 32
"""Points on the first element whose projection bounds the light that enters."""
_SHOWN = 10
"""Rows of a table in its repr."""


@result
class GhostTable:
    """Ghosts of a lens, the strongest first. Made by `LensStack.ghosts`.

    Attributes
    ----------
    first, second : (n,) array
        Indices in `lens.elements` of the surfaces that reflect the light first and second; the sensor has the index
        ``len(lens.elements)``.
    energy, energy_error : (n,) array
        Light of each ghost in the plane z_image over that of the image, and its standard error.
    focus : (n,) array
        Distance of the ghost's paraxial image behind the plane z_image in mm; negative in front of it.
    radius : (n,) array
        Root mean square distance of the light from its centroid in the plane z_image, mm; nan without light.
    centroid : (n, 2) array
        Its x and y in mm; nan without light.
    total, total_error : float
        Light of all ghosts over that of the image, and its standard error.
    lens : LensStack
    sensor : float
        Reflectance of the sensor; 0 if it reflects nothing.
    field : (2,) array
    z_object, z_image, wavelength : float
        As in `SpotDiagram`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.load_lens("singlet-100mm-f4").ghosts(sensor=0.3)
    <GhostTable: 3 pairs of 'singlet-100mm-f4', (0, 0) rad, 587.6 nm, 0.026 of the image light>
          pair     energy  focus / mm  RMS radius / mm
      sensor-2   1.26e-02      -193.4             17.5
      sensor-1   1.16e-02      -79.47            41.33
           2-1   1.78e-03      -85.59            67.17
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    energy: Floats
    energy_error: Floats
    focus: Floats
    radius: Floats
    centroid: Floats
    total: float
    total_error: float
    lens: LensStack
    sensor: float
    field: Floats
    z_object: float
    z_image: float
    wavelength: float

    def __len__(self) -> int:
        return len(self.first)

    @property
    def names(self) -> tuple[str, ...]:
        """Surfaces of each ghost in the order of reflection, such as "9-4" or "sensor-0"."""
        sensor = len(self.lens.elements)
        return tuple(
            f"{'sensor' if j == sensor else j}-{i}"
            for j, i in zip(self.first.tolist(), self.second.tolist(), strict=True)
        )

    def stack(self, k: int) -> LensStack:
        """Unfolded stack of the k-th ghost: the elements in the order of its light, mirror images in between.

        Tracing through it gives the rays of the ghost behind the last element; `pl.plots.plot_lens` draws it.
        """
        row = whole(k, "k", at_least=0, at_most=len(self) - 1)
        pair, n = (int(self.first[row]), int(self.second[row])), len(self.lens.elements)
        lens = reflecting_lens(self.lens, (self.z_image, self.sensor) if pair[0] == n else None)
        return ghost_stack(lens, pair, n - 1, (self.wavelength,))

    def __repr__(self) -> str:
        head = (
            f"<GhostTable: {len(self)} pairs of {self.lens.name!r}, {field_text(self.field, self.z_object)}, "
            f"{self.wavelength:g} nm, {self.total:.3g} of the image light>"
        )
        lines = [f"{'pair':>10} {'energy':>10} {'focus / mm':>11} {'RMS radius / mm':>16}"]
        for k, name in enumerate(self.names[:_SHOWN]):
            lines.append(f"{name:>10} {self.energy[k]:10.2e} {self.focus[k]:11.4g} {self.radius[k]:16.4g}")
        return "\n".join([head, *lines, *(["       ..."] if len(self) > _SHOWN else [])])

    _repr_html_ = picture_of


def find_ghosts(
    lens: LensStack, source: tuple[Sequence[float], float, float | None, float], *, sensor: float | None, rays: int
) -> GhostTable:
    """Ghosts of a lens; `source` are field, z_object, z_image and wavelength of `LensStack.ghosts`."""
    reflectance = None if sensor is None else finite(sensor, "sensor")
    if reflectance is not None and not 0.0 <= reflectance <= 1.0:
        raise InvalidValueError(f"sensor is {reflectance:g}; its reflectance must be from 0 to 1")
    field, z_object, z_image, wavelength = checked_pair(source[0], "field"), source[1], source[2], source[3]
    wavelength = wavelength_in_nm(wavelength)
    point = checked_aim(lens, field, z_object, scene=True)
    plane = image_position(lens, z_object, wavelength) if z_image is None else finite(z_image, "z_image")
    if not math.isfinite(plane):
        raise InvalidValueError(f"the object at z = {z_object:g} mm has its image at infinity; give z_image, in mm")
    whole_lens = reflecting_lens(lens, None if reflectance is None else (plane, reflectance))
    n, each = len(lens.elements), -(-whole(rays, "rays", at_least=1, at_most=MAX_POINTS) // _REPLICATES)
    beam = entering_rays(lens, point, each, wavelength)
    pairs, columns = np.array(pairs_of(whole_lens), dtype=np.int64).reshape(-1, 2), []
    light = [reflecting_lens(lens).trace(beam).weight]
    for first, second in pairs.tolist():
        stack = ghost_stack(whole_lens, (first, second), n - 1, (wavelength,))
        shift = float(stack.vertices[0] - lens.vertices[0])
        out = stack.trace(RayBundle(beam.origin + np.array([0.0, 0.0, shift]), beam.direction, wavelength))
        z_end = float(stack.vertices[-1] - lens.vertices[-1]) + plane
        focus = image_position(stack, z_object + shift, wavelength) - z_end
        light.append(out.weight)
        columns.append((focus, *_centroid_and_radius(out, z_end)))
    total, errors = _relative_light(light)
    energy = total[:-1]
    order = np.argsort(-energy, kind="stable")
    focus, x, y, radius = np.array(columns).reshape(-1, 4)[order].T
    if not total[-1] >= 0:
        warn(f"no light of {field_text(field, z_object)} passes {lens.name or 'the lens'}; choose a smaller field")
    return GhostTable(
        first=pairs[order, 0],
        second=pairs[order, 1],
        energy=energy[order],
        energy_error=errors[:-1][order],
        focus=focus,
        radius=radius,
        centroid=np.column_stack([x, y]),
        total=float(total[-1]),
        total_error=float(errors[-1]),
        lens=lens,
        sensor=reflectance or 0.0,
        wavelength=wavelength,
        field=field,
        z_object=z_object,
        z_image=plane,
    )


def _relative_light(light: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Light of each ghost and of all over that of the image, the first row, with standard errors; nan without image.

    The error of a ratio of sums: W. G. Cochran, Sampling Techniques, 3rd ed. (Wiley, 1977), section 2.11.
    """
    image, *ghosts = (
        np.sum(rays.reshape(_REPLICATES, -1), axis=1) for rays in (*light, sum(light[1:], 0.0 * light[0]))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.sum(ghosts, axis=1) / image.sum()
        residuals = ghosts - relative[:, None] * image
        return relative, np.sqrt(_REPLICATES / (_REPLICATES - 1) * np.square(residuals).sum(axis=1)) / image.sum()


def _centroid_and_radius(rays: RayBundle, z: float) -> tuple[float, float, float]:
    """x, y and RMS radius in mm of the light of a bundle in a plane; nan without light."""
    bright = rays.weight > 0
    if not bright.any():
        return math.nan, math.nan, math.nan
    points, weight = rays.selected(bright).at_z(z)[:, :2], rays.weight[bright] / rays.weight.sum()
    x, y = centre = weight @ points
    return float(x), float(y), math.sqrt(float(weight @ np.square(points - centre).sum(axis=1)))


def entering_rays(lens: LensStack, point: Floats, each: int, wavelength: float) -> RayBundle:
    """Rays from a point of `checked_aim` that cover the first element: _REPLICATES times `each`, of equal light.

    Those of an object at infinity are uniform across the beam, those of a finite one over its direction cosines.
    """
    vertex = np.array([0.0, 0.0, float(lens.vertices[0])])
    uniform = np.concatenate([sobol_points(each, replicate=k)[:, :2] for k in range(_REPLICATES)])
    rim = _first_element_points(lens) + vertex
    if point.size == 3:
        cosines = (rim - point) / np.linalg.norm(rim - point, axis=1, keepdims=True)
        across = _over_box(uniform, cosines[:, :2])
        forward = np.sqrt(np.maximum(1.0 - np.square(across).sum(axis=1, keepdims=True), 0.0))
        return RayBundle(np.broadcast_to(point, (len(across), 3)), np.hstack([across, forward]), wavelength)
    direction = -directions_of(point[None], -1.0)[0]
    axes = np.linalg.svd(direction[None])[2][1:]  # two unit vectors across the beam
    return RayBundle(
        vertex + _over_box(uniform, (rim - vertex) @ axes.T) @ axes, np.tile(direction, (len(uniform), 1)), wavelength
    )


def _over_box(uniform: Floats, points: Floats) -> Floats:
    """Map points of the unit square to the bounding box of points (n, 2)."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.asarray(low + (high - low) * uniform)


def _first_element_points(lens: LensStack) -> Floats:
    """Points (n, 3) on the first element, relative to its nominal vertex, mm."""
    first, angle = lens.elements[0], 2.0 * np.pi * np.arange(_ANGLES) / _ANGLES
    r = first.semi_diameter * np.linspace(0.0, 1.0, _RINGS)[:, None]
    x, y = (r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()
    z = first.sag(x, y) if isinstance(first, Surface) else np.zeros_like(x)
    return to_lens_axes(first.placement, np.column_stack([x, y, z]))
