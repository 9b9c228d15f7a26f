"""Illumination of array and sensor by traced rays: marginal rays, coverage by micro images, vignetting.

All of it is for the camera as designed: placements of the array and the sensor are ignored.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.camera.gaussian import Cone, neighbour_distance, opening_width, paraxial_cone
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.transmission import transmission_to
from plenoptic.optics.lens.loss_record import has_losses
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.modify import coated
from plenoptic.optics.lens.pupil.iris_points import INSIDE, hexapolar, outermost_finite, square_grid
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays_reverse
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.stops.circle import CircularStop

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

_POINTS = 65
"""Points tested in each search for a marginal ray."""
_LEAST_FILL = 0.5
"""Least diameter over distance of micro images that touch: their border may be wider than they are."""
_CELL_POINTS = 4181
"""Points of a cell at which micro images are counted: a Fibonacci number, whose lattice has no direction."""
_RINGS = 3
_CORNER_GRID = 15
_OPENING_FACTOR = 2.0
_NEAR_AXIS = 1e-3
"""Distance of points near the axis over that of the corners; their viewpoint differs from the axis's by its square."""
_MAX_PITCHES = 5.0
"""Largest distance in pitches of microlenses that are tested for overlap."""


def clear_pupil(lens: LensStack, z: float, wavelength: float) -> tuple[float, float]:
    """Half the range of slopes of the rays from an axial point that leave the lens, by tracing; nan if none does.

    Also the semi-diameter in mm of the iris that rims and other stops leave clear. The iris is the circle around it.
    """
    round_lens = lens.with_stop(CircularStop(lens.stop.semi_diameter))

    def slopes(pupil: Floats) -> Floats:
        points = np.column_stack([np.zeros_like(pupil), pupil])
        rays = aimed_rays_reverse(round_lens, image_point=(0.0, 0.0), z_image=z, pupil=points, wavelength=wavelength)
        passed = round_lens.trace_reverse(rays).status == 0
        with np.errstate(invalid="ignore"):
            return np.where(passed, rays.direction[:, 1] / rays.direction[:, 2], np.nan)

    try:
        (low, low_slope), (high, high_slope) = (outermost_finite(slopes, end, _POINTS) for end in (-INSIDE, INSIDE))
    except InvalidValueError:  # an exit pupil that is infinitely far cannot be aimed at in an ideal model
        return paraxial_cone(lens, z, wavelength).slope, lens.stop.semi_diameter
    return 0.5 * abs(high_slope - low_slope) / INSIDE, min(-low, high) / INSIDE * lens.stop.semi_diameter


def images_on_sensor(camera: PlenopticCamera, vergence: float) -> int:
    """Number of microlenses, as designed, that have the centre of their image on the sensor."""
    array = camera.microlenses
    assert array is not None
    height, width = camera.sensor.size
    stretch = abs(1.0 + camera.microlenses_to_sensor * vergence)
    # Rounding must not lose a lens on the border.
    half_x, half_y = (0.5 * size / stretch * (1 + 1e-9) for size in (width, height))
    if array.centres is not None:
        return int((np.abs(array.centres) <= (half_x, half_y)).all(axis=1).sum())
    if array.extent is not None:
        # An array may be turned on its sensor, and its extent with it.
        reach, place = math.hypot(half_x, half_y), camera.microlenses_placement
        turn = np.eye(2) if place is None else place.rotation[:2, :2]
        centres = array.lenses((-reach, -reach), (reach, reach)).design @ turn.T
        return int((np.abs(centres) <= (half_x, half_y)).all(axis=1).sum())
    # Columns run along y in all lattices: basis[1, 0] is 0.
    (along, rise), (_, step) = array.basis.tolist()
    last = math.floor(half_x / along)
    offset = rise * np.arange(-last, last + 1)
    return int((np.floor((half_y - offset) / step) - np.ceil((-half_y - offset) / step) + 1).sum())


def image_border(camera: PlenopticCamera, vergence: float) -> float:
    """Width in mm of the blurred border of micro images: the exit pupil at -D is blurred by d b |1/b - 1/f + 1/D|."""
    array, b = camera.microlenses, camera.microlenses_to_sensor
    assert array is not None
    focal_lengths = array.focal_lengths_at(camera.wavelength)
    return opening_width(array) * max(abs(1.0 + b * vergence - b / f) for f in focal_lengths)


