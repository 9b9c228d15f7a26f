"""Quantities of a camera report: cone of light at the array, layout of microlens images, vignetting by rims.

All of it is on the axis of the camera as designed: placements of the array and the sensor do not matter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.focus import paraxial_focus
from plenoptic.optics.lens.gaussian.matrices import over, transfer_matrix
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, magnification, object_position
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.iris_points import hexapolar, square_grid
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays_reverse
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.stops.circle import CircularStop

_RIM = 1.0 - 1e-9
"""The rim of the iris is aimed at this much inside, so that rounding does not clip it."""
_ZOOMS, _ZOOM = 3, 65
"""A limit of the light is looked for in 65 places, then in 65 between two of them, and once more."""
_GRID = 32
"""Points a side of a cell in which microlens images are counted."""
_RINGS = 3
_CORNER_GRID = 15
_OPENED = 2.0
_MOST_PITCHES = 5.0
"""Microlenses farther apart are not looked at for overlap."""
_NEAREST = 64


class Cone(NamedTuple):
    """Light from the iris at a point of the axis behind the lens, by Gaussian optics."""

    vergence: float
    """1 over the distance from the exit pupil to the point in 1/mm; 0 for a telecentric lens."""
    slope: float
    """Of the rays from the rim of the exit pupil: its radius over that distance; 1 / (2 slope) is the f-number."""


def paraxial_cone(lens: LensStack, z: float, wavelength: float) -> Cone:
    """The cone at z on the axis, as the lens's model has it.

    With y' = A y + B u, u' = C y + D u from the iris to the last element and t from there to z, the rays from the rim h
    of the iris to the point have the slope h / (B + t D), and the exit pupil is at the distance (B + t D) / D.
    """
    if lens.model is LensModel.NONE:
        return Cone(1.0 / z, lens.stop.semi_diameter / z)
    if lens.model is LensModel.THIN:
        points = cardinal_points(lens, wavelength)
        distance = z - points.rear_principal
        return Cone(1.0 / distance, abs(points.entrance_pupil_semi_diameter / distance))
    last = len(lens.elements) - 1
    (_, b), (_, d) = transfer_matrix(lens, wavelength, lens.iris_index, last).tolist()
    across = float(lens.indices(wavelength)[0]) * b + (z - float(lens.vertices[-1])) * d
    return Cone(d / across, abs(lens.stop.semi_diameter / across))


def camera_cone(camera: PlenopticCamera) -> Cone:
    """The cone at the array, without microlenses at the sensor; between walls, that of a microlens's own field."""
    array = camera.microlenses
    if array is not None and array.walls is Walls.OPAQUE:
        # Each microlens is a camera of its own, whose field ends at the walls.
        return Cone(0.0, neighbour_distance(array) / (2 * camera.microlenses_to_sensor))
    return paraxial_cone(camera.lens, camera.stop_to_microlenses, camera.wavelength)


def traced_slope(lens: LensStack, z: float, wavelength: float) -> float:
    """Half the range of slopes of the rays from a point of the axis that leave the lens, by tracing; nan for none.

    The iris is taken as the circle around it; rims and other stops cut as they do.
    """
    round_lens = lens.with_stop(CircularStop(lens.stop.semi_diameter))

    def slopes(pupil: Floats) -> Floats:
        points = np.column_stack([np.zeros_like(pupil), pupil])
        rays = aimed_rays_reverse(round_lens, image_point=(0.0, 0.0), z_image=z, pupil=points, wavelength=wavelength)
        passed = round_lens.trace_reverse(rays).status == 0
        with np.errstate(invalid="ignore"):
            return np.where(passed, rays.direction[:, 1] / rays.direction[:, 2], np.nan)

    try:
        ends = [_outermost(slopes, end) for end in (-_RIM, _RIM)]
    except InvalidValueError:  # an exit pupil that is infinitely far cannot be aimed at in an ideal model
        return paraxial_cone(lens, z, wavelength).slope
    return 0.5 * abs(ends[1] - ends[0]) / _RIM


def _outermost(slopes: Callable[[Floats], Floats], end: float) -> float:
    """Slope of the ray nearest to one end of the diameter that passes."""
    low, high = -end, end
    position = math.nan
    for _ in range(_ZOOMS):
        pupil = np.linspace(low, high, _ZOOM)
        got = slopes(pupil)
        passing = np.flatnonzero(np.isfinite(got))
        if not passing.size:
            return math.nan
        last = int(passing[-1])
        position = float(got[last])
        if last == _ZOOM - 1:
            break
        low, high = float(pupil[last]), float(pupil[last + 1])
    return position


