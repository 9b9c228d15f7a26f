"""Corners of rendered checkerboards in the views of an unfocused camera (1.0), and its calibration."""

import dataclasses
import functools

import board_shots
import numpy as np
import pytest
from board_shots import DESIGN, PITCH, blurred_shot, found, grid_of, projection_minus_corners, raw_of, shot_of, white_of
from calibration_helpers import P, true_values

import plenoptic as pl
from plenoptic.errors import InvalidValueError

FOCUS = -478.0
"""The plane imaged onto the array."""


@functools.cache
def camera_of(lattice=pl.Lattice.HEXAGONAL):
    """Some 40 x 50 microlenses of 10 pixels before their focal length, with dark gaps between micro images."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(3.2)).with_model(pl.LensModel.THIN)
    array = pl.MicrolensArray(0.135, (1.7,), lattice)
    camera = pl.PlenopticCamera(lens, pl.Sensor((400, 500), PITCH), 129.0, array, 1.7)
    moved = camera.moved(pl.CameraPart.MICROLENSES, shift=(0.05, -0.03, 0.0), tilt=(0.0, 0.0, 0.01))
    return moved.moved(pl.CameraPart.SENSOR, shift=(0.02, -0.01, 0.0))


tilted = functools.partial(board_shots.tilted, z=FOCUS)


@pytest.mark.parametrize("lattice", [pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE])
def test_corners_in_views_are_where_the_camera_projects_them(lattice):
    camera, board = camera_of(lattice), tilted()
    corners = found(camera, board)
    assert corners.in_views and "in views" in repr(corners)
    error = projection_minus_corners(camera, corners, board.points[corners.point])
    # The renderer's own noise is 0.14 pixels, a seventieth of a pitch.
    assert np.hypot(*error.T).max() < 1.0 and np.sqrt(np.mean(error**2)) < 0.22
    # All 37 views of unvignetted pixels show all corners, each through another part of the pupil.
    offset = corners.pixel - grid_of(camera).centres_of(corners.index)
    np.testing.assert_allclose(offset, np.rint(offset), rtol=0, atol=1e-6)
    counts = np.unique(np.column_stack([corners.point, np.rint(offset)]), axis=0)
    assert len(counts) == len(corners) > 12 * 35 and np.unique(corners.point).tolist() == list(range(12))


def test_errors_in_views_are_those_of_the_noise():
    camera, board = camera_of(), tilted()
    z = []
    for seed in range(3):
        corners = found(camera, board, electrons=80.0, seed=seed)
        error = projection_minus_corners(camera, corners, board.points[corners.point])
        z.append(error / corners.standard_error)
    # Of some 2500 numbers; noise of the renderer at edges is half of that of the sensor.
    assert 0.85 < np.sqrt(np.mean(np.concatenate(z) ** 2)) < 1.25


def test_boards_are_numbered_in_views_without_a_white_image_and_after_half_a_turn():
    camera, board = camera_of(), tilted(turn=180.0)
    for with_white in (True, False):
        corners = found(camera, board, with_white=with_white)
        error = projection_minus_corners(camera, corners, board.points[corners.point])
        # Without a white image pixels that the rim of the micro image cuts are taken as well.
        assert np.hypot(*error.T).max() < 2.0 and np.sqrt(np.mean(error**2)) < 0.25 and len(corners) > 12 * 35


def test_the_border_of_micro_images_tells_the_camera():
    """Virtual depths of 3 and -3, at which micro images show the board too; and 2.5 behind focused microlenses."""
    camera = camera_of()
    for z in (FOCUS + 72.0, FOCUS - 72.0):
        assert found(camera, tilted(z=z)).in_views
    # As by crosstalk of pixels or lenses that are not exact: the border is blurred, and the corners more.
    shots = white_of(camera), shot_of(camera, tilted(z=FOCUS + 50.0))
    white, raw = (raw_of(blurred_shot(shot, 0.7), camera, 8000.0) for shot in shots)
    grid = pl.calibration.find_micro_images(white)
    assert 0.1 * grid.pitch < grid.border[0] < 3.0
    assert pl.calibration.find_corners(raw, grid, DESIGN, white=white).in_views
    lens = pl.load_lens("double-gauss-100mm-f2").with_model(pl.LensModel.THIN)
    camera = pl.design_camera(
        lens, sensor=pl.Sensor((300, 380), PITCH), z=-430.0, kind=pl.CameraKind.GALILEAN, pitch=0.217,
        focal_length=2.0, virtual_depth=2.5,
    ).camera  # fmt: skip
    # Views of focused cameras show boards, too, displaced by some pixels.
    with pytest.raises(InvalidValueError, match="no board"):
        found(camera, tilted(z=-445.0))


def test_light_without_the_board_in_focus_is_refused():
    camera = camera_of()
    for target, design, reason in (
        (tilted(design=pl.targets.random_dots(40, 40, dot=2.0, seed=2)), DESIGN, "no board"),
        (tilted().translated(x=10.0), DESIGN, "move the whole board into view"),
        (tilted(), pl.targets.checkerboard(4, 3, square=3.0), "has 2 x 3"),
    ):
        with pytest.raises(InvalidValueError, match=reason):
            found(camera, target, design=design)


@functools.cache
def observed(n=8):
    """Boards of which some are so far from the focus that light varies within micro images."""
    camera = camera_of()
    boards = [
        tilted((np.cos(a), np.sin(a), 0.0), 30.0, z=-400.0 - 15.0 * k) for k, a in enumerate(np.arange(n) * 2.2 + 0.2)
    ]
    raws = [raw_of(shot_of(camera, board, samples=64), camera, seed=k) for k, board in enumerate(boards)]
    white = raw_of(white_of(camera), camera, 20000.0)
    return camera, boards, pl.calibration.observe(raws, white, DESIGN, pixel_pitch=PITCH)


@pytest.mark.slow
def test_an_unfocused_camera_is_calibrated_from_raw_images():
    camera, boards, observations = observed()
    assert observations.in_views and observations.blur is None and len(observations.frames) == 8
    calibration = pl.calibrate(observations, start=pl.calibration.NominalCamera(100.0, 11.0), board=0.0)
    assert calibration.corner_rms < 0.15 and calibration.centre_rms < 0.02
    true = true_values(camera, calibration)
    for p in (P.FOCAL_LENGTH, P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR, P.PITCH):
        low, high = calibration.interval(p)
        assert low < true[p] < high and high - low < 0.2 * true[p], p.name
        assert abs(calibration[p] - true[p]) < 4 * calibration.standard_error(p), p.name
    assert calibration.camera.report().kind is pl.CameraKind.PLENOPTIC_1
    errors = []
    for frame, board in enumerate(boards):
        rows = observations.frame == frame
        seen = dataclasses.replace(observations, **{
            name: getattr(observations, name)[rows]
            for name in ("index", "pixel", "frame", "point", "standard_error")
        })  # fmt: skip
        true = projection_minus_corners(camera, seen, board.points[seen.point])
        errors.append(true - calibration.corner_residual[rows])
    # Poses take up the aliasing of sharp edges by the lattice: 0.1 pixels of one board in focus, 0.03 of the others.
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.05