def touching_fill(camera: PlenopticCamera, vergence: float) -> float:
    """Diameter over distance of micro images that touch with their border, which fades out; at least a half."""
    assert camera.microlenses is not None
    distance = neighbour_distance(camera.microlenses) * abs(1.0 + camera.microlenses_to_sensor * vergence)
    return max(1.0 - image_border(camera, vergence) / distance, _LEAST_FILL)


def coverage(camera: PlenopticCamera, cone: Cone) -> tuple[float, float]:
    """Fractions of a cell of the sensor that no microlens illuminates, and that several illuminate.

    A ray from a point s of the sensor through the point c + d of a microlens at c with power F crosses the exit pupil,
    D before the array, at D (c + d - s) / b - D d F + c + d. It passes if that point is inside the pupil. Points s
    that are farther from c (1 + b / D) than the light of the widest pupil are not looked at.
    """
    array, b = camera.microlenses, camera.microlenses_to_sensor
    assert array is not None
    stop, stretch = camera.lens.stop, 1.0 + b * cone.vergence
    factor = array.power_factor(camera.wavelength) if array.model.focuses else 0.0
    blur = max(abs(stretch - b / f) for f in array.focal_lengths_at(camera.wavelength)) * array.opening.reach
    farthest = min((b * cone.slope + blur) / abs(stretch), _MAX_PITCHES * neighbour_distance(array))
    reach = farthest + 2.0 * neighbour_distance(array)
    lenses = array.lenses((-reach, -reach), (reach, reach))
    index = np.arange(_CELL_POINTS)
    points = np.stack([(index + 0.5) / _CELL_POINTS, index * 0.5 * (math.sqrt(5.0) - 1.0) % 1.0], axis=1) - 0.5
    basis = np.eye(2) * neighbour_distance(array) if array.lattice is Lattice.FREE else array.basis
    sensor = stretch * (points @ basis)
    inside = _opening_points(array)
    n_lit, widest = np.zeros(len(sensor), dtype=np.int64), float(np.hypot(*inside.T).max())
    for k in np.flatnonzero(lenses.transmission > 0).tolist():
        power, decentre = factor * float(lenses.power[k]), lenses.centre[k] - lenses.axis[k]
        light = b * (cone.slope + math.hypot(*decentre) * abs(power)) + widest * abs(stretch - b * power)
        near = np.flatnonzero(np.hypot(*(sensor - stretch * lenses.centre[k]).T) <= light * (1 + 1e-9))
        through = lenses.centre[k] + inside
        slopes = through * cone.vergence - (through - lenses.axis[k]) * power
        pupil = ((through - sensor[near, None]) / b + slopes) * (stop.semi_diameter / cone.slope)
        n_lit[near] += stop.contains(pupil[..., 0], pupil[..., 1]).any(axis=1)
    return float((n_lit == 0).mean()), float((n_lit > 1).mean())


def _opening_points(array: MicrolensArray) -> Floats:
    """Sample points (n, 2) of a microlens's opening."""
    if not array.model.focuses:
        return np.zeros((1, 2))
    opening = array.opening
    points = opening.reach * hexapolar(_RINGS)
    edges = opening.edges
    inside_edges = (points @ edges[:, :2].T <= edges[:, 2] * (1 + 1e-9)).all(axis=1)
    corners = 0.999 * np.asarray(opening.corners) if len(edges) else np.empty((0, 2))
    return np.asarray(np.concatenate([points[inside_edges], corners]))


