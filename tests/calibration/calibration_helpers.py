"""Cameras with tolerances, and what they see of boards."""

from __future__ import annotations

import dataclasses

import numpy as np

import plenoptic as pl
from plenoptic.calibration.fitting.geometry import project_centres, project_corners, project_views
from plenoptic.calibration.twin import FixedParts, object_origin
from plenoptic.core.motions.rotation import rotation_about
from plenoptic.optics.lens.placement import Placement

GALILEAN, KEPLERIAN = (123.3, 1.7), (156.0, 1.9)
"""Distances from the iris to the array and from there to the sensor."""


def camera_as_built(
    seed=0, *, distances=GALILEAN, lattice=pl.Lattice.HEXAGONAL, model=pl.LensModel.THIN, shape=(700, 900)
):
    """A camera whose array and sensor stand somewhat off their designed places."""
    rng = np.random.default_rng(seed)
    camera = pl.PlenopticCamera(
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0)).with_model(model),
        sensor=pl.Sensor(shape=shape, pixel_pitch=0.010),
        stop_to_microlenses=distances[0],
        microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=lattice),
        microlenses_to_sensor=distances[1],
    )
    built = camera.moved(
        pl.CameraPart.MICROLENSES,
        shift=(*rng.uniform(-0.3, 0.3, 2), rng.uniform(-0.5, 0.5)),
        tilt=(*rng.uniform(-2e-3, 2e-3, 2), rng.uniform(-0.02, 0.02)),
    )
    return built.moved(pl.CameraPart.SENSOR, shift=(*rng.uniform(-0.2, 0.2, 2), 0.0))


def board_points(bend=0.0, seed=0, *, columns=7, rows=5, square=4.0):
    """Points of a board as designed, and as it is: displaced by normal errors of a standard deviation in mm."""
    design = np.stack(np.meshgrid(np.arange(columns), np.arange(rows), [0.0]), axis=-1).reshape(-1, 3) * square
    return design, design + bend * np.random.default_rng(seed).standard_normal(design.shape)


def board_in_view(board, rng, *, tilt=0.5, depths=(-500.0, -330.0)):
    """A board in the camera's frame, tilted at random."""
    axis = np.append(rng.standard_normal(2), 0.3 * rng.standard_normal())
    turn = rotation_about(axis, rng.uniform(0.4, 1.0) * tilt)
    place = np.append(rng.uniform(-2.0, 2.0, 2), rng.uniform(*depths))
    return (board - board.mean(axis=0)) @ turn.T + place


def observed(camera, boards, design, *, noise=(0.3, 0.05), seed=0):
    """Observations of boards (f, p, 3) in the camera's frame, and of its micro images, with normal noise in pixels."""
    rng, parts = np.random.default_rng(seed), []
    for frame, board in enumerate(boards):
        seen = pl.project(camera, board, rays=32, progress=False)
        seen = seen.selected(seen.passes & seen.visible & np.isfinite(seen.pixel).all(axis=1))
        parts.append((seen.index, seen.pixel, np.full(len(seen), frame), seen.point))
    index, pixel, frame, point = (np.concatenate(part) for part in zip(*parts, strict=True))
    centres = pl.microlens_centres(camera, progress=False)
    return pl.calibration.Observations(
        index=index,
        pixel=pixel + noise[0] * rng.standard_normal(pixel.shape),
        frame=frame,
        point=point,
        board=design,
        centre_index=centres.index,
        centre_pixel=centres.pixel + noise[1] * rng.standard_normal(centres.pixel.shape),
        sensor=camera.sensor,
        lattice=camera.microlenses.lattice,
    )


def boards_in_view(board, n, seed=0, **options):
    rng = np.random.default_rng(seed + 1000)
    return [board_in_view(board, rng, **options) for _ in range(n)]


NOMINAL = pl.calibration.NominalCamera(focal_length=50.0, f_number=4.0)
SENSOR = pl.Sensor(shape=(600, 800), pixel_pitch=0.011)
P = pl.calibration.Parameter


def parameters(**changes):
    """A thin lens of 51 mm before a focused array."""
    values = np.zeros(len(P))
    usual = {"FOCAL_LENGTH": 51.0, "LENS_TO_ARRAY": 62.5, "ARRAY_TO_SENSOR": 0.8, "PITCH": 0.254, "TURN": 0.3}
    usual |= {
        "SHIFT_X": 0.04,
        "SHIFT_Y": -0.05,
        "TILT_X": 1e-3,
        "TILT_Y": -2e-3,
        "AXIS_ROW": 290.0,
        "AXIS_COLUMN": 420.0,
    }
    for name, number in (usual | changes).items():
        values[P[name]] = number
    return values


