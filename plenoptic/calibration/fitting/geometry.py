"""Projection by a calibrated camera, and its derivatives.

The axes are those of the camera at the rear principal plane of the main lens: x to the right, y up, z towards the
sensor. Distances of objects count from the front principal plane. The chief ray of a microlens runs straight from the
image of a point, or from the centre of the exit pupil, through the centre of the microlens to the sensor. The array
crosses the axis at z = D, and the sensor is perpendicular to the axis at z = D + d.

Corners in micro images are compared on the sensor, which has no limit for images of points on the array. Corners in
views are compared in the plane of the image, with the ray from the pixel through the lattice position.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.fitting.traced_lens import TracedLens, exit_pupils, trace_rays, trace_sources
from plenoptic.core.values import Floats
from plenoptic.optics.lens.placement import rotation_about_axis


class Parameter(enum.IntEnum):
    """Parameters of a camera: lengths in mm, angles in rad.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [parameter.name for parameter in pl.calibration.Parameter][:4]
    ['FOCAL_LENGTH', 'LENS_TO_ARRAY', 'ARRAY_TO_SENSOR', 'PITCH']
    """

    FOCAL_LENGTH = 0
    """Of the main lens."""
    LENS_TO_ARRAY = 1
    """From its rear principal plane to the array, on the axis."""
    ARRAY_TO_SENSOR = 2
    """On the axis."""
    PITCH = 3
    """Distance of neighbouring microlenses."""
    TURN = 4
    """Rotation of the array about the axis."""
    SHIFT_X = 5
    """Position on the array of the microlens in the middle of the observed ones, from where the axis crosses it."""
    SHIFT_Y = 6
    TILT_X = 7
    """Rotation of the array about x, then about y."""
    TILT_Y = 8
    AXIS_ROW = 9
    """Pixel on the axis of the main lens."""
    AXIS_COLUMN = 10
    STRETCH = 11
    """Relative excess of the array's scale along its own y axis over that along x."""
    EXIT_PUPIL = 12
    """Distance of the exit pupil in front of the rear principal plane; 0 for a thin lens."""
    DISTORTION = 13
    """Relative increase of the image height per squared image height, 1/mm^2."""

    @property
    def unit(self) -> str:
        """Unit of its values; empty for a ratio."""
        units = {"TURN": "rad", "TILT_X": "rad", "TILT_Y": "rad", "AXIS_ROW": "px", "AXIS_COLUMN": "px"}
        return (units | {"STRETCH": "", "DISTORTION": "1/mm^2"}).get(self.name, "mm")


P = Parameter
COUNT = len(Parameter)


class LensCentres(NamedTuple):
    """Centres of microlenses (n, 3) and their derivatives (n, 3, COUNT)."""

    centre: Floats
    slope: Floats


def lenslets(parameters: Floats, grid: Floats) -> LensCentres:
    """Centres of microlenses at lattice positions (n, 2), in pitches from the pivot."""
    turn, pitch = parameters[P.TURN], parameters[P.PITCH]
    cosine, sine = math.cos(turn), math.sin(turn)
    turned = np.array([[cosine, sine], [-sine, cosine]])
    along = grid @ (np.array([[1.0], [1.0 + parameters[P.STRETCH]]]) * turned)
    plane = pitch * along + parameters[[P.SHIFT_X, P.SHIFT_Y]]
    about_x, about_y = (rotation_about_axis(axis, parameters[p]) for axis, p in ((0, P.TILT_X), (1, P.TILT_Y)))
    tilt = (about_y @ about_x)[:, :2]
    centre = plane @ tilt.T
    centre[:, 2] += parameters[P.LENS_TO_ARRAY]
    slope = np.zeros((len(grid), 3, COUNT))
    slope[:, 2, P.LENS_TO_ARRAY] = 1.0
    slope[:, :, P.PITCH] = along @ tilt.T
    slope[:, :, P.TURN] = pitch * np.column_stack([-along[:, 1], along[:, 0]]) @ tilt.T
    slope[:, :, P.STRETCH] = pitch * np.outer(grid[:, 1], tilt @ turned[1])
    slope[:, :, P.SHIFT_X], slope[:, :, P.SHIFT_Y] = tilt.T
    slope[:, :, P.TILT_X] = plane @ (about_y @ _quarter(0, about_x))[:, :2].T
    slope[:, :, P.TILT_Y] = plane @ (_quarter(1, about_y) @ about_x)[:, :2].T
    return LensCentres(centre, slope)


def _quarter(axis: int, turn: Floats) -> Floats:
    """Derivative of a rotation about a coordinate axis by its angle."""
    unit = np.zeros(3)
    unit[axis] = 1.0
    return np.asarray(np.cross(unit, turn.T).T)


