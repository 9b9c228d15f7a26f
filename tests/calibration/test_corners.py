"""Corners of rendered checkerboards in raw images with a sensor's noise, against the camera's own projection."""

import dataclasses
import functools

import numpy as np
import pytest
from board_shots import (
    DESIGN,
    PITCH,
    checkerboard,
    found,
    grid_of,
    marked_checkerboard,
    projection_minus_corners,
    raw_of,
    shot_of,
    tilted,
    white_of,
)
from calibration_helpers import true_values

import plenoptic as pl
from plenoptic.errors import InvalidValueError

KINDS = {"G1": (123.3, 1.7, (2.0,)), "G3": (123.3, 1.7, (1.6, 1.85, 2.2)), "K1": (156.0, 1.9, (1.7,))}
"""Distances from the iris to the array and from there to the sensor, focal lengths: Galilean and Keplerian."""
MARKED = marked_checkerboard(12, 9, square=3.0, margin=3.0)


@functools.cache
def camera_of(kind, focal_lengths=None, shape=(260, 340), lattice=pl.Lattice.HEXAGONAL):
    to_array, to_sensor, lengths = KINDS[kind]
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(4.6)).with_model(pl.LensModel.THIN)
    array = pl.MicrolensArray(0.217, focal_lengths or lengths, lattice)
    camera = pl.PlenopticCamera(lens, pl.Sensor(shape, PITCH), to_array, array, to_sensor)
    return camera.moved(pl.CameraPart.MICROLENSES, shift=(0.05, -0.03, 0.0), tilt=(0.0, 0.0, 0.01))


def errors_of(corners, camera, board):
    """Distances (n, 2) from the nearest image of the same point of the board; also the images, and which are met."""
    truth = pl.package.calibration_points(camera, board)
    nearest = []
    for point, pixel in zip(corners.point, corners.pixel, strict=True):
        rows = np.flatnonzero(truth.point == point)
        nearest.append(rows[np.hypot(*(truth.pixel[rows] - pixel).T).argmin()])
    return corners.pixel - truth.pixel[nearest], truth, np.unique(nearest)


def share_found(camera, truth, met):
    """Share of the images well inside micro images and the sensor that are found."""
    centres, radius = grid_of(camera).centres_of(grid_of(camera).on_sensor), np.median(grid_of(camera).radius)
    inside = ((truth.pixel > 6) & (truth.pixel < np.array(camera.sensor.shape) - 7)).all(axis=1)
    near = np.array([np.hypot(*(centres - pixel).T).min() for pixel in truth.pixel])
    return np.isin(np.flatnonzero(inside & (near < radius - 2.5)), met).mean()


@pytest.mark.parametrize("kind", KINDS)
def test_corners_are_where_the_camera_projects_them(kind):
    camera, board = camera_of(kind), tilted()
    corners = found(camera, board)
    error, truth, met = errors_of(corners, camera, board)
    assert np.unique(corners.point).tolist() == list(range(12)) and len(met) == len(corners) > 80
    # The renderer's own noise, of 32 paths a pixel, is 0.08 of the contrast at edges.
    assert np.hypot(*error.T).max() < 0.3 and np.sqrt(np.mean(error**2)) < 0.05
    # Images well inside micro images are all found.
    centres = grid_of(camera).centres_of(grid_of(camera).on_sensor)
    inner = [k for k, p in enumerate(truth.pixel) if np.hypot(*(centres - p).T).min() < 3.5]
    assert np.isin(inner, met).mean() > 0.99


def test_errors_are_those_of_the_noise():
    camera, board = camera_of("G3"), tilted()
    z = []
    for seed in range(3):
        corners = found(camera, board, electrons=150.0, seed=seed)
        z.append(errors_of(corners, camera, board)[0] / corners.standard_error)
    # Of some 800 numbers; noise of the renderer at edges is half of that of the sensor.
    assert 0.85 < np.sqrt(np.mean(np.concatenate(z) ** 2)) < 1.25


def test_blurred_corners_are_where_the_microlens_centre_sees_them():
    """Also where the main lens's pupil cuts the cone of light: outwards they would be by 2 % (focal length 2.6)."""
    for length in (2.6, 1.55):
        camera, board = camera_of("G1", (length,)), tilted()
        corners = found(camera, board, samples=128)
        error = errors_of(corners, camera, board)[0]
        arm = corners.pixel - grid_of(camera).centres_of(corners.index)
        # Its standard error is 0.001.
        assert np.median(corners.blur) > 1.3 and abs((error * arm).sum() / (arm**2).sum()) < 0.005, length