def corner_light(lens: LensStack, corner: tuple[float, float], z: float, wavelength: float) -> tuple[float, float]:
    """Vignetting at the darkest of the points (+-x, +-y) of a plane; nan if no ray can be aimed.

    Returns the unvignetted fraction of the light through the iris, each point weighted by its transmission, and the
    angle between chief ray and axis, behind the lens, in radians.
    """
    grid = square_grid(_CORNER_GRID)
    iris_points = lens.stop.semi_diameter * grid.T
    transmission = lens.stop.transmission_at(*iris_points)
    grid, transmission = grid[transmission > 0], transmission[transmission > 0]
    points = np.concatenate([np.zeros((1, 2)), grid])
    # The transmission of the iris is known; tracing it would be decided by rounding at its edge and at cells of a mask.
    opened_lens = coated(lens.with_stop(CircularStop(_OPENING_FACTOR * lens.stop.semi_diameter)), None)
    fractions, angles = [], []
    for x, y in {(sx * corner[0], sy * corner[1]) for sx in (-1, 1) for sy in (-1, 1)}:
        try:
            rays = aimed_rays_reverse(lens, image_point=(x, y), z_image=z, pupil=points, wavelength=wavelength)
        except InvalidValueError:
            return math.nan, math.nan
        light = opened_lens.trace_reverse(rays).weight[1:]
        fractions.append(float(transmission @ light / transmission.sum()) if len(grid) else math.nan)
        angles.append(math.acos(min(1.0, -float(rays.direction[0, 2]))))
    return min(fractions), max(angles)


def transmission_on_axis(lens: LensStack, z: float, wavelength: float) -> float | None:
    """Fraction of the unvignetted light to the point z of the axis that a lens transmits; None without coatings."""
    return transmission_to(lens, np.array([0.0, 0.0, z]), wavelength, _CORNER_GRID) if has_losses(lens) else None


def front_view(lens: LensStack, corner: tuple[float, float], z: float, wavelength: float) -> tuple[float, float]:
    """Field in front of the lens, and the caustic of its viewpoints, by chief rays of a plane's points (+-x, +-y).

    Returns the largest angle between the chief rays of opposite corners in radians, and the largest distance along the
    axis of their viewpoint from that of points near the axis in mm, 0 for a central projection; nan if a chief ray does
    not pass.
    """
    corners = [np.array(corner), np.array([corner[0], -corner[1]])]
    views = [_viewpoint(lens, point, z, wavelength) for point in corners]
    near_axis = [_viewpoint(lens, _NEAR_AXIS * point, z, wavelength) for point in corners]
    shifts = [abs(far[0] - near[0]) for far, near in zip(views, near_axis, strict=True)]
    return float(np.max([angle for _, angle in views])), float(np.max(shifts))


def _viewpoint(lens: LensStack, point: Floats, z: float, wavelength: float) -> tuple[float, float]:
    """Position z in mm at which chief rays of opposite points are closest in front of the lens, and their angle."""
    try:
        chief = [
            lens.trace_reverse(
                aimed_rays_reverse(lens, image_point=end, z_image=z, pupil=np.zeros((1, 2)), wavelength=wavelength)
            )
            for end in (point, -point)
        ]
    except InvalidValueError:
        return math.nan, math.nan
    origin, direction = (np.concatenate([getattr(ray, name) for ray in chief]) for name in ("origin", "direction"))
    if not np.isfinite(direction).all():
        return math.nan, math.nan
    distance = np.linalg.lstsq((direction * [[-1.0], [1.0]]).T, origin[0] - origin[1], rcond=None)[0]
    nearest = origin + distance[:, None] * direction
    half_chord = 0.5 * float(np.linalg.norm(direction[0] - direction[1]))
    return float(nearest[:, 2].mean()), 2.0 * math.asin(min(1.0, half_chord))


def clearance(camera: PlenopticCamera) -> float:
    """Distance along z from the lens, rims included, to array or sensor, in mm; negative inside the lens."""
    array = camera.microlenses
    front = camera.stop_to_microlenses
    if array is not None:
        front -= array.model.refraction.depths(array).front
    if camera.lens.model is LensModel.NONE:
        return front - float(camera.lens.vertices[-1])
    return front - max(float(profile[:, 0].max()) for profile in camera.lens.profiles())


def with_semi_diameter(lens: LensStack, semi_diameter: float) -> LensStack:
    """The same lens with its iris scaled to a semi-diameter in mm."""
    stop = lens.stop
    scale = semi_diameter / stop.semi_diameter
    lengths = {"semi_diameter", "inner_semi_diameter", "blade_radius"}
    changes = {f.name: scale * getattr(stop, f.name) for f in dataclasses.fields(stop) if f.name in lengths}
    return lens.with_stop(dataclasses.replace(stop, **(changes | {"semi_diameter": semi_diameter})))
