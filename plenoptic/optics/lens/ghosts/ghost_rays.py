"""Rays that cover an element of a lens, for the light of ghosts, and sums of that light with their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, finite, number, wavelength_in_nm
from plenoptic.errors import InvalidValueError
from plenoptic.optics.coatings.surface_powers import checked_reflectance
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.gaussian.paraxial import image_position
from plenoptic.optics.lens.placement import to_lens_axes
from plenoptic.optics.lens.pupil.object_point import checked_pair, directions_of
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

REPLICATES = 32
"""Independent scramblings of the rays, whose differences give the errors."""

_RINGS, _ANGLES = 5, 32
_MARGIN = 0.01
"""Points on an element whose bounding box, widened by the margin, holds the rays to it."""

Source = tuple[Sequence[float], float, float | None, float]
"""field, z_object, z_image and wavelength of `LensStack.ghosts`."""


class GhostSetting(NamedTuple):
    """Checked arguments of `LensStack.ghosts`."""

    field: Floats
    z_object: float
    z_image: float
    wavelength: float
    sensor: float | None


def ghost_setting(lens: LensStack, source: Source, sensor: float | None) -> GhostSetting:
    """Checked arguments; z_image is that of the paraxial image unless given."""
    reflectance = None if sensor is None else checked_reflectance(sensor, "sensor")
    field, z_object, z_image, nm = source
    z, wavelength = number(z_object, "z_object"), wavelength_in_nm(nm)
    plane = image_position(lens, z, wavelength) if z_image is None else finite(z_image, "z_image")
    if not math.isfinite(plane):
        raise InvalidValueError(f"the object at z = {z:g} mm has its image at infinity; give z_image, in mm")
    return GhostSetting(checked_pair(field, "field"), z, plane, wavelength, reflectance)


def check_light(lens: LensStack, rays: RayBundle) -> None:
    """Raise an error if rays pass a lens whose surfaces transmit nothing: ghosts are relative to the image light."""
    passing = rays.status == 0
    if passing.any() and not rays.weight[passing].any():
        raise InvalidValueError(
            f"the surfaces of {lens.name or 'the lens'} transmit no light at {rays.wavelength:g} nm, and there is no "
            "image to which ghosts could be compared; give coatings whose reflectance is below 1"
        )


def covering_rays(element: Element, z: float, point: Floats, uniform: Floats, wavelength: float) -> RayBundle:
    """Rays of equal light from a point of `checked_aim` that cover an element with its vertex at z mm in the lens.

    `uniform` are points (n, 2) of the unit square. Rays of a point at infinity in front of the lens are uniform across
    the beam, those of another point uniform over its direction cosines.
    """
    vertex = np.array([0.0, 0.0, z])
    rim = points_on(element) + vertex
    if point.size == 3:
        cosines = (rim - point) / np.linalg.norm(rim - point, axis=1, keepdims=True)
        across = _over_box(uniform, cosines[:, :2])
        with np.errstate(invalid="ignore"):  # l^2 + m^2 > 1 gives nan, a ray that no lens passes
            along = np.sqrt(1.0 - np.square(across).sum(axis=1, keepdims=True))
        direction = np.hstack([across, math.copysign(1.0, z - point[2]) * along])
        return RayBundle(np.broadcast_to(point, direction.shape), direction, wavelength)
    direction = -directions_of(point[None], -1.0)[0]
    axes = np.linalg.svd(direction[None])[2][1:]  # two unit vectors across the beam
    origin = vertex + _over_box(uniform, (rim - vertex) @ axes.T) @ axes
    return RayBundle(origin, np.broadcast_to(direction, origin.shape), wavelength)


def _over_box(uniform: Floats, points: Floats) -> Floats:
    """Map points of the unit square to the bounding box of points (n, 2), widened by the margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.asarray(low + (high - low) * (uniform + _MARGIN * (2.0 * uniform - 1.0)))


def points_on(element: Element) -> Floats:
    """Points (n, 3) on an element, relative to its nominal vertex, mm."""
    angle = 2.0 * np.pi * np.arange(_ANGLES) / _ANGLES
    r = element.semi_diameter * np.linspace(0.0, 1.0, _RINGS)[:, None]
    x, y = (r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()
    z = element.sag(x, y) if isinstance(element, Surface) else np.zeros_like(x)
    return to_lens_axes(element.placement, np.column_stack([x, y, z]))


def relative_light(light: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Sums of the light (n,) of rays over that of the first row, with standard errors; nan if that is dark.

    The error of a ratio of sums: W. G. Cochran, Sampling Techniques, 3rd ed. (Wiley, 1977), section 2.11.
    """
    reference, *parts = (np.sum(rays.reshape(REPLICATES, -1), axis=1) for rays in light)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.sum(parts, axis=1) / reference.sum()
        residuals = parts - relative[:, None] * reference
        variance = REPLICATES / (REPLICATES - 1) * np.square(residuals).sum(axis=1)
        return relative, np.sqrt(variance) / reference.sum()