def test_corners_in_square_arrays_and_behind_colour_filters():
    camera, board = camera_of("G1", lattice=pl.Lattice.SQUARE), tilted()
    assert grid_of(camera).lattice is pl.Lattice.SQUARE
    raw, white = (raw_of(shot, camera, 5000.0) for shot in (shot_of(camera, board), white_of(camera)))
    filters = np.tile([[0.6, 1.0], [1.0, 0.45]], (130, 170))
    mosaics = [64.0 + filters * (image.data - 64.0) for image in (raw, white)]
    grid = pl.calibration.find_micro_images(mosaics[1])
    for corners in (
        pl.calibration.find_corners(raw, grid_of(camera), DESIGN, white=white),
        pl.calibration.find_corners(mosaics[0], grid, DESIGN, white=mosaics[1]),
    ):
        error, _, met = errors_of(corners, camera, board)
        assert len(met) == len(corners) > 80 and np.sqrt(np.mean(error**2)) < 0.05


def test_texture_behind_the_board_and_boards_near_the_array_do_not_make_views():
    """Large dots far away vary between micro images, as does a board whose image lies near the array."""
    camera = camera_of("G1", shape=(400, 500))
    design = checkerboard(5, 4, square=2.2, margin=1.0)
    wall = pl.targets.random_dots(24, 24, dot=4.0, seed=3).translated(z=-600.0)
    board = tilted(design=design)
    corners = found(camera, board, wall, design=design)
    assert not corners.in_views and np.hypot(*errors_of(corners, camera, board)[0].T).max() < 0.3
    camera, design = camera_of("G1"), checkerboard(5, 4, square=3.2, margin=3.2)
    boards = [tilted(angle=20.0, z=z, design=design) for z in (-480.0, -460.0, -532.0)]
    raws = [raw_of(shot_of(camera, each), camera) for each in boards]
    with pytest.raises(InvalidValueError, match="image 2: the image shows no board"):
        pl.calibration.observe(raws, white_of(camera), design, pixel_pitch=PITCH)
    with pytest.raises(InvalidValueError, match="image 1 is the same as image 0"):
        pl.calibration.observe([raws[0], raws[0]], white_of(camera), design, pixel_pitch=PITCH)


def test_without_a_white_image_fewer_are_found():
    camera, board = camera_of("G1"), tilted()
    corners = found(camera, board, with_white=False)
    assert np.sqrt(np.mean(errors_of(corners, camera, board)[0] ** 2)) < 0.06 and len(corners) > 60


def test_blur_is_that_of_the_microlenses():
    camera, board = camera_of("G3"), tilted()
    corners = found(camera, board)
    truth = pl.package.calibration_points(camera, board)
    expected = [truth.blur[np.hypot(*(truth.pixel - pixel).T).argmin()] for pixel in corners.pixel]
    blurred = np.array(expected) > 0.8
    # A disc's edge is not a normal distribution's; micro images are cut by the main lens's pupil.
    assert np.median(corners.blur[blurred] / np.array(expected)[blurred]) == pytest.approx(1.0, abs=0.15)


def test_turned_boards_keep_their_numbers():
    camera = camera_of("G1")
    board = tilted(turn=240.0)
    assert np.hypot(*errors_of(found(camera, board), camera, board)[0].T).max() < 0.3


def test_a_board_that_half_a_turn_does_not_change_is_numbered_as_columns_run():
    camera, design = camera_of("G1"), checkerboard(5, 3, square=3.0, margin=3.0)
    board = tilted(turn=40.0, design=design)
    assert np.hypot(*errors_of(found(camera, board, design=design), camera, board)[0].T).max() < 0.3
    turned = tilted(turn=140.0, design=design)
    corners = found(camera, turned, design=design)
    turned_numbers = dataclasses.replace(corners, point=7 - corners.point)
    assert np.hypot(*errors_of(turned_numbers, camera, turned)[0].T).max() < 0.3


