"""Pinhole model used for matching, and the displacement of the real camera's images from it.

In the model microlenses are pinholes, and the images of an object plane perpendicular to the axis shift by the same
amount between all neighbouring microlenses. In the real camera, aberrations move the chief ray's intersection with the
plane. Out of focus, a point is seen through the whole microlens aperture, part of which the main lens vignettes: its
image is displaced, more so farther from the centre of the micro image.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes, array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import image_plane, lateral_magnification, object_plane
from plenoptic.camera.points.projection_rows import lenses_at
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.outward_rays import aperture_points, chief_rays, plane_intersections, rays_at_array
from plenoptic.optics.lens.lens_record import LensRecord, lens_record
from plenoptic.optics.microlens.array import MicrolensArray

_TRIALS = 24
"""Virtual depths at which an object plane in front of the lens is searched."""
_ITERATIONS = 5
"""Iterations for a point's image behind a neighbouring microlens. They leave 1e-4 of the disparity where aberrations
change it by 30 %, and 1e-8 of the reference camera's."""
_BLOCK = 1 << 12
"""Pixels whose rays one task of a thread traces."""


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
    maps: Floats
    """(2, 2, 5): affine maps of 1, a point of either plane (x, y), and a microlens (x, y) to row and column."""
    lens: LensRecord
    """The lens in reverse, with rims and stops."""
    unclipped: LensRecord
    """The same without them."""
    threads: int


def pinhole_model(camera: PlenopticCamera, virtual_depths: tuple[float, float], threads: int) -> PinholeModel:
    """Model of a camera with microlenses for a range of virtual depths."""
    assert camera.microlenses is not None
    axes, planes = array_axes(camera), object_plane_pair(camera, virtual_depths)
    unit = np.eye(5)[:, 1:]
    images = [_pinhole_pixels(axes, plane, unit[:, :2], unit[:, 2:]) for plane in planes]
    maps = np.stack([np.vstack([image[:1], image[1:] - image[0]]).T for image in images])
    lens, unclipped = (
        lens_record(camera.lens, camera.wavelength, reverse=True, clipping=rims) for rims in (True, False)
    )
    return PinholeModel(axes, camera.microlenses, planes, np.ascontiguousarray(maps), lens, unclipped, threads)


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
    throughput, displacement = np.empty(len(pixel)), np.empty((len(pixel), 2, 2))
    points = aperture_points(model.array) @ model.axes.parts.array_turn.T
    focal_lengths = np.array(model.array.focal_lengths_at(model.axes.camera.wavelength))[types]
    deviation = 1.0 / focal_lengths - 1.0 / model.axes.camera.microlenses_to_sensor

    def fill(start: int) -> None:
        block = slice(start, start + _BLOCK)
        throughput[block], displacement[block] = _displacement(
            model, pixel[block], on_array[block], points, deviation[block]
        )

    for _ in run_in_order(fill, range(0, len(pixel), _BLOCK), threads=model.threads):
        pass
    return throughput, displacement


def _displacement(
    model: PinholeModel, pixel: Floats, on_array: Floats, points: Floats, deviation: Floats | None
) -> tuple[Floats, Floats]:
    """Throughput and displacement by rays through points (m, 2) of apertures, which deviate them by (n,) times a point.

    None: chief rays, without vignetting.
    """
    from plenoptic.lightfield.kernels.displacement import fill_displacement

    to_lens, lens = model.axes.parts.local_to_lens, model.unclipped if deviation is None else model.lens
    z, disparity = np.array([(plane.z, plane.disparity_per_pitch) for plane in model.planes]).T.copy()
    position, slope, _ = rays_at_array(model.axes, model.array, pixel, on_array)
    starts = position, slope, np.zeros(len(pixel)) if deviation is None else deviation
    throughput, displacement = np.empty(len(pixel)), np.empty((len(pixel), 2, 2))
    traced = np.column_stack([to_lens.turn, to_lens.shift]), z, disparity, model.maps
    fill_displacement(throughput, displacement, (pixel, on_array), starts, points, lens, traced)
    return throughput, displacement


def chord_disparity(
    model: PinholeModel, pixel: Floats, index: NDArray[np.int64], steps: NDArray[np.int64], per_pitch: Floats
) -> Floats:
    """(n,): chord disparity over the pitch, for points that pixels (n, 2) see at model disparities (n,).

    Chief rays pass microlenses of indices (n, 2) and their neighbours, as in `GroundTruth.chord_disparity`.
    """
    chord = np.empty(len(pixel))

    def fill(start: int) -> None:
        block = slice(start, start + _BLOCK)
        chord[block] = _chord_disparity(model, pixel[block], index[block], steps, per_pitch[block])

    for _ in run_in_order(fill, range(0, len(pixel), _BLOCK), threads=model.threads):
        pass
    return chord


def _chord_disparity(
    model: PinholeModel, pixel: Floats, index: NDArray[np.int64], steps: NDArray[np.int64], per_pitch: Floats
) -> Floats:
    centre = lenses_at(model.array, index).axis
    projected = orthogonal_pixels(model.axes, centre)
    offset = _displacement_at(model, centre, per_pitch, pixel)
    along, length = np.zeros(len(pixel)), np.zeros(len(pixel))
    for step in steps:
        neighbour = lenses_at(model.array, index + step).axis
        baseline = orthogonal_pixels(model.axes, neighbour) - projected
        expected = pixel - offset + (1.0 - per_pitch)[:, None] * baseline
        neighbour_offset = _fixed_point(
            functools.partial(_displacement_at, model, neighbour, per_pitch, expected), offset
        )
        along += _dot(neighbour_offset - offset, baseline)
        length += _dot(baseline, baseline)
    return per_pitch - along / length


def _dot(a: Floats, b: Floats) -> Floats:
    """Scalar products (n,) of vectors (n, 2)."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1])


def _fixed_point(function: Callable[[Floats], Floats], start: Floats) -> Floats:
    """Fixed points (n, 2) of a function by Anderson's iteration: each extrapolates the line through the last two.

    D. G. Anderson, J. ACM 12 (1965), doi:10.1145/321296.321305.
    """
    value = function(start)
    residual, point = value - start, value
    for _ in range(_ITERATIONS - 1):
        new_value = function(point)
        new_residual = new_value - point
        change = new_residual - residual
        with np.errstate(divide="ignore", invalid="ignore"):
            step = _dot(change, new_residual) / _dot(change, change)
        step = np.where(np.isfinite(step), step, 0.0)[:, None]
        point, value, residual = new_value - step * (new_value - value), new_value, new_residual
    return point


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


def _displacement_at(
    model: PinholeModel, on_array: Floats, per_pitch: Floats, pixel: Floats, moved: Floats | float = 0.0
) -> Floats:
    """Displacement (n, 2) of chief rays of pixels (n, 2), moved by (n, 2), at model disparities (n,)."""
    _, displacement = _displacement(model, pixel + moved, on_array, np.zeros((1, 2)), None)
    return displacement[:, 0] + per_pitch[:, None] * displacement[:, 1]


def linear_in_disparity(planes: PlanePair, values: Floats) -> tuple[Floats, Floats]:
    """Intercept at disparity 0 and slope over disparity / pitch of values (2, ...) on two planes."""
    slope = (values[1] - values[0]) / (planes[1].disparity_per_pitch - planes[0].disparity_per_pitch)
    return values[0] - slope * planes[0].disparity_per_pitch, slope
