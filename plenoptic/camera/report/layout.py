"""Section of a camera with the rays of one pixel, and its view: by a few rays, without compiling anything."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.assembly import Rigid, rigid
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.report.focus import plane_in_front, sharp_image
from plenoptic.camera.report.optics import Cone, camera_cone, opening_width
from plenoptic.core.rays import Frustum
from plenoptic.core.values import Floats
from plenoptic.optics.lens.analysis.few_rays import few_reverse_rays
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.microlens.lenslets import Lenslets

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_UP = 0.6
"""The pixel whose rays are drawn lies this far up from the middle of the sensor, over half its height."""
_ASIDE = 0.55
"""It sees the iris this far from its centre, over its semi-diameter."""
_RAYS = 7
_SHOWN = 2.6
"""Microlenses of the detail reach this many pitches up and down."""
_FRACTIONS = np.linspace(1.0, 0.02, 50)
"""Of the way to the corners of the sensor, at which the field is looked for: no light may reach the corners."""
_AIMS = 5


class PixelRays(NamedTuple):
    """The rays of one pixel, the array and the sensor, all in the lens's frame; (..., 3), mm."""

    pixel: tuple[int, int]
    """Row and column."""
    paths: Floats
    """(n, k, 3): from the pixel through its microlens and the elements of the lens, nan from where a ray is lost."""
    onwards: Floats
    """(n, 3): directions in front of the lens."""
    sensor: Rigid
    array: Rigid | None
    """From its front principal plane; None without microlenses, as the next two."""
    lenses: Lenslets | None
    """The microlenses in the column of that of the pixel."""
    separation: float
    """From the array's front to its rear principal plane."""


def pixel_rays(camera: PlenopticCamera) -> PixelRays:
    """The rays of a pixel in the upper half of the sensor, from its centre to a line across its microlens."""
    back = rigid(camera.lens_placement, 0.0).inverse()
    sensor = back.of(rigid(camera.sensor_placement, camera.z_sensor))
    up, cone = 0.5 * _UP * camera.sensor.size[0], camera_cone(camera)
    if camera.microlenses is None:
        return _of_sensor(camera, sensor, cone, up)
    array, (wide, high) = camera.microlenses, camera.microlenses.pitches
    place = back.of(rigid(camera.microlenses_placement, camera.stop_to_microlenses))
    up = up / (1.0 + camera.microlenses_to_sensor * cone.vergence)
    middle = array.nearest(np.array([[0.0, up]]))[0]
    reach = np.array([0.3 * wide, _SHOWN * high])
    lenses = array.lenses(middle - reach, middle + reach)
    k = int(np.hypot(*(lenses.design - middle).T).argmin())
    # Light from there in the iris, through the centre of the microlens, in the array's own axes.
    aside = lenses.centre[k] * cone.vergence - (0.0, _ASIDE * cone.slope)
    pixel, at = _pixel_met(camera, sensor, place, lenses.centre[k], aside)
    half = 0.5 * opening_width(array)
    across = lenses.centre[k] + half * np.linspace(-1.0, 1.0, _RAYS if half else 1)[:, None] * (0.0, 1.0)
    in_array = place.inverse().points(at)
    behind = (in_array[:2] - across) / (in_array[2] - array.principal_separation)
    power = lenses.power[k] * array.power_factor(camera.wavelength) if array.model.focuses else 0.0
    before = behind + (across - lenses.axis[k]) * power
    on_array = place.points(np.column_stack([across, np.zeros(len(across))]))
    towards = place.directions(-np.column_stack([before, np.ones(len(before))]))
    points, directions = _into_scene(camera, on_array, towards)
    start = np.broadcast_to(at, (len(across), 1, 3))
    paths = np.concatenate([start, points], axis=1)
    return PixelRays(pixel, paths, directions, sensor, place, lenses, array.principal_separation)


def _of_sensor(camera: PlenopticCamera, sensor: Rigid, cone: Cone, up: float) -> PixelRays:
    row, column = np.rint(camera.sensor.pixel_of((0.0, up))).astype(int).tolist()
    at = sensor.points(np.append(camera.sensor.centre_of(row, column), 0.0))
    slopes = at[1] * cone.vergence - cone.slope * np.linspace(-0.98, 0.98, _RAYS)
    towards = -np.column_stack([np.full(_RAYS, at[0] * cone.vergence), slopes, np.ones(_RAYS)])
    points, directions = _into_scene(camera, np.tile(at, (_RAYS, 1)), towards)
    return PixelRays((row, column), points, directions, sensor, None, None, 0.0)