def test_images_without_the_board_are_refused():
    camera = camera_of("G1")
    for target, design, reason, electrons in (
        (tilted(design=pl.targets.random_dots(40, 40, dot=2.0, seed=2)), DESIGN, "no board", (3000.0, 200.0)),
        (tilted(design=pl.targets.siemens_star(20.0, 36)), DESIGN, "no board", (3000.0, 200.0)),
        (tilted(design=pl.targets.slanted_edge(30.0)), DESIGN, "no board", (200.0,)),
        (tilted().translated(x=7.0), DESIGN, "move the whole board into view", (3000.0,)),
        (tilted(), checkerboard(7, 6, square=3.0), "move the whole board into view", (3000.0,)),
        (tilted(), checkerboard(4, 3, square=3.0), "has 2 x 3", (200.0,)),
    ):
        for each in electrons:
            with pytest.raises(InvalidValueError, match=reason):
                found(camera, target, design=design, electrons=each)


def test_a_board_before_texture_is_found_alone():
    camera, board = camera_of("G1"), tilted()
    wall = pl.targets.random_dots(60, 60, dot=2.0, seed=3).translated(z=-455.0)
    corners = found(camera, board, wall)
    error, _, met = errors_of(corners, camera, board)
    assert np.hypot(*error.T).max() < 0.3 and len(met) == len(corners) > 60


PARTS = (("G1", 180.0, (-12.0, 6.0)), ("G3", 90.0, (9.0, 5.0)), ("K1", 60.0, (-14.0, -9.0)))
"""Turns in degrees and shifts of a marked board, of which the camera sees less than half of 88 corners."""


@pytest.mark.parametrize(("kind", "turn", "shift"), PARTS)
def test_parts_of_a_marked_board_have_its_numbers(kind, turn, shift):
    camera, board = camera_of(kind), tilted(turn=turn, shift=shift, design=MARKED)
    for electrons, rms, rate in ((3000.0, 0.05, 0.97), (150.0, 0.1, 0.93)):
        corners = found(camera, board, design=MARKED, electrons=electrons)
        error, truth, met = errors_of(corners, camera, board)
        # Neighbours' images are 10 pixels apart.
        assert np.hypot(*error.T).max() < 1.0 and np.sqrt(np.mean(error**2)) < rms
        assert 10 < len(np.unique(corners.point)) < 44 and share_found(camera, truth, met) > rate


def test_marks_tell_half_a_turn():
    camera, design = camera_of("G1"), marked_checkerboard(5, 5, square=3.0, margin=3.0)
    board = tilted(turn=250.0, design=design)
    assert np.hypot(*errors_of(found(camera, board, design=design), camera, board)[0].T).max() < 0.3


def test_marks_do_not_disturb_corners():
    camera = camera_of("K1")
    plain, marked = (checkerboard(7, 6, square=2.3, margin=3.0), marked_checkerboard(7, 6, square=2.3, margin=3.0))
    results = []
    for design in (plain, marked):
        board = tilted(design=design)
        error, truth, met = errors_of(found(camera, board, design=design), camera, board)
        results.append((np.sqrt(np.mean(error**2)), share_found(camera, truth, met)))
    # Some 1000 numbers have an RMS with a standard error of 3 %, mostly the same ones for both.
    assert results[1][0] < 1.1 * results[0][0] and results[1][1] > results[0][1] - 0.01


def test_marks_that_are_not_those_of_the_board_are_refused():
    camera, board = camera_of("G1"), tilted(design=MARKED)
    for targets, design in (
        ([tilted(design=checkerboard(12, 9, square=3.0))], MARKED),
        ([board], dataclasses.replace(MARKED, marks=~MARKED.marks)),
        ([board], dataclasses.replace(MARKED, marks=MARKED.marks[::-1])),
    ):
        with pytest.raises(InvalidValueError, match="do not tell which part of the board"):
            found(camera, *targets, design=design)
    # Mirrored.
    raw, white = (raw_of(shot, camera).data[:, ::-1].copy() for shot in (shot_of(camera, board), white_of(camera)))
    grid = pl.calibration.find_micro_images(white)
    with pytest.raises(InvalidValueError, match="do not tell which part of the board"):
        pl.calibration.find_corners(raw, grid, MARKED, white=white)
    # Too few squares.
    with pytest.raises(InvalidValueError, match="do not tell which part|no board"):
        found(camera, tilted(turn=20.0, shift=(21.0, 13.0), design=MARKED), design=MARKED)
    for targets in ([pl.targets.random_dots(40, 40, dot=2.0, seed=2)], [pl.targets.siemens_star(20.0, 36)]):
        with pytest.raises(InvalidValueError, match="no board|do not tell which part"):
            found(camera, *(tilted(design=target) for target in targets), design=MARKED)
    with pytest.raises(InvalidValueError, match="it has 9 x 12 squares"):
        found(camera, board, design=dataclasses.replace(MARKED, marks=MARKED.marks[1:]))


