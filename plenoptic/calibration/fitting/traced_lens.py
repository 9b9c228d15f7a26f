"""Main lens of a prescription, scaled to a focal length: chief rays by tracing, and their derivatives.

All axes are those of `geometry`: positions behind the lens count from its rear principal plane, and those in front
from the front one, both in mm of the scaled lens.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays_reverse
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_part

_STEP = 1e-5
"""Step of differences: their error, and that of rounding over the step, is below 1e-5."""
_FIELDS, _DEGREE = 12, 4
_ITERATIONS = 6
"""Each iteration decreases the error of the pupil's position by the ratio of its aberration and its distance."""


class TracedLens(NamedTuple):
    """Prescription, its cardinal points in mm as designed, and its exit pupil."""

    lens: LensStack
    focal_length: float
    front_principal: float
    rear_principal: float
    pupil: Polynomial
    """Distance of the exit pupil in front of the rear principal plane over the focal length, by the squared slope of
    the chief ray."""


class Sources(NamedTuple):
    """Points (n, 3) in the rear principal plane through which light reaches microlenses, and derivatives."""

    source: Floats
    by_point: Floats
    """(n, 3, 3)"""
    by_focal_length: Floats
    """(n, 3)"""
    by_centre: Floats
    """(n, 3, 3) by the centres of the microlenses."""

    @property
    def passes(self) -> NDArray[np.bool_]:
        """True for rays that the lens passes; the others have nan."""
        finite = np.isfinite(np.concatenate([self.by_point, self.by_centre], axis=1))
        return np.asarray(finite.all(axis=(1, 2)))


class RayHits(NamedTuple):
    """Distances (n, 2) in mm of rays from points of the scene, in the points' planes, and derivatives."""

    miss: Floats
    by_point: Floats
    """(n, 2, 3)"""
    by_focal_length: Floats
    """(n, 2)"""
    by_centre: Floats
    """(n, 2, 3)"""
    by_slope: Floats
    """(n, 2, 2)"""

    @property
    def passes(self) -> NDArray[np.bool_]:
        """True for rays that the lens passes; the others have nan."""
        return np.asarray(np.isfinite(np.concatenate([self.by_centre, self.by_slope], axis=2)).all(axis=(1, 2)))


def trace_lens(lens: LensStack, lens_to_array: float, slope: float) -> TracedLens:
    """Lens to be traced, for chief rays up to a slope; the distance to the array is in focal lengths."""
    points = cardinal_points(lens)
    if not 0 < points.efl < np.inf:
        raise InvalidValueError(f"lens has the focal length {points.efl:g} mm; a main lens needs a positive one")
    z = points.rear_principal + lens_to_array * points.efl
    heights = slope * (z - points.exit_pupil) * np.sin(0.5 * np.pi * (np.arange(_FIELDS) + 1) / _FIELDS)
    bundles = [aimed_rays_reverse(lens, image_point=(h, 0.0), z_image=z, pupil=[[0.0, 0.0]]) for h in heights.tolist()]
    slopes = np.array([rays.direction[0, 0] / rays.direction[0, 2] for rays in bundles])
    valid = np.isfinite(slopes)
    if valid.sum() <= _DEGREE:
        raise InvalidValueError(
            f"lens {lens.name!r} has no chief rays over the field of the micro images, up to {heights[-1]:.3g} mm off "
            "its axis; give one of a larger field"
        )
    distance = (points.rear_principal - z + heights[valid] / slopes[valid]) / points.efl
    pupil = Polynomial.fit(slopes[valid] ** 2, distance, _DEGREE).convert()
    return TracedLens(lens, points.efl, points.front_principal, points.rear_principal, pupil)


def exit_pupils(lens: TracedLens, focal_length: float, centre: Floats) -> tuple[Floats, Floats, Floats]:
    """Distance (n,) of the exit pupil in front of the rear principal plane, seen from points (n, 3) behind the lens.

    With its derivatives by the points (n, 3) and by the focal length (n,).
    """
    radius, distance = np.hypot(centre[:, 0], centre[:, 1]), np.zeros(len(centre))
    for _ in range(_ITERATIONS):
        slope = radius / (centre[:, 2] + distance)
        distance = focal_length * lens.pupil(slope**2)
    by_slope = 2.0 * focal_length * slope * lens.pupil.deriv()(slope**2) / (centre[:, 2] + distance)
    # The slope depends on the pupil in turn.
    implicit = 1.0 + by_slope * slope
    outwards = centre[:, :2] / np.maximum(radius, 1e-300)[:, None]
    by_centre = (by_slope / implicit)[:, None] * np.column_stack([outwards, -slope])
    return distance, by_centre, distance / (focal_length * implicit)


