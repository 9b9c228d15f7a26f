"""Pinhole model used for matching, and the displacement of the real camera's images from it.

In the model microlenses are pinholes, and the images of an object plane perpendicular to the axis shift by the same
amount between all neighbouring microlenses. In the real camera, aberrations move the chief ray's intersection with the
plane. Out of focus, a point is seen through the whole microlens aperture, part of which the main lens vignettes: its
image is displaced, more so farther from the centre of the micro image.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import image_plane, lateral_magnification, object_plane
from plenoptic.camera.points.projection_rows import lenses_at
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.outward_rays import aperture_rays, chief_rays, plane_intersections
from plenoptic.optics.microlens.array import MicrolensArray

_TRIALS = 24
"""Virtual depths at which an object plane in front of the lens is searched."""
_ITERATIONS = 6
"""Fixed-point iterations for a point's image behind a neighbouring microlens.

Each leaves a twentieth of the error, but a third of it where aberrations change disparity by 30 %.
"""
_BLOCK = 1 << 9
"""Pixels whose rays are traced together."""


class ObjectPlane(NamedTuple):
    """Object plane perpendicular to the axis, and its paraxial image."""

    z: float
    """Axial position in the axes of the lens, mm."""
    z_image: float
    disparity_per_pitch: float
    """Disparity over pitch: microlenses_to_sensor / behind."""
    behind: float
    """Distance of the image behind the array, mm; negative in front of it."""
    magnification: float
    """Lateral magnification: height of the image over that of the object."""


PlanePair = tuple[ObjectPlane, ObjectPlane]
"""Two object planes determine all others: Gaussian optics images lines to lines, and positions along a line are
weighted means of two.
"""


class PinholeModel(NamedTuple):
    """A focused camera, and the object planes that determine its pinhole model."""

    axes: ArrayAxes
    array: MicrolensArray
    planes: PlanePair
    threads: int


def lens_front_z(camera: PlenopticCamera) -> float:
    """Axial position of the front of the lens in its own axes, mm."""
    return min(0.0, float(camera.lens.vertices[0]))


def image_distance_behind_array(camera: PlenopticCamera, z: float) -> float:
    """Distance of a plane's paraxial image behind the array, mm, negative in front of it.

    Raises InvalidValueError for a plane behind the front of the lens.
    """
    front = lens_front_z(camera)
    if not z < front:
        raise InvalidValueError(
            f"z is {z:g} mm; the plane must lie in front of the camera, beyond its lens at z = {front:g} mm"
        )
    return image_plane(camera.lens, z, camera.wavelength) - camera.stop_to_microlenses


def object_plane_pair(camera: PlenopticCamera, virtual_depths: tuple[float, float]) -> PlanePair:
    """Two object planes in front of the lens whose virtual depths, of one sign, lie within a range."""
    far, near = sorted(virtual_depths, key=abs, reverse=True)
    planes = planes_before_lens(camera, camera.microlenses_to_sensor / np.linspace(1.0 / far, 1.0 / near, _TRIALS))
    if len(planes) < 2:
        raise InvalidValueError(
            f"planes at virtual depths {near:g} to {far:g} do not lie in front of the lens; give the virtual depths of "
            "the scene, or focus the camera on it"
        )
    return planes[len(planes) // 4], planes[-1 - len(planes) // 4]


def planes_before_lens(camera: PlenopticCamera, behind: Floats) -> list[ObjectPlane]:
    """Object planes in front of the lens whose images lie at given distances (n,) behind the array, mm."""
    planes = []
    for distance in behind.tolist():
        z_image = camera.stop_to_microlenses + distance
        z = object_plane(camera.lens, z_image, camera.wavelength)
        if -math.inf < z < lens_front_z(camera):
            magnification = lateral_magnification(camera.lens, z, camera.wavelength)
            planes.append(ObjectPlane(z, z_image, camera.microlenses_to_sensor / distance, distance, magnification))
    return planes


def object_z(planes: PlanePair, behind: Floats) -> Floats:
    """Axial positions (n,) of object planes in the axes of the lens, from image distances (n,) behind the array.

    An image point that divides the line between two planes' images as t : 1 - t has the weights (1 - t) m1 and t m2 on
    the object side, with the magnifications m1 and m2.
    """
    front, back = planes
    t = (behind - front.behind) / (back.behind - front.behind)
    first, second = (1.0 - t) * front.magnification, t * back.magnification
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((first * front.z + second * back.z) / (first + second))


def _pinhole_pixels(axes: ArrayAxes, plane: ObjectPlane, points: Floats, on_array: Floats) -> Floats:
    """Pixels (n, 2) at which the pinhole model images points (n, 2) of a plane through microlenses at (n, 2)."""
    image = np.column_stack([plane.magnification * points, np.full(len(points), plane.z_image)])
    image_on_array = axes.parts.local_to_lens.inverse().points(image)[:, :2]
    on_rear = (1.0 - plane.disparity_per_pitch) * axes.local(on_array) + plane.disparity_per_pitch * image_on_array
    return np.asarray(axes.camera.sensor.pixel_of(axes.on_sensor(on_rear, np.zeros_like(on_rear))))


def orthogonal_pixels(axes: ArrayAxes, on_array: Floats) -> Floats:
    """Pixel positions (n, 2) of points (n, 2) of the array, projected along the array's normal."""
    local = axes.local(on_array)
    return np.asarray(axes.camera.sensor.pixel_of(axes.on_sensor(local, np.zeros_like(local))))