@pytest.mark.slow
def test_parts_of_marked_boards_calibrate():
    camera = camera_of("G1")
    boards = [
        tilted((np.cos(a), np.sin(a), 0.0), 28.0, -420.0 - 8 * k, 60.0 * k, MARKED, (3.0 * k - 9.0, 2.0 * k - 5.0))
        for k, a in enumerate(np.arange(6) + 0.2)
    ]
    raws = [raw_of(shot_of(camera, board), camera, seed=k) for k, board in enumerate(boards)]
    observations = pl.calibration.observe(raws, raw_of(white_of(camera), camera, 20000.0), MARKED, pixel_pitch=PITCH)
    calibration = pl.calibrate(observations, start=pl.calibration.NominalCamera(100.0, 7.5), board=0.0)
    assert calibration.corner_rms < 0.03
    P = pl.calibration.Parameter
    for parameter, true in ((P.FOCAL_LENGTH, 100.716), (P.ARRAY_TO_SENSOR, 1.7)):
        assert abs(calibration[parameter] - true) < 5 * calibration.standard_error(parameter) < 0.08 * true


def test_observations_of_raw_images_calibrate():
    camera = camera_of("G1")
    boards = [tilted((np.cos(a), np.sin(a), 0.0), 28.0, -420.0 - 8 * k) for k, a in enumerate(np.arange(6) + 0.2)]
    raws = [raw_of(shot_of(camera, board), camera, seed=k) for k, board in enumerate(boards)]
    white = raw_of(white_of(camera), camera, 20000.0)
    observations = pl.calibration.observe(raws, white, DESIGN, pixel_pitch=PITCH)
    assert len(observations.frames) == 6 and observations.sensor == camera.sensor
    calibration = pl.calibrate(observations, start=pl.calibration.NominalCamera(100.0, 7.5), board=0.0)
    assert calibration.corner_rms < 0.03 and calibration.centre_rms < 0.01
    twin, real = (pl.paraxial.cardinal_points(each.lens).f_number for each in (calibration.camera, camera))
    # The printed f-number is not needed, and a wrong one is named.
    assert abs(twin / real - 1) < 0.03
    with pytest.warns(pl.errors.PlenopticWarning, match="nominal f-number is 11, and micro images .* ask for 7"):
        other = pl.calibrate(observations, start=pl.calibration.NominalCamera(100.0, 11.0), board=0.0)
    assert other.camera == calibration.camera
    P = pl.calibration.Parameter
    for parameter, true in ((P.FOCAL_LENGTH, 100.716), (P.ARRAY_TO_SENSOR, 1.7)):
        assert abs(calibration[parameter] - true) < 5 * calibration.standard_error(parameter) < 0.08 * true
    # Images of the board as it was fitted are those of the real one.
    twin, truth = (
        pl.package.calibration_points(each, dataclasses.replace(DESIGN, points=points))
        for each, points in ((calibration.camera, calibration.points(4)), (camera, boards[4].points))
    )
    missed = [
        np.hypot(*(truth.pixel[truth.point == point] - pixel).T).min()
        for point, pixel in zip(twin.point, twin.pixel, strict=True)
    ]
    # At the rims of micro images one of both may show a point that the other does not.
    both = np.array(missed) < 3.0
    assert np.mean(both) > 0.97 and np.sqrt(np.mean(np.array(missed)[both] ** 2)) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "length", "dark", "electrons", "rate", "error"),
    [
        ("G1", 2.0, 0.05, 50.0, 0.98, 0.11),
        ("G1", 2.0, 0.55, 500.0, 0.98, 0.1),
        ("G1", 2.6, 0.05, 500.0, 0.98, 0.06),
        ("K1", 1.7, 0.05, 500.0, 0.98, 0.03),
    ],
)
def test_rate_and_error_by_blur_contrast_and_noise(kind, length, dark, electrons, rate, error):
    camera = camera_of(kind, (length,))
    design = checkerboard(5, 4, square=3.0, margin=3.0, dark=pl.Emissive(dark))
    board, grid = tilted(design=design), grid_of(camera)
    corners = found(camera, board, electrons=electrons, samples=256)
    errors, truth, met = errors_of(corners, camera, board)
    centres, radius = grid.centres_of(grid.on_sensor), np.median(grid.radius)
    inner = [k for k, p in enumerate(truth.pixel) if np.hypot(*(centres - p).T).min() < radius - 2.5]
    assert np.isin(inner, met).mean() > rate and np.sqrt(np.mean(errors**2)) < error
    assert np.hypot(*errors.T).max() < 1.0
    assert 0.8 < np.sqrt(np.mean((errors / corners.standard_error) ** 2)) < 1.25


