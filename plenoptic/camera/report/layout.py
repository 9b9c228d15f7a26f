"""Section of a camera with the rays of one pixel, and its field of view: from a few rays, without compilation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.assembly import Rigid, assembly, lens_to_world, rigid
from plenoptic.camera.gaussian import Cone, camera_cone, opening_width, plane_of_focus
from plenoptic.core.rays import Frustum
from plenoptic.core.values import Floats
from plenoptic.optics.lens.analysis.few_rays import few_reverse_rays
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.microlens.lenslets import Lenslets

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

_PIXEL_HEIGHT = 0.6
"""Height above the sensor's centre of the pixel whose rays are drawn, over half the sensor's height."""
_IRIS_HEIGHT = 0.55
"""Height in the iris of the ray through the microlens's centre, over the semi-diameter."""
_RAYS = 7
_DETAIL_PITCHES = 2.6
"""Half height of the detail in pitches of microlenses."""
_FRACTIONS = np.linspace(1.0, 0.02, 50)
"""Fractions of the distance to the sensor's corners at which the field is searched: corners may be fully vignetted."""
_AIMING_STEPS = 5


class SectionRays(NamedTuple):
    """Rays of one pixel, the array and the sensor, in the lens's frame; (..., 3), mm."""

    pixel: tuple[int, int]
    """Row and column."""
    paths: Floats
    """(n, k, 3): from the pixel through its microlens and the elements of the lens, nan from where a ray is lost."""
    directions: Floats
    """(n, 3): directions in front of the lens."""
    sensor: Rigid
    array: Rigid | None
    """Pose of its front principal plane; None without microlenses."""
    lenses: Lenslets | None
    """Microlenses in the column of the pixel's microlens; None without microlenses."""
    separation: float
    """Distance from the array's front to its rear principal plane."""


def section_rays(camera: PlenopticCamera) -> SectionRays:
    """Trace rays of a pixel in the upper half of the sensor, from its centre through a line across its microlens."""
    back = rigid(camera.lens_placement, 0.0).inverse()
    sensor = back.of(rigid(camera.sensor_placement, camera.z_sensor))
    height, cone = 0.5 * _PIXEL_HEIGHT * camera.sensor.size[0], camera_cone(camera)
    if camera.microlenses is None:
        return _conventional_rays(camera, sensor, cone, height)
    array, (wide, high) = camera.microlenses, camera.microlenses.pitches
    array_pose = back.of(rigid(camera.microlenses_placement, camera.stop_to_microlenses))
    height = height / (1.0 + camera.microlenses_to_sensor * cone.vergence)
    height = min(height, max(float(array.half_extent[1]) - high, 0.0))
    middle = array.nearest(np.array([[0.0, height]]))[0]
    reach = np.array([0.3 * wide, _DETAIL_PITCHES * high])
    lenses = array.lenses(middle - reach, middle + reach)
    k = int(np.hypot(*(lenses.design - middle).T).argmin())
    # Ray from that height in the iris through the centre of the microlens, in the array's own axes.
    slopes = lenses.centre[k] * cone.vergence - (0.0, _IRIS_HEIGHT * cone.slope)
    pixel, pixel_centre = _hit_pixel(camera, sensor, array_pose, lenses.centre[k], slopes)
    half = 0.5 * opening_width(array)
    across = lenses.centre[k] + half * np.linspace(-1.0, 1.0, _RAYS if half else 1)[:, None] * (0.0, 1.0)
    in_array = array_pose.inverse().points(pixel_centre)
    behind = (in_array[:2] - across) / (in_array[2] - array.principal_separation)
    power = lenses.power[k] * array.power_factor(camera.wavelength) if array.model.focuses else 0.0
    before = behind + (across - lenses.axis[k]) * power
    on_array = array_pose.points(np.column_stack([across, np.zeros(len(across))]))
    towards = array_pose.directions(-np.column_stack([before, np.ones(len(before))]))
    points, directions = few_reverse_rays(camera.lens, on_array, towards, camera.wavelength)
    start = np.broadcast_to(pixel_centre, (len(across), 1, 3))
    paths = np.concatenate([start, points], axis=1)
    return SectionRays(pixel, paths, directions, sensor, array_pose, lenses, array.principal_separation)


