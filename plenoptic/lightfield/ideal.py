"""The ideal camera that stands for a real one when its images are matched, and what the real one sees beside it.

In the ideal camera points of a plane across the axis move between microlenses by what is the same everywhere, and the
microlenses are pinholes. The real one has aberrations, whose chief rays meet the plane elsewhere; and where a point is
out of focus, it is seen through all of an opening, of which the rims of the lens hide a part: its image is displaced,
the more the farther it is from the middle of the microlens image.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.camera.points.projection_rows import lenses_with
from plenoptic.camera.report.optics import object_plane
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.outward_rays import chief_rays, met, rays_of_openings
from plenoptic.optics.microlens.array import MicrolensArray

_TRIED = 24
"""Virtual depths at which a plane is looked for in front of the lens."""
_NODES = np.sqrt(0.75) * np.array([-1.0, 0.0, 1.0])
_LENSES = 37
"""In the middle of the sensor, to which the ideal camera is fitted."""
_FITTED = np.linspace(-0.35, 0.35, 7)
"""Places in their images, over the pitch."""
_PIXELS = 1 << 9
"""Whose rays are traced together."""


class IdealPlane(NamedTuple):
    """A plane as the ideal camera sees it: pixel = (1 - disparity / pitch) straight + (place - origin) matrix."""

    z: float
    """In the axes of the lens."""
    near: float
    """disparity / pitch, negative for images in front of the array."""
    origin: Floats
    matrix: Floats

    def seen_at(self, places: Floats, straight: Floats) -> Floats:
        """Pixels (n, 2) at which points (n, 2) of the plane are seen through microlenses straight before (n, 2)."""
        return np.asarray((1.0 - self.near) * straight + (places - self.origin) @ self.matrix)


class Displacement(NamedTuple):
    """What n pixels of the real camera have beside the ideal one on several planes."""

    share: Floats
    """(n,): of the opening of their microlens that lights them."""
    shift: Floats
    """(planes, n, 2): how far from where the ideal camera sees it, rows and columns, a point is seen, on the mean."""


def ideal_planes(
    axes: ArrayAxes, array: MicrolensArray, virtual_depths: tuple[float, float], sign: float
) -> tuple[IdealPlane, ...]:
    """Three planes in front of the lens whose virtual depths, of one sign, lie within a range.

    What lies between them is a parabola in the disparity. They lie at the zeros of Chebyshev's polynomial over the
    disparities of the range, where that is off least.
    """
    low, high = virtual_depths
    there = [u for u in np.linspace(1.0 / high, 1.0 / low, _TRIED) if _plane_at(axes.camera, sign * u) is not None]
    if len(there) < 2:
        raise InvalidValueError(
            f"images of planes at virtual depths {low:g} to {high:g} do not lie in front of the lens; give the "
            "virtual_depths of the scene, or focus the camera on it"
        )
    nodes = 0.5 * (there[0] + there[-1]) + 0.5 * (there[-1] - there[0]) * _NODES
    places = [z for u in nodes if (z := _plane_at(axes.camera, sign * u)) is not None]
    camera = axes.camera
    centres = microlens_centres(camera, CentreMethod.CHIEF_RAY)
    chosen = np.argsort(np.hypot(*(centres.pixel - 0.5 * np.array(camera.sensor.shape)).T), kind="stable")[:_LENSES]
    offsets = min(array.pitches) / camera.sensor.pixel_pitch * np.stack(np.meshgrid(_FITTED, _FITTED), -1).reshape(-1, 2)
    pixel = (centres.pixel[chosen, None] + offsets).reshape(-1, 2)
    on_array = np.repeat(centres.on_array[chosen], len(offsets), axis=0)
    rays = chief_rays(axes, array, pixel, on_array, 1)
    straight = straight_pixels(axes, on_array)
    return tuple(_fitted(z, met(rays, z), pixel, straight) for z in places)


def _plane_at(camera: PlenopticCamera, near: float) -> float | None:
    """The plane whose image lies microlenses_to_sensor / near behind the array, if it is in front of the lens."""
    z = object_plane(camera.lens, camera.stop_to_microlenses + camera.microlenses_to_sensor / near, camera.wavelength)
    return z if -math.inf < z < min(0.0, float(camera.lens.vertices[0])) else None


def straight_pixels(axes: ArrayAxes, on_array: Floats) -> Floats:
    """Where points (n, 2) of the array lie straight before the sensor, in its pixels."""
    local = axes.local(on_array)
    return np.asarray(axes.camera.sensor.pixel_of(axes.on_sensor(local, np.zeros_like(local))))


def _fitted(z: float, places: Floats, pixel: Floats, straight: Floats) -> IdealPlane:
    """By least squares: places are a linear function of pixels and microlenses, of the latter in one ratio alone."""
    known = np.isfinite(places).all(axis=1)
    one, target = np.ones((np.count_nonzero(known), 1)), places[known]
    free = np.linalg.lstsq(np.hstack([one, pixel[known], straight[known]]), target, rcond=None)[0]
    near = 1.0 + 0.5 * float(np.trace(free[3:] @ np.linalg.inv(free[1:3])))
    found = np.linalg.lstsq(np.hstack([one, pixel[known] - (1.0 - near) * straight[known]]), target, rcond=None)[0]
    return IdealPlane(z, near, found[0], np.linalg.inv(found[1:]))


def parabola(planes: tuple[IdealPlane, ...], values: Floats) -> Floats:
    """Coefficients (3, ...) of 1, u and u^2, with u = disparity / pitch, of what has values (3, ...) on the planes."""
    powers = np.vander([plane.near for plane in planes], increasing=True)
    return np.asarray(np.tensordot(np.linalg.inv(powers), values, axes=1))


def displacement(
    axes: ArrayAxes,
    array: MicrolensArray,
    pixel: Floats,
    on_array: Floats,
    types: NDArray[np.int64],
    planes: tuple[IdealPlane, ...],
    threads: int,
) -> Displacement:
    """Of pixels (n, 2) in the images of microlenses at (n, 2), of types (n,)."""
    share, shift = np.zeros(len(pixel)), np.full((len(planes), len(pixel), 2), np.nan)
    straight = straight_pixels(axes, on_array)
    for start in range(0, len(pixel), _PIXELS):
        part = slice(start, start + _PIXELS)
        rays = rays_of_openings(axes, array, pixel[part], on_array[part], types[part], threads)
        light = rays.weight.reshape(len(pixel[part]), -1)
        share[part] = light.mean(axis=1)
        for k, plane in enumerate(planes):
            seen = np.where(rays.weight[:, None] > 0, met(rays, plane.z), 0.0).reshape(*light.shape, 2)
            with np.errstate(invalid="ignore"):
                middle = np.einsum("nk,nkc->nc", light, seen) / light.sum(axis=1)[:, None]
            shift[k, part] = pixel[part] - plane.seen_at(middle, straight[part])
    return Displacement(share, shift)


def chord_excess(
    axes: ArrayAxes,
    array: MicrolensArray,
    pixel: Floats,
    index: NDArray[np.int64],
    steps: NDArray[np.int64],
    planes: tuple[IdealPlane, ...],
    threads: int,
) -> Floats:
    """(planes, n): what the chord's disparity over the pitch has beyond the ideal camera's, at pixels (n, 2).

    Chief rays pass microlenses of indices (n, 2) and their neighbours, as in `GroundTruth.chord_disparity`, and how far
    from the ideal camera's pixels these see a plane is taken at those very pixels: aberrations hardly change between.
    """
    own = lenses_with(array, index).axis
    straight = straight_pixels(axes, own)
    others = [lenses_with(array, index + step).axis for step in steps]
    apart = [straight_pixels(axes, other) - straight for other in others]
    excess = np.empty((len(planes), len(pixel)))
    for k, plane in enumerate(planes):
        here = _beside(axes, array, pixel, own, plane, threads)
        along, length = np.zeros(len(pixel)), np.zeros(len(pixel))
        for other, away in zip(others, apart, strict=True):
            there = _beside(axes, array, pixel + (1.0 - plane.near) * away, other, plane, threads)
            along += ((there - here) * away).sum(axis=1)
            length += (away**2).sum(axis=1)
        excess[k] = -along / length
    return excess


def _beside(
    axes: ArrayAxes, array: MicrolensArray, pixel: Floats, on_array: Floats, plane: IdealPlane, threads: int
) -> Floats:
    """How far chief rays' pixels lie from where the ideal camera sees the same points of a plane."""
    rays = chief_rays(axes, array, pixel, on_array, threads)
    return pixel - plane.seen_at(met(rays, plane.z), straight_pixels(axes, on_array))
