"""Cameras made of parameters project as the formulas of the calibration do, to rounding."""

import numpy as np
import pytest
from calibration_helpers import SENSOR, P, board_points, boards_of_50mm, layout, parameters

import plenoptic as pl
from plenoptic.calibration.fitting.geometry import Poses, project_centres, project_corners, rotate_points
from plenoptic.calibration.fitting.traced_lens import trace_lens
from plenoptic.calibration.twin import object_origin, twin_camera

CASES = [{}, {"EXIT_PUPIL": 6.0}, {"EXIT_PUPIL": -5.0}, {"STRETCH": 2e-4, "TURN": -1.2, "TILT_X": 0.02}]


@pytest.mark.parametrize("changes", CASES, ids=str)
def test_twin_projects_as_the_formulas(changes):
    values = parameters(**changes)
    plan = layout(values)
    camera = twin_camera(values, plan)
    assert np.isclose(pl.paraxial.cardinal_points(camera.lens).efl, values[P.FOCAL_LENGTH], rtol=1e-12)
    centres = pl.microlens_centres(camera, progress=False)
    expected, _ = project_centres(values, centres.index @ plan.basis, SENSOR.pixel_pitch)
    assert len(centres) > 500
    np.testing.assert_allclose(centres.pixel, expected, rtol=0, atol=1e-8)
    points = boards_of_50mm(board_points()[1], 1)[0][::5]
    seen = pl.project(camera, np.add(points, (0.0, 0.0, object_origin(camera))), rays=32, progress=False)
    seen = seen.selected(seen.passes)
    assert len(seen) > 20
    expected = project_corners(values, seen.index @ plan.basis, points[seen.point], SENSOR.pixel_pitch).pixel
    # Chief rays are aimed to 1e-9 mm on the array.
    np.testing.assert_allclose(seen.pixel, expected, rtol=0, atol=1e-5)


def test_derivatives_are_those_of_differences():
    values = parameters(EXIT_PUPIL=3.0, DISTORTION=1e-4, STRETCH=1e-3)
    rng = np.random.default_rng(1)
    grid, points = rng.uniform(-20, 20, (40, 2)), rng.uniform(-20, 20, (40, 3)) - [0, 0, 400.0]

    def both(values, points):
        return np.stack([project_corners(values, grid, points, 0.0055).pixel, project_centres(values, grid, 0.0055)[0]])

    corners, (_, slope) = project_corners(values, grid, points, 0.0055), project_centres(values, grid, 0.0055)
    for p in P:
        h = 1e-6 * max(abs(values[p]), 1e-2)
        change = h * (np.arange(len(P)) == p)
        difference = (both(values + change, points) - both(values - change, points)) / (2 * h)
        stated = np.stack([corners.slope[:, :, p], slope[:, :, p]])
        # Rounding of pixels (some 1e-13 times 1000) over h.
        np.testing.assert_allclose(stated, difference, rtol=1e-6, atol=1e-9 / h, err_msg=p.name)
    for axis in range(3):
        step = 1e-4 * np.eye(3)[axis]
        difference = (both(values, points + step)[0] - both(values, points - step)[0]) / 2e-4
        np.testing.assert_allclose(corners.by_point[:, :, axis], difference, rtol=1e-6, atol=1e-6)


def test_a_pose_moves_points_by_its_step():
    rng = np.random.default_rng(2)
    poses = Poses(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3))).advance(rng.uniform(-1, 1, (2, 6)))
    np.testing.assert_allclose(poses.turn @ poses.turn.transpose(0, 2, 1), np.tile(np.eye(3), (2, 1, 1)), atol=1e-15)
    points, step = rng.uniform(-1, 1, (2, 3)), 1e-7 * rng.uniform(-1, 1, (2, 6))
    arms = rotate_points(poses, np.arange(2), points)
    moved = rotate_points(poses.advance(step), np.arange(2), points)
    np.testing.assert_allclose(moved - arms, np.cross(step[:, :3], arms), rtol=0, atol=1e-13)


def test_a_traced_lens_projects_as_the_camera_and_has_the_derivatives_of_differences():
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(8.0))
    main_lens = trace_lens(lens, 62.5 / 51.0, 0.13)
    values = parameters()
    plan = layout(values)._replace(lens=lens)
    camera = twin_camera(values, plan)
    centres = pl.microlens_centres(camera, progress=False)
    grid = centres.index @ plan.basis
    expected, slope = project_centres(values, grid, SENSOR.pixel_pitch, main_lens)
    # The pupil's aberration is a polynomial of the fourth degree in the squared slope.
    np.testing.assert_allclose(centres.pixel, expected, rtol=0, atol=1e-6)
    board = boards_of_50mm(board_points()[1], 1)[0][::5]
    seen = pl.project(camera, np.add(board, (0.0, 0.0, object_origin(camera))), rays=32, progress=False)
    seen = seen.selected(seen.passes)
    assert len(seen) > 20
    lenses, points = seen.index @ plan.basis, board[seen.point]
    corners = project_corners(values, lenses, points, SENSOR.pixel_pitch, main_lens)
    np.testing.assert_allclose(seen.pixel, corners.pixel, rtol=0, atol=1e-5)

    def both(values, points):
        pixels = (
            project_corners(values, lenses, points, SENSOR.pixel_pitch, main_lens).pixel,
            project_centres(values, grid, SENSOR.pixel_pitch, main_lens)[0],
        )
        return np.concatenate(pixels)

    for p in list(P)[: P.EXIT_PUPIL]:
        h = 1e-4 * max(abs(values[p]), 1e-2)
        change = h * (np.arange(len(P)) == p)
        difference = (both(values + change, points) - both(values - change, points)) / (2 * h)
        stated = np.concatenate([corners.slope[:, :, p], slope[:, :, p]])
        # Derivatives are those one Newton step before the last, 1e-3 mm beside the point of the board.
        np.testing.assert_allclose(stated, difference, rtol=1e-3, atol=1e-3 * np.abs(difference).max(), err_msg=p.name)
    for axis in range(3):
        step = 1e-3 * np.eye(3)[axis]
        difference = (both(values, points + step) - both(values, points - step))[: len(points)] / 2e-3
        scale = np.abs(difference).max()
        np.testing.assert_allclose(corners.by_point[:, :, axis], difference, rtol=1e-3, atol=1e-3 * scale)
