"""Table of the ghosts of a lens: energy, focus and size of the light reflected at each pair of surfaces."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.rays import RayBundle
from plenoptic.core.sampling import sobol_points
from plenoptic.core.values import MAX_POINTS, Floats, result, whole
from plenoptic.core.warn import warn
from plenoptic.optics.lens.gaussian.paraxial import image_position
from plenoptic.optics.lens.ghosts.ghost_rays import (
    REPLICATES,
    Source,
    check_light,
    covering_rays,
    ghost_setting,
    relative_light,
)
from plenoptic.optics.lens.ghosts.unfolded import ghost_stack, pairs_of, reflecting_lens
from plenoptic.optics.lens.pupil.object_point import checked_aim, field_text

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

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
      sensor-2   1.26e-02      -193.4            17.48
      sensor-1   1.16e-02      -79.47            41.28
           2-1   1.78e-03      -85.59            67.05
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


def find_ghosts(lens: LensStack, source: Source, *, sensor: float | None, rays: int) -> GhostTable:
    """Ghosts of a lens; `source` are field, z_object, z_image and wavelength of `LensStack.ghosts`."""
    field, z_object, plane, wavelength, reflectance = ghost_setting(lens, source, sensor)
    point = checked_aim(lens, field, z_object, scene=True)
    whole_lens = reflecting_lens(lens, None if reflectance is None else (plane, reflectance))
    n, each = len(lens.elements), -(-whole(rays, "rays", at_least=1, at_most=MAX_POINTS) // REPLICATES)
    uniform = np.concatenate([sobol_points(each, replicate=k)[:, :2] for k in range(REPLICATES)])
    beam = covering_rays(lens.elements[0], float(lens.vertices[0]), point, uniform, wavelength)
    pairs, columns = np.array(pairs_of(whole_lens), dtype=np.int64).reshape(-1, 2), []
    image = reflecting_lens(lens).trace(beam)
    check_light(lens, image)
    light = [image.weight]
    for first, second in pairs.tolist():
        stack = ghost_stack(whole_lens, (first, second), n - 1, (wavelength,))
        shift = float(stack.vertices[0] - lens.vertices[0])
        out = stack.trace(RayBundle(beam.origin + np.array([0.0, 0.0, shift]), beam.direction, wavelength))
        z_end = float(stack.vertices[-1] - lens.vertices[-1]) + plane
        focus = image_position(stack, z_object + shift, wavelength) - z_end
        light.append(out.weight)
        columns.append((focus, *_centroid_and_radius(out, z_end)))
    total, errors = relative_light([*light, sum(light[1:], 0.0 * light[0])])
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


def _centroid_and_radius(rays: RayBundle, z: float) -> tuple[float, float, float]:
    """x, y and RMS radius in mm of the light of a bundle in a plane; nan without light."""
    bright = rays.weight > 0
    if not bright.any():
        return math.nan, math.nan, math.nan
    points, weight = rays.selected(bright).at_z(z)[:, :2], rays.weight[bright] / rays.weight.sum()
    x, y = centre = weight @ points
    return float(x), float(y), math.sqrt(float(weight @ np.square(points - centre).sum(axis=1)))