def project_centres(
    parameters: Floats, grid: Floats, pixel_pitch: float, main_lens: TracedLens | None = None
) -> tuple[Floats, Floats]:
    """Centres of micro images: row and column (m, 2), and derivatives (m, 2, COUNT)."""
    lens = lenslets(parameters, grid)
    pupil = np.tile([0.0, 0.0, -parameters[P.EXIT_PUPIL]], (len(grid), 1))
    if main_lens is not None:
        distance, by_centre, by_f = exit_pupils(main_lens, parameters[P.FOCAL_LENGTH], lens.centre)
        pupil[:, 2] = -distance
    hit, slope, by_source = _hits(parameters, lens, pupil)
    slope[:, :, P.EXIT_PUPIL] -= by_source[:, :, 2]
    if main_lens is not None:
        moved = np.einsum("nj,njk->nk", by_centre, lens.slope)
        moved[:, P.FOCAL_LENGTH] += by_f
        slope -= by_source[:, :, 2:] * moved[:, None, :]
    return _to_pixels(parameters, hit, slope, pixel_pitch)


class Corners(NamedTuple):
    """Projected corners: row and column (n, 2), and derivatives by parameters and by the point in the camera."""

    pixel: Floats
    slope: Floats
    """(n, 2, COUNT)"""
    by_point: Floats
    """(n, 2, 3)"""


def project_corners(
    parameters: Floats, grid: Floats, points: Floats, pixel_pitch: float, main_lens: TracedLens | None = None
) -> Corners:
    """Project points (n, 3) in the camera's axes through microlenses at lattice positions (n, 2).

    A main lens of a prescription takes the place of the thin one, except for rays that it does not pass.
    """
    lens = lenslets(parameters, grid)
    image, by_point, by_focal_length, by_distortion = _images(parameters, points)
    by_centre = None
    if main_lens is not None:
        traced = trace_sources(main_lens, parameters[P.FOCAL_LENGTH], lens.centre, points)
        passes, by_centre = traced.passes, np.zeros_like(by_point)
        image[passes], by_point[passes] = traced.source[passes], traced.by_point[passes]
        by_focal_length[passes], by_centre[passes] = traced.by_focal_length[passes], traced.by_centre[passes]
        by_distortion[passes] = 0.0
    hit, slope, by_source = _hits(parameters, lens, image)
    if by_centre is not None:
        slope += by_source @ by_centre @ lens.slope
    slope[:, :, P.DISTORTION] += np.einsum("nij,nj->ni", by_source, by_distortion)
    slope[:, :, P.FOCAL_LENGTH] += np.einsum("nij,nj->ni", by_source, by_focal_length)
    pixel, slope = _to_pixels(parameters, hit, slope, pixel_pitch)
    on_sensor = np.stack([by_source[:, 1], -by_source[:, 0]], axis=1) / pixel_pitch
    return Corners(pixel, slope, on_sensor @ by_point)


def project_views(
    parameters: Floats,
    grid: Floats,
    pixel: Floats,
    points: Floats,
    pixel_pitch: float,
    main_lens: TracedLens | None = None,
) -> Corners:
    """Distances of images of points (n, 3) from rays from pixels (n, 2) through lattice positions (n, 2), in pixels.

    They are measured in the plane of the image, and those of a prescription in the plane of the point, times the
    magnification. An error of the lattice position leads to the same distance.
    """
    lens = lenslets(parameters, grid)
    image, by_point, by_focal_length, by_distortion = _images(parameters, points)
    ray, by_parameters = sensor_rays(parameters, lens, pixel, pixel_pitch)
    gap = lens.centre[:, 2:] - image[:, 2:]
    offset = image[:, :2] - lens.centre[:, :2] + gap * ray
    slope = gap[:, :, None] * by_parameters + ray[:, :, None] * lens.slope[:, 2:] - lens.slope[:, :2]
    across = np.concatenate([np.tile(np.eye(2), (len(ray), 1, 1)), -ray[:, :, None]], axis=2)
    slope[:, :, P.DISTORTION] += np.einsum("nij,nj->ni", across, by_distortion)
    slope[:, :, P.FOCAL_LENGTH] += np.einsum("nij,nj->ni", across, by_focal_length)
    by_point = across @ by_point
    if main_lens is not None:
        f = parameters[P.FOCAL_LENGTH]
        traced, beyond = trace_rays(main_lens, f, lens.centre, ray, points), -points[:, 2:] - f
        passes, m = traced.passes, (f / beyond)[:, :, None]
        offset[passes] = (m[:, 0] * traced.miss)[passes]
        by_point[passes] = (m * traced.by_point)[passes]
        by_point[passes, :, 2] += (traced.miss * f / beyond**2)[passes]
        slope[passes] = (m * (traced.by_centre @ lens.slope + traced.by_slope @ by_parameters))[passes]
        by_f = m[:, 0] * traced.by_focal_length - traced.miss * points[:, 2:] / beyond**2
        slope[passes, :, P.FOCAL_LENGTH] += by_f[passes]
    return Corners(*(np.stack([x[:, 1], -x[:, 0]], axis=1) / pixel_pitch for x in (offset, slope, by_point)))


