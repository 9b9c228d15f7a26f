"""Rays from pixels through microlenses towards the scene."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.lens_record import lens_record
from plenoptic.optics.lens.trace import trace_record
from plenoptic.optics.microlens.array import MicrolensArray

_POINTS = 64
"""Sample points of a microlens aperture; their centroid is accurate to a hundredth of its radius."""


def chief_rays(
    axes: ArrayAxes, array: MicrolensArray, pixel: Floats, on_array: Floats, threads: int, *, clipping: bool = False
) -> RayBundle:
    """Trace rays from pixels (n, 2) through optical centres (n, 2) out of the lens, in its axes.

    Rims are ignored unless `clipping` is set.
    """
    reverse = lens_record(axes.camera.lens, axes.camera.wavelength, reverse=True, clipping=clipping)
    return trace_record(
        reverse, _towards_scene(axes, *rays_at_array(axes, array, pixel, on_array)[:2]), threads=threads
    )


def plane_intersections(rays: RayBundle, z: float | Floats) -> Floats:
    """Intersections (n, 2) of rays, or their extensions, with planes of constant z: x and y."""
    distance = (z - rays.origin[:, 2]) / rays.direction[:, 2]
    return np.asarray(rays.origin[:, :2] + distance[:, None] * rays.direction[:, :2])


def aperture_variance(array: MicrolensArray) -> float:
    """Variance of positions in a microlens aperture along one axis, mean of both axes, mm^2."""
    return float(0.5 * (aperture_points(array) ** 2).sum(axis=1).mean())


def rays_at_array(
    axes: ArrayAxes, array: MicrolensArray, pixel: Floats, on_array: Floats
) -> tuple[Floats, Floats, Floats]:
    """Positions (n, 2) and slopes (n, 2) of rays through optical centres in front of the array, and z (n,) of their
    pixels.

    All in the local axes of the array.
    """
    camera, parts, passed = axes.camera, axes.parts, axes.local(on_array)
    # Pixel coordinates may be fractional.
    on_sensor = camera.sensor.centre_of(pixel[:, 0], pixel[:, 1])  # type: ignore[arg-type]
    start = parts.sensor_to_local.points(np.column_stack([on_sensor, np.zeros(len(pixel))]))
    slopes, refraction = np.zeros_like(passed), array.model.refraction
    # A plate's displacement of a ray depends on its slope, which depends on the displacement: iterate.
    for _ in range(3):
        rear = refraction.shift_chief_rays(array, passed, slopes, camera.wavelength, True)
        slopes = (start[:, :2] - rear) / start[:, 2:]
        if rear is passed:
            break
    front = refraction.shift_chief_rays(array, passed, slopes, camera.wavelength, False)
    return 2.0 * passed - front, slopes, start[:, 2]


def _towards_scene(axes: ArrayAxes, positions: Floats, slopes: Floats) -> RayBundle:
    direction = -np.column_stack([slopes, np.ones(len(slopes))])
    return RayBundle(axes.in_lens(positions), axes.parts.local_to_lens.directions(direction), axes.camera.wavelength)


def aperture_points(array: MicrolensArray) -> Floats:
    """Points (m, 2) spread evenly over a microlens aperture, mm: a spiral with the golden angle between points."""
    if not array.model.focuses:
        return np.zeros((1, 2))
    aperture = array.opening
    index = np.arange(_POINTS) + 0.5
    radius, angle = aperture.reach * np.sqrt(index / _POINTS), index * math.pi * (3.0 - math.sqrt(5.0))
    points = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    inside = (points @ aperture.edges[:, :2].T <= aperture.edges[:, 2]).all(axis=1)
    # The centroid of the points is not exactly 0.
    return np.asarray(points[inside] - points[inside].mean(axis=0))