def layout(values, lattice=pl.Lattice.HEXAGONAL, sensor=SENSOR):
    reach = int(0.8 * max(sensor.size) / values[P.PITCH])
    return FixedParts(sensor, lattice, 4.0, (0.4,), (0, 0), (-reach, -reach), (reach, reach))


def simulated(
    values, boards, design, *, noise=(0.0, 0.0), seed=0, lattice=pl.Lattice.HEXAGONAL, by_point=0.0, by_frame=0.0
):
    """Observations by the formulas, with errors of whole board points (pixels) and frames (relative)."""
    plan, rng = layout(values, lattice), np.random.default_rng(seed)
    steps = np.arange(plan.first[0], plan.last[0] + 1)
    index = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    centre, _ = project_centres(values, index @ plan.basis, SENSOR.pixel_pitch)
    inside = ((centre > 4) & (centre < np.array(SENSOR.shape) - 5)).all(axis=1)
    index, centre = index[inside], centre[inside]
    radius, parts = 0.45 * values[P.PITCH] / SENSOR.pixel_pitch, []
    for frame, board in enumerate(boards):
        for point, place in enumerate(board):
            seen = project_corners(
                values, index @ plan.basis, np.tile(place, (len(index), 1)), SENSOR.pixel_pitch
            ).pixel
            rows = np.hypot(*(seen - centre).T) < radius
            # An error of a frame that no pose takes up: its micro images are enlarged.
            common = by_point * rng.standard_normal(2) + by_frame * np.sin(9.0 * frame) * (seen - centre)[rows]
            parts.append((index[rows], seen[rows] + common, np.full(rows.sum(), frame), np.full(rows.sum(), point)))
    lenses, pixel, frame, point = (np.concatenate(part) for part in zip(*parts, strict=True))
    return pl.calibration.Observations(
        index=lenses,
        pixel=pixel + noise[0] * rng.standard_normal(pixel.shape),
        frame=frame,
        point=point,
        board=design,
        centre_index=index,
        centre_pixel=centre + noise[1] * rng.standard_normal(centre.shape),
        sensor=SENSOR,
        lattice=lattice,
    )


def boards_of_50mm(board, n=10, seed=0, **options):
    return boards_in_view(board, n, seed, **({"depths": (-520.0, -330.0)} | options))


def in_thin_axes(camera, points):
    """Points of the scene, from the plane of a thin lens."""
    return points - [0.0, 0.0, object_origin(camera)]


def blurred(observations, lengths, values, boards, noise=0.05):
    """Blur of corners behind microlenses of several focal lengths, by a camera of some values."""
    f, array, gap, pitch = values[:4]
    depth = -np.array(boards)[observations.frame, observations.point, 2]
    power = 1.0 / np.array(lengths)[(observations.index[:, 0] - observations.index[:, 1]) % len(lengths)]
    blur = 0.5 * pitch * gap * (power - 1.0 / gap - 1.0 / (array - f * depth / (depth - f))) / 0.011
    blur += noise * np.random.default_rng(3).standard_normal(len(blur))
    return dataclasses.replace(observations, blur=blur)


def true_values(camera, calibration, pivot=None):
    """Values of the parameters of a camera, with the pivot of a calibration."""
    pivot = calibration.layout.pivot if pivot is None else pivot
    points = pl.paraxial.cardinal_points(camera.lens)
    array, sensor = camera.microlenses_placement, camera.sensor_placement or Placement()
    normal = array.rotation[:, 2]
    at = np.add(array.shift, (0.0, 0.0, camera.stop_to_microlenses))
    crossing = normal @ at / normal[2]
    pivot = array.rotation[:, :2] @ (camera.microlenses.basis.T @ np.array(pivot)) + at
    tilt_y = np.arctan2(normal[0], normal[2])
    tilt_x = -np.arcsin(normal[1])
    cx, sx, cy, sy = np.cos(tilt_x), np.sin(tilt_x), np.cos(tilt_y), np.sin(tilt_y)
    tilt = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]) @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    in_plane = tilt.T @ (pivot - [0.0, 0.0, crossing])
    flat = tilt.T @ array.rotation
    axis = camera.sensor.pixel_of(-np.array(sensor.shift[:2]))
    values = np.zeros(len(P))
    values[P.FOCAL_LENGTH] = points.efl
    values[P.LENS_TO_ARRAY] = crossing - points.rear_principal
    values[P.ARRAY_TO_SENSOR] = camera.z_sensor + sensor.shift[2] - crossing
    values[P.PITCH] = camera.microlenses.pitch
    values[P.TURN] = np.arctan2(flat[1, 0], flat[0, 0])
    values[[P.SHIFT_X, P.SHIFT_Y]] = in_plane[:2]
    values[[P.TILT_X, P.TILT_Y]] = tilt_x, tilt_y
    values[[P.AXIS_ROW, P.AXIS_COLUMN]] = axis
    return values


