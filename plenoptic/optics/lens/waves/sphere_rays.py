"""Rays of an object point through points of the iris, to the reference sphere around its image."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.optical_path import paths_of_part
from plenoptic.optics.lens.pupil.beam import ImagedPoint
from plenoptic.optics.lens.stack import LensStack

_STEP = 1e-4
"""Spacing of neighbouring rays for difference quotients, in units of the iris's semi-diameter."""


class SphereRays(NamedTuple):
    """Intersections with the reference sphere of rays from one object point through points of the iris; nan if lost."""

    opd: Floats
    """(n,), waves."""
    light: Floats
    """(n,): relative light per unit area of the iris."""
    solid_angle: Floats
    """(n,): solid angle per unit area of the iris, seen from the image point."""
    toward: Floats
    """(n, 3): unit vectors from the image point."""
    slopes: Floats
    """(n, 2, 2): Jacobian of x and y of `toward` by x and y of the iris."""
    middle: Floats
    """(3,): `toward` of the chief ray."""
    image: Floats
    radius: float
    refractive_index: float


def rays_to_sphere(lens: LensStack, point: ImagedPoint, wavelength: float, pupil: Floats) -> SphereRays:
    """Trace rays through points (n, 2) of the iris, each with two neighbours, to the reference sphere."""
    n, steps = len(pupil), _STEP * np.eye(2)
    points = np.concatenate([pupil, pupil + steps[0], pupil + steps[1], np.zeros((1, 2))])
    entering = point.rays(lens, points, wavelength)
    # Solid angles need the neighbours of a ray even if they are vignetted, and path differences need the chief ray even
    # if the centre of the iris is obscured.
    behind, path = paths_of_part(lens, entering, 0, len(lens.elements) - 1, clipping=False)
    if behind.status[-1] != 0:
        raise InvalidValueError(f"there is no chief ray from the field {point.field}; give a smaller field")
    chief = behind.selected(np.arange(len(points)) == 3 * n)
    image, index = chief.at_z(point.z_image)[0], float(lens.indices(wavelength)[-1])
    exit_pupil = cardinal_points(lens, wavelength).exit_pupil
    radius = math.inf if math.isinf(exit_pupil) else float((image[2] - exit_pupil) / chief.direction[0, 2])
    lengths, toward = to_sphere(behind, path, image, radius, index)
    passing = lens.trace(entering.selected(np.arange(len(points)) < n))
    finite_object = math.isfinite(point.z_object)
    light = _area(entering.direction if finite_object else entering.origin, n)
    if finite_object:
        light = light * np.abs(entering.direction[:n, 2])
    xy = toward[: 3 * n, :2].reshape(3, n, 2)
    return SphereRays(
        opd=np.where(passing.status == 0, (lengths[-1] - lengths[:n]) / (1e-6 * wavelength), np.nan),
        light=light * passing.weight,
        solid_angle=_area(toward, n),
        toward=toward[:n],
        slopes=np.stack([xy[1] - xy[0], xy[2] - xy[0]], axis=2) / _STEP,
        middle=toward[-1],
        image=image,
        radius=radius,
        refractive_index=index,
    )


def _area(vectors: Floats, n: int) -> Floats:
    """(n,): areas spanned by vectors (3 n, 3) of iris points and their two neighbours, over the squared step."""
    one, right, up = vectors[:n], vectors[n : 2 * n], vectors[2 * n : 3 * n]
    return np.asarray(np.linalg.norm(np.cross(right - one, up - one), axis=1)) / _STEP**2


def to_sphere(behind: RayBundle, path: Floats, image: Floats, radius: float, index: float) -> tuple[Floats, Floats]:
    """Optical paths (n,) to a sphere around an image point, relative to a ray through that point, and their end points.

    `path` are the optical paths to the origins of `behind`; the end points are unit vectors (n, 3) from the image.
    """
    away = behind.origin - image
    along = (away * behind.direction).sum(axis=1)
    across = away - along[:, None] * behind.direction
    h2 = (across**2).sum(axis=1)
    if math.isinf(radius):
        return path - index * along, -behind.direction
    with np.errstate(invalid="ignore"):
        more = h2 / (radius + math.copysign(1.0, radius) * np.sqrt(radius**2 - h2))
    return path - index * (along - more), (across - (radius - more)[:, None] * behind.direction) / radius