def sensor_rays(parameters: Floats, lens: LensCentres, pixel: Floats, pixel_pitch: float) -> tuple[Floats, Floats]:
    """Slopes dx/dz, dy/dz (n, 2) of rays from lattice positions to pixels, and their derivatives (n, 2, COUNT)."""
    row, column = (pixel - parameters[[P.AXIS_ROW, P.AXIS_COLUMN]]).T * pixel_pitch
    length = parameters[P.LENS_TO_ARRAY] + parameters[P.ARRAY_TO_SENSOR] - lens.centre[:, 2:]
    ray = (np.column_stack([-column, row]) - lens.centre[:, :2]) / length
    slope = ray[:, :, None] * lens.slope[:, 2:] - lens.slope[:, :2]
    slope[:, 0, P.AXIS_COLUMN] += pixel_pitch
    slope[:, 1, P.AXIS_ROW] -= pixel_pitch
    for p in (P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR):
        slope[:, :, p] -= ray
    return ray, slope / length[:, :, None]


def _images(parameters: Floats, points: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Images (n, 3) of points by the main lens; derivatives by point (n, 3, 3), focal length and distortion (n, 3)."""
    f, k = parameters[P.FOCAL_LENGTH], parameters[P.DISTORTION]
    depth = -points[:, 2]
    beyond = depth - f
    m, z = -f / beyond, f * depth / beyond
    m_by_depth, m_by_f = f / beyond**2, -depth / beyond**2
    flat = m[:, None] * points[:, :2]
    square = (flat**2).sum(axis=1)
    # Derivative of the distorted position by the undistorted one.
    bend = (1.0 + k * square)[:, None, None] * np.eye(2) + 2.0 * k * flat[:, :, None] * flat[:, None, :]
    image = np.column_stack([(1.0 + k * square)[:, None] * flat, z])
    by_point = np.zeros((len(points), 3, 3))
    by_point[:, :2, :2] = m[:, None, None] * bend
    by_point[:, :2, 2] = -np.einsum("nij,nj->ni", bend, m_by_depth[:, None] * points[:, :2])
    by_point[:, 2, 2] = (f / beyond) ** 2
    by_f = np.column_stack([np.einsum("nij,nj->ni", bend, m_by_f[:, None] * points[:, :2]), (depth / beyond) ** 2])
    by_distortion = np.column_stack([square[:, None] * flat, np.zeros(len(points))])
    return image, by_point, by_f, by_distortion


def _hits(parameters: Floats, lens: LensCentres, source: Floats) -> tuple[Floats, Floats, Floats]:
    """Intersections (n, 2) with the sensor of lines from sources (n, 3) through microlenses.

    With derivatives by parameters (n, 2, COUNT), at constant sources, and by the source (n, 2, 3).
    """
    gap = lens.centre[:, 2] - source[:, 2]
    across = lens.centre[:, :2] - source[:, :2]
    s = (parameters[P.LENS_TO_ARRAY] + parameters[P.ARRAY_TO_SENSOR] - lens.centre[:, 2]) / gap
    hit = lens.centre[:, :2] + s[:, None] * across
    per_gap = across / gap[:, None]
    slope = (1.0 + s)[:, None, None] * (lens.slope[:, :2] - per_gap[:, :, None] * lens.slope[:, 2:])
    for p in (P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR):
        slope[:, :, p] += per_gap
    by_source = np.zeros((len(source), 2, 3))
    by_source[:, 0, 0] = by_source[:, 1, 1] = -s
    by_source[:, :, 2] = s[:, None] * per_gap
    return hit, slope, by_source


def _to_pixels(parameters: Floats, hit: Floats, slope: Floats, pixel_pitch: float) -> tuple[Floats, Floats]:
    """Row and column of points (n, 2) on the sensor, and their derivatives; columns run against x."""
    pixel = np.column_stack([hit[:, 1], -hit[:, 0]]) / pixel_pitch + parameters[[P.AXIS_ROW, P.AXIS_COLUMN]]
    slope = np.stack([slope[:, 1], -slope[:, 0]], axis=1) / pixel_pitch
    slope[:, 0, P.AXIS_ROW] += 1.0
    slope[:, 1, P.AXIS_COLUMN] += 1.0
    return pixel, slope


def rotations(vectors: Floats) -> Floats:
    """(n, 3, 3) rotations about vectors (n, 3) by their lengths in radians (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = (vectors / np.where(angle > 0, angle, 1.0)[:, None]).T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    sine, versine = np.sin(angle)[:, None, None], 2.0 * (np.sin(0.5 * angle) ** 2)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


class Poses(NamedTuple):
    """Rigid motions of boards into the camera: point p goes to turn @ p + shift."""

    turn: Floats
    """(n, 3, 3)"""
    shift: Floats
    """(n, 3)"""

    def advance(self, step: Floats) -> Poses:
        """Poses after small rotations about the camera's axes through the board's origin, and shifts: steps (n, 6)."""
        return Poses(rotations(step[:, :3]) @ self.turn, self.shift + step[:, 3:])


def rotate_points(poses: Poses, frame: NDArray[np.int64], points: Floats) -> Floats:
    """Points (n, 3) of boards, each rotated by the pose of its frame."""
    return np.asarray(np.einsum("nij,nj->ni", poses.turn[frame], points))
