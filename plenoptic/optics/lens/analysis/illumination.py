"""Field, vignetting and illumination of the image.

Fields are those of `field_aberrations`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.display import picture_of
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, check_kind, number, result, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.field_aberrations import checked_fields, chief_rays, image_plane, trace_past_rims
from plenoptic.optics.lens.elements import with_round_stops
from plenoptic.optics.lens.modify import coated
from plenoptic.optics.lens.pupil.iris_points import INSIDE, MOST_ACROSS, hexapolar, outermost_finite
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays, aimed_rays_reverse
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_part

_ZOOMS, _ZOOM = 3, 129
"""Points of each of 3 nested searches for a limit: 128 intervals each, so the result is good to 1 in 2 million."""

_COARSE = 48
_AROUND = 0.15
"""Cells along a side of the coarse grid over the rays to an image point; margin of that grid around the iris, over the
width of the iris."""

_COUNTING = math.sqrt(0.0724 * 4.0)
"""The number N of points of a square grid that lie in an area has the variance 0.0724 b sqrt(N), with b the outline
over the root of the area: 3.5 for a circle, about 4 for a vignetted pupil (H. J. G. Gundersen and E. B. Jensen, J.
Microsc. 147, 229, 1987). So its relative standard error is this over N^(3/4)."""


def largest_field(lens: LensStack, *, z_object: float = -math.inf, wavelength: float = 587.6) -> float:
    """Largest field whose chief ray passes all rims.

    A fan of rays is traced from the centre of the iris in both directions, up to the first ray that a rim clips. Masks
    and rings are replaced by the circles around them.

    Parameters
    ----------
    lens : LensStack
        Taken as LensModel.EXACT.
    z_object, wavelength
        See `distortion`.

    Returns
    -------
    float
        Half angle in rad, or height in mm in the plane z_object. The design field is mostly smaller.

    Examples
    --------
    >>> import math, plenoptic as pl
    >>> round(math.degrees(pl.aberrations.largest_field(pl.load_lens("fisheye-100mm-f8"))), 1)
    91.5
    """
    check_kind(lens, "lens", LensStack, "camera.lens")
    z_object = number(z_object, "z_object")
    iris, last = lens.iris_index, len(lens.elements) - 1
    lens = dataclasses.replace(lens, elements=with_round_stops(lens.elements))
    low, high, field = 0.0, math.radians(89.9), 0.0
    centre = np.zeros(3) if lens.stop.placement is None else lens.stop.placement.shift
    for _ in range(_ZOOMS):
        angle = np.linspace(low, high, _ZOOM)
        along = np.column_stack([np.zeros(_ZOOM), np.sin(angle), -np.cos(angle)])
        rays = RayBundle(np.broadcast_to(centre, along.shape), along, wavelength)
        front = trace_part(lens, rays, 0, iris - 1, reverse=True) if iris > 0 else rays
        back = RayBundle(rays.origin, -along, wavelength)
        rear = trace_part(lens, back, iris + 1, last) if iris < last else back
        stopped = np.flatnonzero((front.status != 0) | (rear.status != 0))
        beyond = int(stopped[0]) if stopped.size else _ZOOM
        if beyond == 0:
            break
        field = _field_of(front.selected([beyond - 1]), z_object)
        if beyond == _ZOOM:
            break
        low, high = angle[beyond - 1], angle[beyond]
    return field


def _field_of(ray: RayBundle, z_object: float) -> float:
    """Field of a ray that was traced towards the scene."""
    if z_object != -math.inf:
        return abs(float(ray.at_z(z_object)[0, 1]))
    _, m, n = ray.direction[0].tolist()
    return math.atan2(abs(m), -n)


@result
class Vignetting:
    """Filled part of the iris. Made by `vignetting`.

    Attributes
    ----------
    fields, z_object
        As in `Distortion`.
    fraction : (n,) array
        Fraction of the light through the iris that also passes all rims and stops: of its area, except for grey masks.
    standard_error : (n,) array
        Standard error of `fraction`, from the number of grid points.
    lower, upper : (n,) array
        Lower and upper rim ray: smallest and largest y of unvignetted rays on the diameter of the iris along y, in
        units of its semi-diameter; nan if all are vignetted.
    """

    fields: Floats
    fraction: Floats
    standard_error: Floats
    lower: Floats
    upper: Floats
    z_object: float

    _repr_html_ = picture_of


def vignetting(
    lens: LensStack, fields: ArrayLike, *, z_object: float = -math.inf, wavelength: float = 587.6, grid: int = 64
) -> Vignetting:
    """Vignetting: fraction of the iris filled by light that passes all rims.

    Parameters
    ----------
    lens, fields, z_object, wavelength
        See `distortion`.
    grid : int, optional
        Points across the iris.

    Raises
    ------
    InvalidValueError
        If a field is out of range, the object is not before the lens, or the grid is too coarse for the iris.

    Examples
    --------
    >>> import plenoptic as pl
    >>> vignetting = pl.aberrations.vignetting(pl.load_lens("double-gauss-100mm-f2"), [0.0, 0.2, 0.35])
    >>> vignetting.fraction.round(2).tolist()
    [0.99, 0.68, 0.36]
    """
    radii, lens = checked_fields(lens, fields, z_object), coated(lens, None)
    stop = lens.stop
    side = whole(grid, "grid", at_least=2, at_most=MOST_ACROSS)
    # Off the centre, so that a symmetric aperture has no symmetric grid.
    x, y = (-1.0 + 2.0 / side * (np.arange(side) + 0.5 + offset) for offset in (-0.13, 0.29))
    pupil = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pupil = pupil[stop.contains(*(stop.semi_diameter * pupil.T))]
    if not len(pupil):
        raise InvalidValueError(f"grid is {side}; none of its points falls into the opening of the iris: increase it")
    cell_share, full = 4.0 / side**2 * stop.semi_diameter**2 / stop.area, np.ones(len(pupil))
    if stop.row().cells is not None:
        full = stop.transmission_at(*(stop.semi_diameter * pupil.T))
        cell_share = 1.0 / float(full.sum())

    fraction, error, lower, upper = np.empty((4, len(radii)))
    for i, field in enumerate(radii.tolist()):

        def passing(points: Floats, field: float = field) -> Floats:
            rays = aimed_rays(lens, field=(0.0, field), pupil=points, z_object=z_object, wavelength=wavelength)
            return lens.trace(rays).weight

        def on_diameter(y: Floats, passing: Callable[[Floats], Floats] = passing) -> Floats:
            return np.where(passing(np.column_stack([np.zeros_like(y), y])) > 0, 0.0, np.nan)

        light = passing(pupil)
        count = int(np.count_nonzero(light))
        # If all points pass, the fraction is exactly 1. If none passes, the light may be that of less than one point.
        entire = bool(np.all(light == full))
        fraction[i] = 1.0 if entire else min(float(light.sum()) * cell_share, 1.0)
        error[i] = 0.0 if entire else cell_share * _COUNTING * max(count, 1) ** 0.25
        lower[i], upper[i] = (outermost_finite(on_diameter, end, _ZOOM)[0] / INSIDE for end in (-INSIDE, INSIDE))
    return Vignetting(radii, fraction, error, lower, upper, z_object)


@result
class RelativeIllumination:
    """Illumination of the image plane by a scene of uniform radiance. Made by `relative_illumination`.

    Attributes
    ----------
    fields, z_image, z_object
        As in `Distortion`.
    heights : (n,) array
        y in mm of the image points, the intersections of the chief rays with the image plane.
    projected_solid_angle : (n,) array
        Projected solid angle in sr of all rays from the scene to the image point. Times (n' / n)^2, with the indices
        behind the lens and in front, it is the irradiance at radiance 1 and the value of the white image.
    relative : (n,) array
        Projected solid angle relative to that on the axis; nan if the axis is dark.
    standard_error : (n,) array
        Standard error of `relative`, from the number of grid points.
    """

    fields: Floats
    heights: Floats
    projected_solid_angle: Floats
    relative: Floats
    standard_error: Floats
    z_image: float
    z_object: float

    _repr_html_ = picture_of


def relative_illumination(
    lens: LensStack, fields: ArrayLike, *, z_object: float = -math.inf, wavelength: float = 587.6, grid: int = 160
) -> RelativeIllumination:
    """Irradiance of the image plane relative to the axis, for a scene of uniform radiance.

    The rays from the scene to an image point are counted on a uniform grid of the direction cosines l and m. Its area
    is the projected solid angle: E = L integral dl dm. The image plane is the paraxial image of z_object.

    Parameters
    ----------
    lens, fields, z_object, wavelength
        See `distortion`.
    grid : int, optional
        Cells of the grid across the unvignetted light.

    Returns
    -------
    RelativeIllumination
        0 for a field without a chief ray.

    Raises
    ------
    InvalidValueError
        If the image plane does not lie behind the lens.

    Examples
    --------
    >>> import plenoptic as pl
    >>> illumination = pl.aberrations.relative_illumination(pl.load_lens("double-gauss-100mm-f2"), [0.0, 0.2, 0.35])
    >>> illumination.relative.round(2).tolist()
    [1.0, 0.65, 0.29]
    """
    radii, cells = checked_fields(lens, fields, z_object), whole(grid, "grid", at_least=8, at_most=MOST_ACROSS)
    z_image = image_plane(lens, z_object, wavelength)
    with_axis = np.concatenate([[0.0], radii])
    points = trace_past_rims(lens, chief_rays(lens, with_axis, z_object, wavelength)).at_z(z_image)
    areas = np.array([_projected_solid_angle(lens, point, cells, wavelength) for point in points])
    (on_axis, axis_error), (area, error) = areas[0], areas[1:].T
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = area / on_axis
    combined = relative * np.hypot(error, axis_error)
    return RelativeIllumination(
        radii, points[1:, 1], area, relative, np.where(radii == 0, 0.0, combined), z_image, z_object
    )


def _projected_solid_angle(lens: LensStack, point: Floats, cells: int, wavelength: float) -> tuple[float, float]:
    """Projected solid angle of the light at an image point (3,), in sr, and its relative standard error."""
    light = _light_at(lens, point, cells, wavelength)
    if light is None:
        return 0.0, 0.0
    _, out, area = light
    return float(out.weight.sum()) * area, _COUNTING / np.count_nonzero(out.status == 0) ** 0.75


def light_directions(lens: LensStack, point: Floats, cells: int, wavelength: float) -> RayBundle | None:
    """Rays from an image point (3,) that pass the lens towards the scene, uniform over l and m; None if it is dark."""
    light = _light_at(lens, point, cells, wavelength)
    return None if light is None else light[0].selected(light[1].status == 0)


def _light_at(
    lens: LensStack, point: Floats, cells: int, wavelength: float
) -> tuple[RayBundle, RayBundle, float] | None:
    """Rays from an image point on a grid around those that pass the lens, behind the lens, and their area dl dm."""
    if not np.isfinite(point).all():
        return None
    aimed = aimed_rays_reverse(
        lens, image_point=point[:2], z_image=float(point[2]), pupil=hexapolar(4), wavelength=wavelength
    )
    low, high = np.array([-1.0, -1.0]), np.array([1.0, 1.0])
    if (aimed.status == 0).any():
        iris = aimed.direction[aimed.status == 0, :2]
        margin = _AROUND * np.ptp(iris, axis=0)
        low, high = iris.min(axis=0) - margin, iris.max(axis=0) + margin
    for n in (_COARSE, cells):
        # Off the centre, so that a symmetric outline has no symmetric grid.
        offsets = np.add.outer([0.5 - 0.13, 0.5 + 0.29], np.arange(n)) / n
        l, m = (axis.ravel() for axis in np.meshgrid(*(low[:, None] + (high - low)[:, None] * offsets)))
        real = l * l + m * m < 1
        cosines = np.column_stack([l, m, -np.sqrt(np.maximum(1.0 - l * l - m * m, 0.0))])[real]
        rays = RayBundle(np.broadcast_to(point, cosines.shape), cosines, wavelength)
        out = lens.trace_reverse(rays)
        passed, step = cosines[out.status == 0, :2], (high - low) / n
        if len(passed) == 0:
            return None
        low, high = passed.min(axis=0) - step, passed.max(axis=0) + step
    return rays, out, float(step[0] * step[1])