def _pixel_met(
    camera: PlenopticCamera, sensor: Rigid, array: Rigid, centre: Floats, slopes: Floats
) -> tuple[tuple[int, int], Floats]:
    """The pixel on which light lands that leaves a microlens's centre with some slopes, and its own centre."""
    assert camera.microlenses is not None
    start = array.points(np.append(centre, camera.microlenses.principal_separation))
    along, normal = array.directions(np.append(slopes, 1.0)), sensor.turn[:, 2]
    hit = start + along * (normal @ (sensor.shift - start)) / (normal @ along)
    last = np.array(camera.sensor.shape) - 1
    pixel = camera.sensor.pixel_of(sensor.inverse().points(hit)[:2])
    row, column = np.clip(np.rint(pixel), 0, last).astype(int).tolist()
    return (row, column), sensor.points(np.append(camera.sensor.centre_of(row, column), 0.0))


def _into_scene(camera: PlenopticCamera, at: Floats, towards: Floats) -> tuple[Floats, Floats]:
    return few_reverse_rays(camera.lens, at, towards, camera.wavelength)


def plane_of_focus(camera: PlenopticCamera, focal_length: float | None) -> float:
    """Z of the plane in focus by Gaussian optics through microlenses of a focal length; nan for none."""
    return plane_in_front(camera, camera.stop_to_microlenses + sharp_image(camera, focal_length))


def camera_frustum(camera: PlenopticCamera) -> Frustum:
    """The rays through the centre of the iris from the corners of the sensor, or from as far out as light gets."""
    cone, array = camera_cone(camera), camera.microlenses
    stretch = 1.0 + camera.microlenses_to_sensor * cone.vergence
    height, width = (0.5 * size / stretch for size in camera.sensor.size)
    corners = np.array([[-width, -height], [width, -height], [width, height], [-width, height]])
    for part in _FRACTIONS:
        places, directions = _through_iris(camera, part * corners, cone)
        if np.isfinite(directions).all():
            break
    else:  # its centre is opaque
        places, directions = _through_iris(camera, _FRACTIONS[-1] * corners, cone, clipping=False)
    whole = rigid(camera.lens_placement, 0.0)
    if camera.pose is not None:
        whole = Rigid(np.asarray(camera.pose.rotation), np.asarray(camera.pose.position)).of(whole)
    z, in_focus = plane_of_focus(camera, None if array is None else array.focal_length), None
    if math.isfinite(z):
        in_focus = whole.points(places + (z - places[:, 2:]) / directions[:, 2:] * directions)
    return Frustum(whole.points(places), whole.directions(directions), in_focus)


def _through_iris(
    camera: PlenopticCamera, points: Floats, cone: Cone, *, clipping: bool = True
) -> tuple[Floats, Floats]:
    """Rays from points of the array's plane through the centre of the iris: where they leave the lens, and how.

    The slope along the radius is corrected by the Gaussian image of the distance from that centre.
    """
    lens, array = camera.lens, camera.microlenses
    start = np.column_stack([points, np.full(len(points), camera.stop_to_microlenses)])
    if array is not None and array.walls is Walls.OPAQUE:
        # Each microlens is a camera of its own, whose field the walls leave.
        towards = np.column_stack([np.sign(points) * cone.slope, -np.ones(len(points))])
        return start, towards / np.linalg.norm(towards, axis=1, keepdims=True)
    if lens.model is LensModel.NONE:
        return np.zeros_like(start), -start / np.linalg.norm(start, axis=1, keepdims=True)
    slopes, at_iris = points * cone.vergence, len(lens.elements) - lens.iris_index
    for _ in range(_AIMS):
        towards = -np.column_stack([slopes, np.ones(len(points))])
        traced, _ = few_reverse_rays(lens, start, towards, camera.wavelength, clipping=False)
        slopes = slopes + traced[:, at_iris, :2] * (cone.slope / lens.stop.semi_diameter)
    towards = -np.column_stack([slopes, np.ones(len(points))])
    traced, directions = few_reverse_rays(lens, start, towards, camera.wavelength, clipping=clipping)
    return traced[:, -1], directions


def camera_layout(camera: PlenopticCamera, figure: Figure | None = None) -> Figure:
    """Draw a camera with the rays of one pixel; see `PlenopticCamera.layout`."""
    from plenoptic.plots.camera_layout import plot_camera_layout

    return plot_camera_layout(camera, pixel_rays(camera), figure)