def object_plane(lens: LensStack, z_image: float, wavelength: float) -> float:
    """The plane that a lens images to z_image, as its model has it; without a lens it is that plane itself."""
    if lens.model is LensModel.NONE:
        return -math.inf if math.isinf(z_image) else z_image
    if lens.model is not LensModel.THIN:
        return object_position(lens, z_image, wavelength)
    points = cardinal_points(lens, wavelength)
    return points.rear_principal - points.efl - over(points.efl**2, z_image - points.rear_focus)


def image_plane(lens: LensStack, z_object: float, wavelength: float) -> float:
    """The inverse of `object_plane`; nan for nan."""
    without = lens.model is LensModel.NONE or math.isnan(z_object)
    return z_object if without else paraxial_focus(lens, z_object, wavelength)


def lateral_magnification(lens: LensStack, z_object: float, wavelength: float) -> float:
    """Height of the main lens's image over that of the object, as its model has it; 1 without a lens."""
    if lens.model is LensModel.NONE:
        return 1.0
    if lens.model is not LensModel.THIN:
        return magnification(lens, z_object, wavelength)
    points = cardinal_points(lens, wavelength)
    return (points.rear_focus - paraxial_focus(lens, z_object, wavelength)) / points.efl


def neighbour_distance(array: MicrolensArray) -> float:
    """Distance between nearest neighbours in mm; of a FREE lattice, the median around the axis."""
    if array.centres is None:
        return min(array.pitches)
    centres = np.asarray(array.centres)
    if len(centres) < 2:
        return min(array.pitches)
    chosen = np.argsort(np.hypot(*centres.T), kind="stable")[:_NEAREST]
    nearest = [np.partition(np.hypot(*(centres - centres[k]).T), 1)[1] for k in chosen.tolist()]
    return float(np.median(nearest))


def cell_area(array: MicrolensArray) -> float:
    """Area for each microlens in mm^2; of a FREE lattice, that of a square one with the distance of neighbours."""
    return neighbour_distance(array) ** 2 if array.lattice is Lattice.FREE else array.cell_area


def opening_width(array: MicrolensArray) -> float:
    """Least width of a microlens's opening in mm, from which the light of a point is spread; 0 for pinholes."""
    if not array.model.focuses:
        return 0.0
    opening = array.opening
    if math.isfinite(opening.radius):
        return 2.0 * opening.radius
    width = 2.0 * float(opening.edges[:, 2].min())
    return min(width, neighbour_distance(array)) if array.lattice is Lattice.FREE else width


def images_on_sensor(camera: PlenopticCamera, vergence: float) -> int:
    """Number of microlenses, as designed, whose image's centre lies on the sensor."""
    array = camera.microlenses
    assert array is not None
    height, width = camera.sensor.size
    stretch = abs(1.0 + camera.microlenses_to_sensor * vergence)
    # Rounding must not lose a lens on the border.
    half_x, half_y = (0.5 * size / stretch * (1 + 1e-9) for size in (width, height))
    if array.centres is not None:
        return int((np.abs(array.centres) <= (half_x, half_y)).all(axis=1).sum())
    # Columns run along y in all lattices: basis[1, 0] is 0.
    (along, rise), (_, step) = array.basis.tolist()
    last = math.floor(half_x / along)
    offset = rise * np.arange(-last, last + 1)
    return int((np.floor((half_y - offset) / step) - np.ceil((-half_y - offset) / step) + 1).sum())


