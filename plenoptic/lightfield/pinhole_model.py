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
from plenoptic.camera.points.projection_rows import lenses_with
from plenoptic.camera.report.optics import lateral_magnification, object_plane
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.object_planes import lens_front_z
from plenoptic.lightfield.outward_rays import aperture_rays, chief_rays, plane_intersections
from plenoptic.optics.microlens.array import MicrolensArray

_TRIED = 24
"""Virtual depths at which a plane is looked for in front of the lens."""
_DISPLACED = 2
"""Corrections of where a neighbour sees a point; each leaves a twentieth."""
_PIXELS = 1 << 9
"""Whose rays are traced together."""


class ObjectPlane(NamedTuple):
    """A plane across the axis, and its image by Gaussian optics."""

    z: float
    """In the axes of the lens."""
    z_image: float
    near: float
    """disparity / pitch: microlenses_to_sensor over `behind`."""
    behind: float
    """How far behind the array the image lies, mm; negative before it."""
    larger: float
    """Height of the image over that of the object."""


class Displacement(NamedTuple):
    """What n pixels of the real camera have beside the ideal one."""

    share: Floats
    """(n,): of the opening of their microlens that lights them."""
    shift: Floats
    """(n, 2, 2): how far from where the ideal camera sees it, in rows and columns, a point is seen, on the mean: what 1
    and disparity / pitch multiply; nan in the dark."""


PlanePair = tuple[ObjectPlane, ObjectPlane]
"""Two tell all: Gaussian optics images lines to lines, on which places are weighted means of two."""


