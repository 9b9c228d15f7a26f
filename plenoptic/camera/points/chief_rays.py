"""Slopes of the chief rays of microlenses, which come from the centre of the exit pupil."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import chebyshev

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.core.values import Floats
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays_reverse

_RADII, _DEGREE = 48, 14
"""Traced fields of a centred lens, and degree of the polynomial in the squared radius that is fitted to them."""
_SIDE = 13
"""Traced fields along x and along y without rotational symmetry."""


def aimed_slopes(axes: ArrayAxes, points: Floats) -> Floats:
    """Aim reverse rays from points (n, 2) of the array at the iris's centre; return slopes dx/dz, dy/dz (n, 2).

    nan if no ray passes. Points and slopes are in local axes, see `array_axes`.
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
    """Slopes (n, 2) of chief rays at many points (n, 2): aimed at some fields, interpolated between them.

    With rotational symmetry, slope over radius is a polynomial of degree 14 in the squared radius, fitted to 48 fields
    up to the largest radius; otherwise slopes are polynomials of degree 12 in x and in y, through 13 x 13 fields. Up to
    that number of points, each one is aimed. nan beyond the first field without a chief ray.
    """
    if len(points) <= (_RADII if axes.lens_is_round else _SIDE * _SIDE):
        return aimed_slopes(axes, points)
    return _interpolate_radial(axes, points) if axes.lens_is_round else _interpolate_grid(axes, points)


def _interpolate_radial(axes: ArrayAxes, points: Floats) -> Floats:
    radius = np.hypot(points[:, 0], points[:, 1])
    largest = float(radius.max())
    # Chebyshev nodes in the radius; none is 0, at which slope over radius is a limit.
    traced = largest * np.cos(math.pi * (np.arange(_RADII) + 0.5) / (2 * _RADII))[::-1]
    slopes = aimed_slopes(axes, np.stack([traced, np.zeros(_RADII)], axis=1))[:, 0]
    is_valid = np.isfinite(slopes)
    n_valid = _RADII if is_valid.all() else int(np.argmin(is_valid))
    if n_valid == 0:
        return np.full(points.shape, np.nan)
    valid_radius = float(traced[n_valid - 1]) if n_valid < _RADII else largest
    knots = 2 * (traced[:n_valid] / valid_radius) ** 2 - 1
    series = chebyshev.chebfit(knots, slopes[:n_valid] / traced[:n_valid], min(_DEGREE, n_valid - 1))
    slope_over_radius = chebyshev.chebval(2 * np.minimum(radius / valid_radius, 1.0) ** 2 - 1, series)
    return np.asarray(np.where(radius <= valid_radius, slope_over_radius, np.nan)[:, None] * points)


def _interpolate_grid(axes: ArrayAxes, points: Floats) -> Floats:
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
    knots = np.cos(math.pi * (np.arange(_SIDE) + 0.5) / _SIDE)
    grid = np.stack(np.meshgrid(knots, knots, indexing="ij"), axis=-1).reshape(-1, 2)
    slopes = aimed_slopes(axes, middle + half * grid)
    if not np.isfinite(slopes).all():
        # With conditions missing, the polynomial would oscillate at the edge of the field.
        return aimed_slopes(axes, points)
    degrees = [_SIDE - 1, _SIDE - 1]
    series = np.linalg.solve(chebyshev.chebvander2d(grid[:, 0], grid[:, 1], degrees), slopes)
    normalised = (points - middle) / half
    return np.asarray(chebyshev.chebvander2d(normalised[:, 0], normalised[:, 1], degrees) @ series)