def coverage(camera: PlenopticCamera, cone: Cone) -> tuple[float, float]:
    """Parts of a cell of the sensor that no microlens lights, and that several light.

    Rays from a point s of the sensor through the point c + d of a microlens at c with power F meet the exit pupil, D
    before the array, at D (c + d - s) / b - D d F + c + d; the pupil decides which pass.
    """
    array, b = camera.microlenses, camera.microlenses_to_sensor
    assert array is not None
    stop, stretch, factor = camera.lens.stop, 1.0 + b * cone.vergence, array.power_factor(camera.wavelength)
    blur = max(abs(stretch - b / f) for f in array.focal_lengths_at(camera.wavelength)) * array.opening.reach
    farthest = min((b * cone.slope + blur) / abs(stretch), _MOST_PITCHES * neighbour_distance(array))
    reach = farthest + 2.0 * neighbour_distance(array)
    lenses = array.lenses((-reach, -reach), (reach, reach))
    at = (np.arange(_GRID) + 0.5) / _GRID - 0.5
    basis = np.eye(2) * neighbour_distance(array) if array.lattice is Lattice.FREE else array.basis
    sensor = stretch * (np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2) @ basis)
    inside = _opening_points(array)
    lit = np.zeros(len(sensor), dtype=np.int64)
    for k in np.flatnonzero(lenses.transmission > 0).tolist():
        through = lenses.centre[k] + inside
        bent = through * cone.vergence - (through - lenses.axis[k]) * factor * float(lenses.power[k])
        if not array.model.focuses:
            bent = through * cone.vergence
        pupil = ((through - sensor[:, None]) / b + bent) * (stop.semi_diameter / cone.slope)
        lit += stop.contains(pupil[..., 0], pupil[..., 1]).any(axis=1)
    return float((lit == 0).mean()), float((lit > 1).mean())


def _opening_points(array: MicrolensArray) -> Floats:
    """Points (n, 2) of a microlens's opening."""
    if not array.model.focuses:
        return np.zeros((1, 2))
    opening = array.opening
    points = opening.reach * hexapolar(_RINGS)
    edges = opening.edges
    inside = (points @ edges[:, :2].T <= edges[:, 2] * (1 + 1e-9)).all(axis=1)
    corners = 0.999 * np.asarray(opening.corners) if len(edges) else np.empty((0, 2))
    return np.asarray(np.concatenate([points[inside], corners]))


class Corner(NamedTuple):
    """Light at the corner of the sensor that gets least."""

    pupil_fraction: float
    """Part of the light through the iris, in a grey mask each point by its transmission, that rims and stops leave."""
    chief_angle: float
    """Between the ray through the centre of the iris and the axis, behind the lens, in radians."""


def corner_light(lens: LensStack, corner: tuple[float, float], z: float, wavelength: float) -> Corner:
    """Light at the points (+-x, +-y) of a plane; nan where no ray can be aimed."""
    grid = square_grid(_CORNER_GRID)
    places = lens.stop.semi_diameter * grid.T
    full = lens.stop.transmission_at(*places)
    grid, full = grid[full > 0], full[full > 0]
    points = np.concatenate([np.zeros((1, 2)), grid])
    # Which rays the iris lets pass is known; left to tracing, rounding would decide at its edge and at cells of a mask.
    opened = lens.with_stop(CircularStop(_OPENED * lens.stop.semi_diameter))
    fractions, angles = [], []
    for x, y in {(sx * corner[0], sy * corner[1]) for sx in (-1, 1) for sy in (-1, 1)}:
        try:
            rays = aimed_rays_reverse(lens, image_point=(x, y), z_image=z, pupil=points, wavelength=wavelength)
        except InvalidValueError:
            return Corner(math.nan, math.nan)
        light = opened.trace_reverse(rays).weight[1:]
        fractions.append(float(full @ light / full.sum()) if len(grid) else math.nan)
        angles.append(math.acos(min(1.0, -float(rays.direction[0, 2]))))
    return Corner(min(fractions), max(angles))


def clearance(camera: PlenopticCamera) -> float:
    """Distance along z from the lens, rims included, to the first thing behind it, in mm; negative inside the lens."""
    array = camera.microlenses
    front = camera.stop_to_microlenses
    if array is not None:
        front -= array.model.rules.depths(array).front
    if camera.lens.model is LensModel.NONE:
        return front - float(camera.lens.vertices[-1])
    return front - max(float(profile[:, 0].max()) for profile in camera.lens.profiles())


def with_semi_diameter(lens: LensStack, semi_diameter: float) -> LensStack:
    """The same lens with its iris opened or closed, of the same shape."""
    stop = lens.stop
    scale = semi_diameter / stop.semi_diameter
    lengths = {"semi_diameter", "inner_semi_diameter", "blade_radius"}
    changes = {f.name: scale * getattr(stop, f.name) for f in dataclasses.fields(stop) if f.name in lengths}
    return lens.with_stop(dataclasses.replace(stop, **(changes | {"semi_diameter": semi_diameter})))
