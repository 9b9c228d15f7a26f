"""Rays from pixels through microlenses towards the scene."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.record import lens_record
from plenoptic.optics.lens.trace import traced_by
from plenoptic.optics.microlens.array import MicrolensArray

_POINTS = 64
"""Of an opening at which light is looked for; their centroid is good to a hundredth of its radius."""


def chief_rays(
    axes: ArrayAxes, array: MicrolensArray, pixel: Floats, on_array: Floats, threads: int, *, clipping: bool = False
) -> RayBundle:
    """Rays from pixels (n, 2) through optical centres (n, 2), traced out of the lens, in its axes.

    Past all rims, or with `clipping` as far as these let them.
    """
    reverse = lens_record(axes.camera.lens, axes.camera.wavelength, reverse=True, clipping=clipping)
    return traced_by(reverse, _towards_scene(axes, *leaving(axes, array, pixel, on_array)[:2]), threads=threads)


def aperture_rays(
    axes: ArrayAxes, array: MicrolensArray, pixel: Floats, on_array: Floats, types: NDArray[np.int64], threads: int
) -> RayBundle:
    """Rays from pixels (n, 2) through m points of the openings of microlenses at (n, 2), of types (n,): m n rays.

    They are traced out of the lens, in its axes; those that rims stop have weight 0. Thin microlenses deviate them.
    """
    camera = axes.camera
    bending = 1.0 / np.array(array.focal_lengths_at(camera.wavelength))[types] - 1.0 / camera.microlenses_to_sensor
    beside = _aperture_points(array) @ axes.parts.array_turn.T
    front, slopes, _ = leaving(axes, array, pixel, on_array)
    rays = _towards_scene(
        axes,
        (front[:, None] + beside).reshape(-1, 2),
        (slopes[:, None] + bending[:, None, None] * beside).reshape(-1, 2),
    )
    return traced_by(lens_record(camera.lens, camera.wavelength, reverse=True), rays, threads=threads)


def plane_intersections(rays: RayBundle, z: float | Floats) -> Floats:
    """Where rays, or the lines along them, meet a plane: x and y (n, 2)."""
    along = (z - rays.origin[:, 2]) / rays.direction[:, 2]
    return np.asarray(rays.origin[:, :2] + along[:, None] * rays.direction[:, :2])


def aperture_variance(array: MicrolensArray) -> float:
    """Variance of places in an opening along one axis, the mean of both, mm^2."""
    return float(0.5 * (_aperture_points(array) ** 2).sum(axis=1).mean())


def leaving(axes: ArrayAxes, array: MicrolensArray, pixel: Floats, on_array: Floats) -> tuple[Floats, Floats, Floats]:
    """Where rays through optical centres leave the array for the lens, their slopes (n, 2), and z of the sensor (n,).

    All in the local axes of the array.
    """
    camera, parts, passed = axes.camera, axes.parts, axes.local(on_array)
    # Places between pixels too.
    on_sensor = camera.sensor.centre_of(pixel[:, 0], pixel[:, 1])  # type: ignore[arg-type]
    start = parts.sensor_to_local.points(np.column_stack([on_sensor, np.zeros(len(pixel))]))
    slopes, rules = np.zeros_like(passed), array.model.rules
    # Plates displace rays by what depends on their slope, which depends on the displacement.
    for _ in range(3):
        rear = rules.displaced(array, passed, slopes, camera.wavelength, True)
        slopes = (start[:, :2] - rear) / start[:, 2:]
    return 2.0 * passed - rules.displaced(array, passed, slopes, camera.wavelength, False), slopes, start[:, 2]


def _towards_scene(axes: ArrayAxes, leaving: Floats, slopes: Floats) -> RayBundle:
    towards = -np.column_stack([slopes, np.ones(len(slopes))])
    return RayBundle(axes.in_lens(leaving), axes.parts.local_to_lens.directions(towards), axes.camera.wavelength)


def _aperture_points(array: MicrolensArray) -> Floats:
    """Points (m, 2) spread evenly over an opening, mm: on a spiral whose turns keep the golden angle."""
    if not array.model.focuses:
        return np.zeros((1, 2))
    opening = array.opening
    number = np.arange(_POINTS) + 0.5
    radius, angle = opening.reach * np.sqrt(number / _POINTS), number * math.pi * (3.0 - math.sqrt(5.0))
    points = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    inside = (points @ opening.edges[:, :2].T <= opening.edges[:, 2]).all(axis=1)
    # Their own centroid is not quite 0.
    return np.asarray(points[inside] - points[inside].mean(axis=0))
