"""Chief rays of microlenses: the slope at which the light of the middle of the exit pupil reaches each of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import chebyshev

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.core.values import Floats
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays_reverse

_RADII, _DEGREE = 48, 14
"""Traced fields of a centred lens, and degree of the polynomial in the squared radius that is put through them."""
_SIDE = 13
"""Traced fields along x and along y where the field is not round."""


def aimed_slopes(axes: ArrayAxes, points: Floats) -> Floats:
    """Slopes dx/dz, dy/dz (n, 2) of the reverse rays from points (n, 2) of the array through the iris's centre.

    Each is found by aiming; nan where no ray passes. Points and slopes are in local axes, see `array_axes`.
    """
    camera = axes.camera
    direction = np.full((len(points), 3), np.nan)
    for k, (x, y, z) in enumerate(axes.in_lens(points).tolist()):
        ray = aimed_rays_reverse(
            camera.lens, image_point=(x, y), z_image=z, pupil=np.zeros((1, 2)), wavelength=camera.wavelength
        )
        if ray.status[0] == 0:
            direction[k] = ray.direction[0]
    return axes.slopes_of(direction)


def chief_slopes(axes: ArrayAxes, points: Floats) -> Floats:
    """The same for many points: aimed at some fields, interpolated between them.

    Where the field is round, slope over radius is a polynomial of degree 14 in the squared radius, fitted to 48 fields
    up to the largest radius; otherwise slopes are polynomials of degree 12 in x and in y, through 13 x 13 fields. Up to
    that number of points each is aimed at. Beyond a field without a chief ray there is none: nan.
    """
    if len(points) <= (_RADII if axes.lens_is_round else _SIDE * _SIDE):
        return aimed_slopes(axes, points)
    return _round_slopes(axes, points) if axes.lens_is_round else _any_slopes(axes, points)


def _round_slopes(axes: ArrayAxes, points: Floats) -> Floats:
    radius = np.hypot(points[:, 0], points[:, 1])
    largest = float(radius.max())
    # Chebyshev nodes in the radius; none is 0, where slope over radius is a limit.
    traced = largest * np.cos(math.pi * (np.arange(_RADII) + 0.5) / (2 * _RADII))[::-1]
    slopes = aimed_slopes(axes, np.stack([traced, np.zeros(_RADII)], axis=1))[:, 0]
    finite = np.isfinite(slopes)
    reached = _RADII if finite.all() else int(np.argmin(finite))
    if reached == 0:
        return np.full(points.shape, np.nan)
    end = float(traced[reached - 1]) if reached < _RADII else largest
    knots = 2 * (traced[:reached] / end) ** 2 - 1
    series = chebyshev.chebfit(knots, slopes[:reached] / traced[:reached], min(_DEGREE, reached - 1))
    slope = chebyshev.chebval(2 * np.minimum(radius / end, 1.0) ** 2 - 1, series)
    return np.asarray(np.where(radius <= end, slope, np.nan)[:, None] * points)


def _any_slopes(axes: ArrayAxes, points: Floats) -> Floats:
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
    knots = np.cos(math.pi * (np.arange(_SIDE) + 0.5) / _SIDE)
    grid = np.stack(np.meshgrid(knots, knots, indexing="ij"), axis=-1).reshape(-1, 2)
    slopes = aimed_slopes(axes, middle + half * grid)
    if not np.isfinite(slopes).all():
        # Without all its conditions the polynomial would run wild where chief rays end.
        return aimed_slopes(axes, points)
    degrees = [_SIDE - 1, _SIDE - 1]
    series = np.linalg.solve(chebyshev.chebvander2d(grid[:, 0], grid[:, 1], degrees), slopes)
    place = (points - middle) / half
    return np.asarray(chebyshev.chebvander2d(place[:, 0], place[:, 1], degrees) @ series)
