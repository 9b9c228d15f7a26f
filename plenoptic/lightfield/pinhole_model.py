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

    lens = model.unclipped if deviation is None else model.lens
    position, slope, _ = rays_at_array(model.axes, model.array, pixel, on_array)
    starts = position, slope, np.zeros(len(pixel)) if deviation is None else deviation
    throughput, displacement = np.empty(len(pixel)), np.empty((len(pixel), 2, 2))
    fill_displacement(throughput, displacement, (pixel, on_array), starts, points, lens, _lens_records(model))
    return throughput, displacement


def chord_disparity(
    model: PinholeModel,
    pixel: Floats,
    lens: NDArray[np.int64],
    index: NDArray[np.int64],
    steps: NDArray[np.int64],
    per_pitch: Floats,
) -> Floats:
    """(n,): chord disparity over the pitch, for points that pixels (n, 2) see at model disparities (n,).

    Chief rays pass microlenses `lens` (n,) of indices (k, 2) and their neighbours, as in `GroundTruth.chord_disparity`.
    """
    chord, with_own = np.empty(len(pixel)), np.vstack([np.zeros((1, 2), np.int64), steps])
    centres = [lenses_at(model.array, index + step).axis for step in with_own]
    images = [orthogonal_pixels(model.axes, centre) for centre in centres]

    def fill(start: int) -> None:
        block = slice(start, start + _BLOCK)
        centre, projected = ([places[lens[block]] for places in each] for each in (centres, images))
        chord[block] = _chord_disparity(model, pixel[block], centre, projected, steps, per_pitch[block])

    for _ in run_in_order(fill, range(0, len(pixel), _BLOCK), threads=model.threads):
        pass
    return chord


def _chord_disparity(
    model: PinholeModel,
    pixel: Floats,
    centres: list[Floats],
    images: list[Floats],
    steps: NDArray[np.int64],
    per_pitch: Floats,
) -> Floats:
    """Chord disparity over the pitch of pixels (n, 2), by the centres of their microlenses and of the neighbours.

    `images` are the orthogonal projections of these centres onto the sensor, in pixels.
    """
    axes, local = model.axes, [model.axes.local(centre) for centre in centres]
    slope, expected = rays_at_array(axes, model.array, pixel, centres[0])[1], np.empty_like(pixel)
    _, displacement = _displacement(model, pixel, centres[0], np.zeros((1, 2)), None)
    offset = displacement[:, 0] + per_pitch[:, None] * displacement[:, 1]
    along, length, changes = np.zeros(len(pixel)), np.zeros(len(pixel)), dict[tuple[int, ...], Floats]()
    for (down, right), centre, position, image in zip(steps.tolist(), centres[1:], local[1:], images[1:], strict=True):
        baseline = image - images[0]
        expected = pixel - offset + (1.0 - per_pitch)[:, None] * baseline
        paraxial = slope - per_pitch[:, None] * (position - local[0]) / axes.parts.distance
        # Aberrations turn the rays of opposite neighbours by opposite angles, nearly.
        chief = paraxial - changes.get((-down, -right), 0.0)
        hit = _chief_hits(model, chief, centre, position, expected, per_pitch)
        changes[down, right] = chief - paraxial
        along += _dot(hit - expected - offset, baseline)
        length += _dot(baseline, baseline)
    return per_pitch - along / length


def _chief_hits(
    model: PinholeModel, slope: Floats, centre: Floats, local: Floats, expected: Floats, per_pitch: Floats
) -> Floats:
    """Pixels (n, 2) hit by chief rays of points that the pinhole model images at `expected` (n, 2).

    `slope` (n, 2) has estimates of the slopes of the rays, and gets the slopes.
    """
    from plenoptic.lightfield.kernels.displacement import fill_slopes_to_points

    axes, sensor, refraction = model.axes, model.axes.camera.sensor, model.array.model.refraction
    corner, *sides = sensor.centre_of(np.array([0, 1, 0]), np.array([0, 0, 1]))
    per_pixel = axes.parts.sensor_to_local.turn[:2, :2] @ (np.array(sides) - corner).T / axes.parts.distance
    # A plate displaces rays by their slopes, which depend on the displacement: iterate.
    for _ in range(2):
        front = refraction.shift_chief_rays(model.array, local, slope, axes.camera.wavelength, False)
        target = 2.0 * local - front, centre, expected, per_pitch
        fill_slopes_to_points(slope, target, per_pixel, model.unclipped, _lens_records(model))
        if front is local:
            break
    rear = refraction.shift_chief_rays(model.array, local, slope, axes.camera.wavelength, True)
    return np.asarray(sensor.pixel_of(axes.on_sensor(rear, slope)))


def _lens_records(model: PinholeModel) -> tuple[Floats, Floats, Floats, Floats]:
    """Frame of the array in the lens, positions and disparities (2,) of the planes, and their maps, for kernels."""
    z, disparity = np.array([(plane.z, plane.disparity_per_pitch) for plane in model.planes]).T.copy()
    to_lens = model.axes.parts.local_to_lens
    return np.column_stack([to_lens.turn, to_lens.shift]), z, disparity, model.maps


def _dot(a: Floats, b: Floats) -> Floats:
    """Scalar products (n,) of vectors (n, 2)."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1])


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


def linear_in_disparity(planes: PlanePair, values: Floats) -> tuple[Floats, Floats]:
    """Intercept at disparity 0 and slope over disparity / pitch of values (2, ...) on two planes."""
    slope = (values[1] - values[0]) / (planes[1].disparity_per_pitch - planes[0].disparity_per_pitch)
    return values[0] - slope * planes[0].disparity_per_pitch, slope