def parameters_1_0(**changes):
    """A thin lens before an unfocused array, like a Lytro camera's."""
    usual = {"FOCAL_LENGTH": 51.0, "LENS_TO_ARRAY": 58.0, "ARRAY_TO_SENSOR": 0.5, "PITCH": 0.127}
    return parameters(**(usual | changes))


def seen_in_views(values, points, offsets, main_lens=None):
    """Lattice positions, in pitches from the pivot, and pixels at which points (n, 3) are seen at offsets (n, 2)."""
    position, step = np.zeros((len(points), 2)), 1e-3

    def miss(at):
        centre, _ = project_centres(values, at, SENSOR.pixel_pitch, main_lens)
        return project_views(values, at, centre + offsets, points, SENSOR.pixel_pitch, main_lens).pixel

    # The image of a point on the array's axis is a first guess; then Newton's method, of nearly linear functions.
    depth, f = -points[:, 2], values[P.FOCAL_LENGTH]
    z = f * depth / (depth - f)
    centre = (points[:, :2] * (-z / depth)[:, None] * (values[P.LENS_TO_ARRAY] / z)[:, None]) / values[P.PITCH]
    turn = values[P.TURN]
    position = centre @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for _ in range(5):
        value = miss(position)
        slope = np.stack([(miss(position + s) - value) / step for s in step * np.eye(2)], axis=2)
        position = position - np.linalg.solve(slope, value[:, :, None])[:, :, 0]
    centre, _ = project_centres(values, position, SENSOR.pixel_pitch, main_lens)
    return position, centre + offsets


def simulated_views(values, boards, design, *, noise=(0.0, 0.0), seed=0, radius=4.2, main_lens=None):
    """Observations of corners in views by the formulas, with errors of lattice positions in pixels."""
    plan, rng = layout(values), np.random.default_rng(seed)
    steps = np.arange(plan.first[0], plan.last[0] + 1)
    index = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    centre, _ = project_centres(values, index @ plan.basis, SENSOR.pixel_pitch, main_lens)
    inside = ((centre > 4) & (centre < np.array(SENSOR.shape) - 5)).all(axis=1)
    reach = np.arange(-int(radius), int(radius) + 1)
    views = np.stack(np.meshgrid(reach, reach, indexing="ij"), axis=-1).reshape(-1, 2)
    views = views[np.hypot(*views.T) <= radius]
    frame, point, view = (
        each.ravel() for each in np.meshgrid(*map(np.arange, (len(boards), len(design), len(views))), indexing="ij")
    )
    position, pixel = seen_in_views(values, np.array(boards)[frame, point], views[view].astype(float), main_lens)
    shown = ((pixel > 8) & (pixel < np.array(SENSOR.shape) - 9)).all(axis=1)
    error = noise[0] * SENSOR.pixel_pitch / values[P.PITCH] * rng.standard_normal(position.shape)
    # A view has its offset from the micro image where the corner is taken to be.
    pixel += project_centres(values, position + error, SENSOR.pixel_pitch, main_lens)[0]
    pixel -= project_centres(values, position, SENSOR.pixel_pitch, main_lens)[0]
    return pl.calibration.Observations(
        index=((position + error) @ np.linalg.inv(plan.basis))[shown],
        pixel=pixel[shown],
        frame=frame[shown],
        point=point[shown],
        board=design,
        centre_index=index[inside],
        centre_pixel=centre[inside] + noise[1] * rng.standard_normal((inside.sum(), 2)),
        sensor=SENSOR,
    )