def trace_sources(lens: TracedLens, focal_length: float, centre: Floats, points: Floats) -> Sources:
    """Trace the rays from microlenses at centres (n, 3) to points (n, 3) of the scene, by Newton's method."""
    scale = focal_length / lens.focal_length
    behind = centre / scale + [0.0, 0.0, lens.rear_principal]
    front = points / scale + [0.0, 0.0, lens.front_principal]
    depth, array, f = -points[:, 2] / scale, centre[:, 2] / scale, lens.focal_length
    # A thin lens to start with: slopes against -z at the microlens, and their effect at the point.
    by_slope = array + depth * (1.0 - array / f)
    height = centre[:, :2] / scale
    slope = (points[:, :2] / scale - height * (1.0 - depth / f)[:, None]) / by_slope[:, None]
    miss, _ = _miss(lens.lens, behind, slope, front)
    slope = slope - miss / by_slope[:, None]
    n, steps = len(centre), _STEP * np.eye(2)
    places = np.concatenate([behind, behind, behind, *(behind + np.append(step, 0.0) for step in steps * f)])
    trials = np.concatenate([slope, *(slope + step for step in steps), slope, slope])
    traced, _ = _miss(lens.lens, places, trials, np.tile(front, (5, 1)))
    miss = traced[:n]
    change = (traced[n:].reshape(4, n, 2) - miss) / _STEP
    turned, moved = change[:2].transpose(1, 2, 0), change[2:].transpose(1, 2, 0) / f
    determinant = turned[:, 0, 0] * turned[:, 1, 1] - turned[:, 0, 1] * turned[:, 1, 0]
    adjugate = np.stack([turned[:, 1, 1], -turned[:, 0, 1], -turned[:, 1, 0], turned[:, 0, 0]], axis=1)
    inverse = adjugate.reshape(n, 2, 2) / determinant[:, None, None]
    slope = slope - np.einsum("nij,nj->ni", inverse, miss)
    miss, direction = _miss(lens.lens, behind, slope, front)
    slope = slope - np.einsum("nij,nj->ni", inverse, miss)
    across = -inverse @ moved
    by_behind = np.concatenate([across, across @ slope[:, :, None]], axis=2)
    by_front = np.concatenate([inverse, -inverse @ direction[:, :, None]], axis=2)
    by_f = -(by_behind @ centre[:, :, None] + by_front @ points[:, :, None])[:, :, 0] / (scale * focal_length)
    distance = centre[:, 2]

    def in_space(rows: Floats) -> Floats:
        """Derivatives of the source (n, 3, ...) by those of the slope (n, 2, ...)."""
        wide = np.zeros((n, 3, *rows.shape[2:]))
        wide[:, :2] = distance.reshape(-1, *(1,) * (rows.ndim - 1)) * rows
        return wide

    by_centre = in_space(by_behind / scale)
    by_centre[:, :2, :2] += np.eye(2)
    by_centre[:, :2, 2] += slope
    source = np.column_stack([centre[:, :2] + distance[:, None] * slope, np.zeros(n)])
    return Sources(source, in_space(by_front / scale), in_space(by_f), by_centre)


def trace_rays(lens: TracedLens, focal_length: float, centre: Floats, slope: Floats, points: Floats) -> RayHits:
    """Trace rays of slopes dx/dz (n, 2) from positions (n, 3) behind the lens to the planes of points (n, 3)."""
    scale, n, steps = focal_length / lens.focal_length, len(centre), _STEP * np.eye(2)
    behind = centre / scale + [0.0, 0.0, lens.rear_principal]
    front = points / scale + [0.0, 0.0, lens.front_principal]
    places = np.concatenate([behind, *(behind + np.append(s, 0.0) * lens.focal_length for s in steps), behind, behind])
    trials = np.concatenate([slope, slope, slope, *(slope + step for step in steps)])
    # Slopes of `_miss` are against -z.
    traced, directions = _miss(lens.lens, places, -trials, np.tile(front, (5, 1)))
    miss = scale * traced[:n]
    change = (scale * traced[n:].reshape(4, n, 2) - miss) / _STEP
    moved, by_slope = (change[k : k + 2].transpose(1, 2, 0) for k in (0, 2))
    moved = moved / focal_length
    by_centre = np.concatenate([moved, -moved @ slope[:, :, None]], axis=2)
    by_point = np.concatenate([-np.tile(np.eye(2), (n, 1, 1)), directions[:n, :, None]], axis=2)
    lengths = by_centre @ centre[:, :, None] + by_point @ points[:, :, None]
    return RayHits(miss, by_point, (miss - lengths[:, :, 0]) / focal_length, by_centre, by_slope)


def _miss(lens: LensStack, behind: Floats, slope: Floats, front: Floats) -> tuple[Floats, Floats]:
    """Distance (n, 2) in x and y from points in front of the lens to rays from behind, and these rays' slopes."""
    direction = np.column_stack([slope, -np.ones(len(slope))])
    bundle = RayBundle(behind, direction / np.linalg.norm(direction, axis=1)[:, None])
    # Chief rays of corners may pass beyond rims of a lens that is merely like the real one.
    rays = trace_part(lens, bundle, 0, len(lens.elements) - 1, reverse=True, clipping=False)
    slopes = rays.direction[:, :2] / rays.direction[:, 2:]
    return rays.origin[:, :2] + (front[:, 2:] - rays.origin[:, 2:]) * slopes - front[:, :2], slopes