@pytest.mark.slow
def test_boards_behind_the_focus_of_microlenses_are_seen_in_views():
    """In focus is a virtual depth below 0, and corners in micro images are blurred by more than the border."""
    camera, board = camera_of("G1", (1.45,)), tilted()
    corners = found(camera, board, electrons=500.0, samples=128)
    errors = projection_minus_corners(camera, corners, board.points[corners.point])
    # A pixel between microlenses is a quarter of one in micro images.
    assert corners.in_views and len(corners) > 1200 and np.sqrt(np.mean(errors**2)) < 0.6
    assert 0.8 < np.sqrt(np.mean((errors / corners.standard_error) ** 2)) < 1.4


@pytest.mark.slow
def test_cameras_from_raw_images_are_within_their_errors():
    """Microlenses of three focal lengths, and a Keplerian camera, which sees a bent board; six boards each."""
    z, P = [], pl.calibration.Parameter
    for number, kind in enumerate(("G3", "K1")):
        camera, rng = camera_of(kind, shape=(330, 440)), np.random.default_rng(number)
        design = checkerboard(6, 5, square=3.0, margin=9.0, dark=pl.Emissive(0.1))
        board = bent(design, 0.2) if number else design
        boards = [
            tilted((np.cos(a), np.sin(a), 0.0), 25.0, rng.uniform(-440, -370), rng.uniform(-20, 20), board)
            for a in 2.4 * np.arange(6) + rng.uniform(0, 6)
        ]
        raws = [raw_of(shot_of(camera, each, samples=24), camera, seed=k) for k, each in enumerate(boards)]
        white = raw_of(white_of(camera), camera, 20000.0)
        observations = pl.calibration.observe(raws, white, design, pixel_pitch=PITCH)
        calibration = pl.calibrate(observations, start=pl.calibration.NominalCamera(100.0, 7.5))
        assert any(test.accepted for test in calibration.held_out if test.name == "free board") == bool(number)
        # The pitch's error holds that of the exit pupil: centroids are drawn inwards as light falls by cos^4.
        error = np.sqrt(np.diag(calibration.covariance) + calibration.model_change**2 * (np.arange(len(P)) == P.PITCH))
        off = calibration.values - true_values(camera, calibration)
        z.append(off[: P.STRETCH] / error[: P.STRETCH])
    # Of some 10 independent numbers.
    assert np.abs(z).max() < 4 and 0.6 < np.sqrt(np.mean(np.square(z))) < 1.5, z


def bent(board, bend):
    """A board bent like a saddle by a length in mm."""

    def moved(points):
        x, y, z = np.transpose(points)
        return np.column_stack([x, y, z + bend * ((x / 9) ** 2 - 0.5 * (y / 8) ** 2 + x * y / 140)])

    meshes = [dataclasses.replace(mesh, vertices=moved(mesh.vertices)) for mesh in board.meshes]
    return dataclasses.replace(board, meshes=meshes, points=moved(board.points))


def test_what_is_no_board_and_no_raw_image_is_refused():
    camera = camera_of("G1")
    grid, raw = grid_of(camera), np.zeros((260, 340))
    for args, reason in (
        ((raw, grid, pl.targets.siemens_star(20.0, 36)), "no checkerboard"),
        ((raw[:-1], grid, DESIGN), "shape"),
        ((raw + np.nan, grid, DESIGN), "finite"),
        ((raw, grid, DESIGN), "no board"),
        ((raw, "grid", DESIGN), "grid is a str"),
    ):
        with pytest.raises(InvalidValueError, match=reason):
            pl.calibration.find_corners(*args)
    with pytest.raises(InvalidValueError, match="image 0: the image shows no board"):
        pl.calibration.observe([raw], white_of(camera), DESIGN, pixel_pitch=PITCH)