def object_plane_pair(camera: PlenopticCamera, virtual_depths: tuple[float, float], sign: float) -> PlanePair:
    """Two planes in front of the lens whose virtual depths, of one sign, lie within a range."""
    low, high = virtual_depths
    b = camera.microlenses_to_sensor
    there = planes_before_lens(camera, sign * b / np.linspace(1.0 / high, 1.0 / low, _TRIED))
    if len(there) < 2:
        raise InvalidValueError(
            f"images of planes at virtual depths {low:g} to {high:g} do not lie in front of the lens; give the "
            "virtual depths of the scene, or focus the camera on it"
        )
    return there[len(there) // 4], there[-1 - len(there) // 4]


def planes_before_lens(camera: PlenopticCamera, behind: Floats) -> list[ObjectPlane]:
    """Those of the planes with images some distances (n,) behind the array that lie in front of the lens."""
    found = []
    for distance in behind.tolist():
        z_image = camera.stop_to_microlenses + distance
        z = object_plane(camera.lens, z_image, camera.wavelength)
        if -math.inf < z < lens_front_z(camera):
            larger = lateral_magnification(camera.lens, z, camera.wavelength)
            found.append(ObjectPlane(z, z_image, camera.microlenses_to_sensor / distance, distance, larger))
    return found


def object_z(planes: PlanePair, behind: Floats) -> Floats:
    """Planes, in the axes of the lens, whose images lie some distances (n,) behind the array.

    A place at the parts 1 - t and t of the way between two planes' images on a line has the weights (1 - t) larger and
    t larger, of each plane, on the object's side.
    """
    one, two = planes
    t = (behind - one.behind) / (two.behind - one.behind)
    first, second = (1.0 - t) * one.larger, t * two.larger
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((first * one.z + second * two.z) / (first + second))


def _seen_at(axes: ArrayAxes, plane: ObjectPlane, places: Floats, on_array: Floats) -> Floats:
    """Pixels (n, 2) at which the ideal camera sees points (n, 2) of a plane through microlenses at (n, 2)."""
    image = np.column_stack([plane.larger * places, np.full(len(places), plane.z_image)])
    straight = axes.parts.local_to_lens.inverse().points(image)[:, :2]
    crossed = (1.0 - plane.near) * axes.local(on_array) + plane.near * straight
    return np.asarray(axes.camera.sensor.pixel_of(axes.on_sensor(crossed, np.zeros_like(crossed))))


def orthogonal_pixels(axes: ArrayAxes, on_array: Floats) -> Floats:
    """Where points (n, 2) of the array lie straight before the sensor, in its pixels."""
    local = axes.local(on_array)
    return np.asarray(axes.camera.sensor.pixel_of(axes.on_sensor(local, np.zeros_like(local))))


def displacement(
    axes: ArrayAxes,
    array: MicrolensArray,
    pixel: Floats,
    on_array: Floats,
    types: NDArray[np.int64],
    planes: PlanePair,
    threads: int,
) -> Displacement:
    """Of pixels (n, 2) in the images of microlenses at (n, 2), of types (n,)."""
    share, shift = np.zeros(len(pixel)), np.empty((2, len(pixel), 2))
    for start in range(0, len(pixel), _PIXELS):
        part = slice(start, start + _PIXELS)
        rays = aperture_rays(axes, array, pixel[part], on_array[part], types[part], threads)
        light = rays.weight.reshape(len(pixel[part]), -1)
        share[part] = light.mean(axis=1)
        for k, plane in enumerate(planes):
            places = np.where(rays.weight[:, None] > 0, plane_intersections(rays, plane.z), 0.0).reshape(
                *light.shape, 2
            )
            with np.errstate(invalid="ignore"):
                middle = np.einsum("nk,nkc->nc", light, places) / light.sum(axis=1)[:, None]
            shift[k, part] = pixel[part] - _seen_at(axes, plane, middle, on_array[part])
    return Displacement(share, np.stack(_line(planes, shift), axis=1))


def chord_disparity(
    axes: ArrayAxes,
    array: MicrolensArray,
    pixel: Floats,
    index: NDArray[np.int64],
    steps: NDArray[np.int64],
    near: Floats,
    planes: PlanePair,
    threads: int,
) -> Floats:
    """(n,): the chord's disparity over the pitch of what pixels (n, 2) show at the ideal camera's (n,).

    Chief rays pass microlenses of indices (n, 2) and their neighbours, as in `GroundTruth.chord_disparity`.
    """
    own = lenses_with(array, index).axis
    straight = orthogonal_pixels(axes, own)
    here = _beside(axes, array, pixel, own, near, planes, threads)
    along, length = np.zeros(len(pixel)), np.zeros(len(pixel))
    for step in steps:
        other = lenses_with(array, index + step).axis
        away = orthogonal_pixels(axes, other) - straight
        ideal, there = pixel - here + (1.0 - near)[:, None] * away, here
        # Aberrations hardly change over the pixels that they displace by.
        for _ in range(_DISPLACED):
            there = _beside(axes, array, ideal + there, other, near, planes, threads)
        along += ((there - here) * away).sum(axis=1)
        length += (away**2).sum(axis=1)
    return near - along / length


def object_depths(
    axes: ArrayAxes,
    array: MicrolensArray,
    pixel: Floats,
    on_array: Floats,
    near: Floats,
    planes: PlanePair,
    threads: int,
) -> Floats:
    """-z in the camera's frame (n,), mm, of what pixels (n, 2) show; nan behind the lens's front."""
    camera, placed = axes.camera, axes.parts.lens_to_camera
    with np.errstate(divide="ignore"):
        z = object_z(planes, camera.microlenses_to_sensor / near)
    z = np.where(z < lens_front_z(camera), z, np.nan)
    if placed is not None:
        rays = chief_rays(axes, array, pixel, on_array, threads)
        z = placed.points(np.column_stack([plane_intersections(rays, z), z]))[:, 2]
    return -z


def _beside(
    axes: ArrayAxes,
    array: MicrolensArray,
    pixel: Floats,
    on_array: Floats,
    near: Floats,
    planes: PlanePair,
    threads: int,
) -> Floats:
    """How far pixels (n, 2) lie from where the ideal camera sees what their chief rays meet."""
    rays = chief_rays(axes, array, pixel, on_array, threads)
    at, slope = _line(
        planes, np.stack([pixel - _seen_at(axes, p, plane_intersections(rays, p.z), on_array) for p in planes])
    )
    return at + near[:, None] * slope


def _line(planes: PlanePair, values: Floats) -> tuple[Floats, Floats]:
    """Of values (2, ...) on two planes: what they are at disparity 0, and what disparity / pitch multiplies."""
    slope = (values[1] - values[0]) / (planes[1].near - planes[0].near)
    return values[0] - slope * planes[0].near, slope