def _conventional_rays(camera: PlenopticCamera, sensor: Rigid, cone: Cone, height: float) -> SectionRays:
    row, column = np.rint(camera.sensor.pixel_of((0.0, height))).astype(int).tolist()
    pixel_centre = sensor.points(np.append(camera.sensor.centre_of(row, column), 0.0))
    slopes = pixel_centre[1] * cone.vergence - cone.slope * np.linspace(-0.98, 0.98, _RAYS)
    towards = -np.column_stack([np.full(_RAYS, pixel_centre[0] * cone.vergence), slopes, np.ones(_RAYS)])
    starts = np.tile(pixel_centre, (_RAYS, 1))
    points, directions = few_reverse_rays(camera.lens, starts, towards, camera.wavelength)
    return SectionRays((row, column), points, directions, sensor, None, None, 0.0)


def _hit_pixel(
    camera: PlenopticCamera, sensor: Rigid, array: Rigid, centre: Floats, slopes: Floats
) -> tuple[tuple[int, int], Floats]:
    """Row and column, and centre, of the pixel hit by the ray from a microlens's centre with some slopes."""
    assert camera.microlenses is not None
    start = array.points(np.append(centre, camera.microlenses.principal_separation))
    along, normal = array.directions(np.append(slopes, 1.0)), sensor.turn[:, 2]
    hit = start + along * (normal @ (sensor.shift - start)) / (normal @ along)
    last = np.array(camera.sensor.shape) - 1
    hit_pixel = camera.sensor.pixel_of(sensor.inverse().points(hit)[:2])
    row, column = np.clip(np.rint(hit_pixel), 0, last).astype(int).tolist()
    return (row, column), sensor.points(np.append(camera.sensor.centre_of(row, column), 0.0))


def camera_frustum(camera: PlenopticCamera) -> Frustum:
    """Rays through the centre of the iris from the corners of the sensor, or from the edge of the field."""
    cone, array = camera_cone(camera), camera.microlenses
    stretch = 1.0 + camera.microlenses_to_sensor * cone.vergence
    height, width = (0.5 * size / stretch for size in camera.sensor.size)
    corners = np.array([[-width, -height], [width, -height], [width, height], [-width, height]])
    for part in _FRACTIONS:
        exit_points, directions = _through_iris(camera, part * corners, cone)
        if np.isfinite(directions).all():
            break
    else:  # the centre of the iris is opaque
        exit_points, directions = _through_iris(camera, _FRACTIONS[-1] * corners, cone, clipping=False)
    to_world = lens_to_world(camera, assembly(camera)) or rigid(None, 0.0)
    z, in_focus = plane_of_focus(camera, None if array is None else array.focal_length), None
    if math.isfinite(z):
        in_focus = to_world.points(exit_points + (z - exit_points[:, 2:]) / directions[:, 2:] * directions)
    return Frustum(to_world.points(exit_points), to_world.directions(directions), in_focus)


def _through_iris(
    camera: PlenopticCamera, points: Floats, cone: Cone, *, clipping: bool = True
) -> tuple[Floats, Floats]:
    """Aim rays from points of the array's plane at the centre of the iris: exit points of the lens, and directions.

    The slope along the radius is corrected by Gaussian optics from the distance to that centre.
    """
    lens, array = camera.lens, camera.microlenses
    start = np.column_stack([points, np.full(len(points), camera.stop_to_microlenses)])
    if array is not None and array.walls is Walls.OPAQUE:
        # Each microlens is a separate camera, whose field is limited by the walls.
        towards = np.column_stack([np.sign(points) * cone.slope, -np.ones(len(points))])
        return start, towards / np.linalg.norm(towards, axis=1, keepdims=True)
    if lens.model is LensModel.NONE:
        return np.zeros_like(start), -start / np.linalg.norm(start, axis=1, keepdims=True)
    slopes, at_iris = points * cone.vergence, len(lens.elements) - lens.iris_index
    for _ in range(_AIMING_STEPS):
        towards = -np.column_stack([slopes, np.ones(len(points))])
        traced, _ = few_reverse_rays(lens, start, towards, camera.wavelength, clipping=False)
        slopes = slopes + traced[:, at_iris, :2] * (cone.slope / lens.stop.semi_diameter)
    towards = -np.column_stack([slopes, np.ones(len(points))])
    traced, directions = few_reverse_rays(lens, start, towards, camera.wavelength, clipping=clipping)
    return traced[:, -1], directions