def trace_displacement(
    model: PinholeModel, pixel: Floats, on_array: Floats, types: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """Throughput (n,) and displacement (n, 2, 2) of pixels (n, 2) behind microlenses at (n, 2) of types (n,).

    Rays from each pixel sample the aperture of its microlens. The throughput is the fraction that the lens passes; the
    mean displacement from the pinhole model in rows and columns is given as coefficients of 1 and of disparity / pitch,
    nan if no light passes.
    """
    axes, array, planes, threads = model
    throughput, offset = np.zeros(len(pixel)), np.empty((2, len(pixel), 2))
    for start in range(0, len(pixel), _BLOCK):
        block = slice(start, start + _BLOCK)
        rays = aperture_rays(axes, array, pixel[block], on_array[block], types[block], threads)
        light = rays.weight.reshape(len(pixel[block]), -1)
        throughput[block] = light.mean(axis=1)
        for k, plane in enumerate(planes):
            points = np.where(rays.weight[:, None] > 0, plane_intersections(rays, plane.z), 0.0).reshape(
                *light.shape, 2
            )
            with np.errstate(invalid="ignore"):
                centroid = np.einsum("nk,nkc->nc", light, points) / light.sum(axis=1)[:, None]
            offset[k, block] = pixel[block] - _pinhole_pixels(axes, plane, centroid, on_array[block])
    return throughput, np.stack(linear_in_disparity(planes, offset), axis=1)


def chord_disparity(
    model: PinholeModel, pixel: Floats, index: NDArray[np.int64], steps: NDArray[np.int64], per_pitch: Floats
) -> Floats:
    """(n,): chord disparity over the pitch, for points that pixels (n, 2) see at model disparities (n,).

    Chief rays pass microlenses of indices (n, 2) and their neighbours, as in `GroundTruth.chord_disparity`.
    """
    centre = lenses_at(model.array, index).axis
    projected = orthogonal_pixels(model.axes, centre)
    offset = _displacement_at(model, pixel, centre, per_pitch)
    along, length = np.zeros(len(pixel)), np.zeros(len(pixel))
    for step in steps:
        neighbour = lenses_at(model.array, index + step).axis
        baseline = orthogonal_pixels(model.axes, neighbour) - projected
        expected, neighbour_offset = pixel - offset + (1.0 - per_pitch)[:, None] * baseline, offset
        for _ in range(_ITERATIONS):
            neighbour_offset = _displacement_at(model, expected + neighbour_offset, neighbour, per_pitch)
        along += ((neighbour_offset - offset) * baseline).sum(axis=1)
        length += (baseline**2).sum(axis=1)
    return per_pitch - along / length


def object_depths(model: PinholeModel, pixel: Floats, on_array: Floats, per_pitch: Floats) -> Floats:
    """(n,): depth -z in the camera's frame, mm, of points seen by pixels (n, 2); nan behind the front of the lens."""
    with np.errstate(divide="ignore"):
        z = object_z(model.planes, model.axes.camera.microlenses_to_sensor / per_pitch)
    return depths_on_rays(model.axes, model.array, pixel, on_array, z, model.threads)


def depths_on_rays(
    axes: ArrayAxes, array: MicrolensArray, pixel: Floats, on_array: Floats, z: Floats, threads: int
) -> Floats:
    """(n,): depth -z in the camera's frame, mm, where the chief rays of pixels (n, 2) meet planes z of the lens's axes.

    nan behind the front of the lens.
    """
    z, lens_to_camera = np.where(z < lens_front_z(axes.camera), z, np.nan), axes.parts.lens_to_camera
    if lens_to_camera is not None:
        rays = chief_rays(axes, array, pixel, on_array, threads)
        z = lens_to_camera.points(np.column_stack([plane_intersections(rays, z), z]))[:, 2]
    return -z


def chief_ray_displacement(model: PinholeModel, pixel: Floats, on_array: Floats) -> tuple[Floats, Floats]:
    """Displacement of pixels (n, 2) from the pinhole image of the points that their chief rays hit.

    Coefficients (n, 2) of 1 and of disparity / pitch.
    """
    axes, array, planes, threads = model
    rays = chief_rays(axes, array, pixel, on_array, threads)
    points = (plane_intersections(rays, plane.z) for plane in planes)
    offsets = [pixel - _pinhole_pixels(axes, p, at, on_array) for p, at in zip(planes, points, strict=True)]
    return linear_in_disparity(planes, np.stack(offsets))


def _displacement_at(model: PinholeModel, pixel: Floats, on_array: Floats, per_pitch: Floats) -> Floats:
    """Displacement (n, 2) of chief rays at model disparities (n,)."""
    intercept, slope = chief_ray_displacement(model, pixel, on_array)
    return intercept + per_pitch[:, None] * slope


def linear_in_disparity(planes: PlanePair, values: Floats) -> tuple[Floats, Floats]:
    """Intercept at disparity 0 and slope over disparity / pitch of values (2, ...) on two planes."""
    slope = (values[1] - values[0]) / (planes[1].disparity_per_pitch - planes[0].disparity_per_pitch)
    return values[0] - slope * planes[0].disparity_per_pitch, slope
