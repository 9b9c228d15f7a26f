"""One camera calibrated from several focus settings: values, errors, advice that comes true, and mistakes."""

import dataclasses
import functools

import matplotlib.pyplot as plt
import numpy as np
import pytest
from calibration_helpers import (
    GALILEAN,
    NOMINAL,
    SENSOR,
    P,
    blurred,
    board_points,
    boards_in_view,
    boards_of_50mm,
    camera_as_built,
    observed,
    parameters,
    simulated,
    true_values,
)

import plenoptic as pl
from plenoptic.calibration.fitting.geometry import COUNT, project_corners
from plenoptic.calibration.fitting.solve import centres_of, evaluate, problem_of, step
from plenoptic.calibration.fitting.start_values import start_state
from plenoptic.calibration.fitting.traced_lens import trace_lens
from plenoptic.calibration.joint_observations import join_settings

DESIGN, _ = board_points()
ARRAY = parameters()[P.LENS_TO_ARRAY]
TURNED = np.array([[0, 1], [-1, 1]])
"""Lattice vectors of a hexagonal array by those 60 degrees farther."""


@functools.cache
def setting(array=ARRAY, n=4, seed=0, noise=(0.05, 0.01), boards=None, **changes):
    """Observations at a distance from lens to array."""
    boards = boards_of_50mm(DESIGN, n, seed=seed if boards is None else boards)
    return simulated(parameters(LENS_TO_ARRAY=array, **changes), boards, DESIGN, noise=noise, seed=seed)


def white_only(observations):
    nothing = np.empty((0, 2))
    return dataclasses.replace(observations, index=nothing, pixel=nothing, frame=[], point=[])


def renumbered(observations, turn=1, shift=(0, 0)):
    indices = {name: getattr(observations, name) @ turn + shift for name in ("index", "centre_index")}
    return dataclasses.replace(observations, **indices)


def calibrate(*settings, **options):
    """Calibrations at all settings."""
    return pl.calibrate(settings, **({"start": NOMINAL, "board": 0.0} | options)).settings


def errors(calibration):
    return np.sqrt(np.diag(calibration.covariance))[: P.STRETCH]


def at_pivot(values, calibration):
    """Values with the shift of a calibration's pivot in place of that of the lens (0, 0)."""
    cosine, sine = np.cos(values[P.TURN]), np.sin(values[P.TURN])
    moved = values.copy()
    pivot = np.array(calibration.layout.pivot) @ calibration.layout.basis
    moved[[P.SHIFT_X, P.SHIFT_Y]] += values[P.PITCH] * pivot @ [[cosine, sine], [-sine, cosine]]
    return moved


def test_derivatives_belong_to_the_distance_of_their_setting():
    joint, corners, centres = join_settings((setting(n=3), setting(62.1, n=2, seed=1), setting(61.5, n=1, seed=2)))
    free = np.arange(COUNT + 2) < P.STRETCH
    free[COUNT:] = True
    problem = problem_of(joint, np.array([[3**0.5 / 2, 0.5], [0.0, 1.0]]), free)
    problem = problem._replace(setting=corners, centre_setting=centres, prior=np.zeros((COUNT + 2, 2)))
    state = start_state(problem, 50.0)
    at = evaluate(problem, state)
    for k in range(problem.n_free):
        change = 1e-5 * (np.arange(problem.unknowns) == k)
        up, down = (evaluate(problem, step(problem, state, sign * change)) for sign in (1.0, -1.0))
        for after, before, slope in (
            (up.corners, down.corners, at.corner_slope[:, :, k]),
            (up.centres, down.centres, at.centre_slope[:, :, k]),
        ):
            # Rounding, 1e-12 for pixels over their standard deviation, over the step.
            np.testing.assert_allclose(
                (after - before) / 2e-5, slope, rtol=1e-6, atol=1e-7 + 1e-9 * np.abs(slope).max()
            )
    assert not at.corner_slope[corners == 1, :, P.LENS_TO_ARRAY].any()
    assert not at.centre_slope[centres != 2, :, -1].any() and at.centre_slope[centres == 2, :, -1].all()
    moved = state.parameters.copy()
    moved[-1] += 0.1
    rows = np.any(centres_of(problem, moved)[0] != centres_of(problem, state.parameters)[0], axis=1)
    np.testing.assert_array_equal(rows, centres == 2)


@pytest.mark.parametrize("turn", [np.eye(2, dtype=int), TURNED], ids=["shifted", "turned"])
def test_exact_observations_give_all_distances_back(turn):
    """Three settings, one of them with a single frame and one with a white image alone, numbered otherwise."""
    arrays = ARRAY, 62.1, 61.2
    exact = [setting(array, n, k, (0.0, 0.0)) for k, (array, n) in enumerate(zip(arrays, (4, 1, 1), strict=True))]
    calibrations = calibrate(exact[0], renumbered(exact[1], turn, (3, -2)), white_only(exact[2]))
    for array, calibration in zip(arrays, calibrations, strict=True):
        expected = at_pivot(parameters(LENS_TO_ARRAY=array), calibration)
        # The tolerance of the fit is 0.01 standard deviations, which are 1e-6 of those of noise.
        np.testing.assert_allclose(calibration.values, expected, rtol=1e-5, atol=1e-6)
    assert [len(each.turn) for each in calibrations] == [4, 1, 0]
    assert [len(each.corner_residual) for each in calibrations[1:]] == [len(exact[1].pixel), 0]
    assert calibrations[2].corner_rms == 0.0 and repr(calibrations[0]).count(" 1 frames") == 1
    assert repr(calibrations[0]).count(" 0 frames") == repr(calibrations[2]).count(" 0 frames") == 1
    with pytest.raises(pl.errors.InvalidValueError, match="setting 2 has a white image alone"):
        calibrations[2].points(0)
    with pytest.raises(pl.errors.InvalidValueError, match="no frame: they are a white image alone"):
        pl.plots.plot_corners(white_only(exact[2]), frame=0)
    with pytest.raises(pl.errors.InvalidValueError, match=r"those of its settings\[1\]"):
        pl.plots.plot_residuals(calibrations[0], renumbered(exact[1], turn, (3, -2)))
    figure = pl.plots.plot_residuals(calibrations[2], white_only(exact[2]))
    assert [ax.axison for ax in figure.axes] == [False, True, True]
    plt.close(figure)
    assert calibrations[0].cameras == tuple(each.camera for each in calibrations)
    assert all(text in repr(calibrations[0]) for text in ("lens_to_array[1], mm          62.1 +- ", "lens_to_array[2]"))


def test_a_setting_far_from_the_first_starts_from_the_pitch_of_its_micro_images():
    """Infinity to half of the distance: from the first setting's distance the solver does not get there."""
    for array, depths in ((54.6, (-1600.0, -1100.0)), (70.0, (-250.0, -210.0))):
        boards = boards_of_50mm(DESIGN, 3, seed=4, depths=depths)
        second = simulated(parameters(LENS_TO_ARRAY=array), boards, DESIGN, noise=(0.05, 0.01), seed=2)
        calibration = calibrate(setting(), second)[1]
        assert abs(calibration[P.LENS_TO_ARRAY] - array) < 4 * calibration.standard_error(P.LENS_TO_ARRAY) < 1.5


@pytest.mark.slow
def test_errors_of_many_cameras_are_those_that_are_stated():
    """Eight cameras at two settings of 3 and 2 frames."""
    scores, squares = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        arrays = ARRAY + rng.uniform(-0.3, 0.3), ARRAY + rng.uniform(-0.5, 0.5)
        changes = {"TURN": rng.uniform(-0.5, 0.5), "AXIS_ROW": rng.uniform(280.0, 300.0)}
        parts = [setting(arrays[0], 3, seed, **changes), setting(arrays[1], 2, seed + 100, **changes)]
        first, second = calibrate(*parts)
        truth = at_pivot(parameters(LENS_TO_ARRAY=arrays[0], **changes), first)
        covariance = first.joint_covariance
        fitted = np.diag(covariance) > 0
        sigma = np.sqrt(np.diag(covariance)[fitted])
        z = (np.append(first.values, second[P.LENS_TO_ARRAY]) - np.append(truth, arrays[1]))[fitted] / sigma
        eigenvalues, axes = np.linalg.eigh(covariance[np.ix_(fitted, fitted)] / np.outer(sigma, sigma))
        told = eigenvalues > 1e-9
        scores.append(z)
        squares.append(np.mean((axes.T @ z)[told] ** 2 / eigenvalues[told]))
    # Root mean squares of 8 normal numbers are 1 +- 0.25, and of 8 times 10 independent ones 1 +- 0.08.
    rms = np.sqrt(np.mean(np.square(scores), axis=0))
    assert ((rms > 0.28) & (rms < 1.72)).all(), rms
    assert 0.76 < np.sqrt(np.mean(squares)) < 1.24


def test_a_second_focus_gains_what_the_advice_says():
    """The same corners through the same microlenses after the array was moved, as the advice takes them."""
    usual = setting(n=5)
    once = calibrate(usual)[0]
    table = {name: np.array(row)[: P.STRETCH] for name, row in once.error_table}
    array = ARRAY - 0.5 * parameters()[P.ARRAY_TO_SENSOR]
    grid, points = usual.index @ once.layout.basis, np.array(boards_of_50mm(DESIGN, 5))[usual.frame, usual.point]
    pixel = project_corners(parameters(LENS_TO_ARRAY=array), grid, points, SENSOR.pixel_pitch).pixel
    pixel = pixel + 0.05 * np.random.default_rng(8).standard_normal(pixel.shape)
    white = setting(array, 1, 1)
    moved = {"centre_index": white.centre_index, "centre_pixel": white.centre_pixel}
    reached = errors(calibrate(usual, dataclasses.replace(usual, pixel=pixel, **moved))[0])
    # Errors by residuals are known to 2 to 3 % each, by the scatter over the parameters.
    np.testing.assert_allclose(reached, table["all again at a second focus"], rtol=0.1)
    assert (reached < 0.75 * table["these observations"]).all()


def test_a_white_image_at_another_f_number_is_a_setting_too():
    usual, white = setting(n=5), white_only(setting(n=1, seed=9))
    once, (first, second) = calibrate(usual)[0], calibrate(usual, white)
    stated = np.array(dict(once.error_table)["a white image at another f-number"])[: P.STRETCH]
    # A distance of its own costs the pitch some per cent of its error, and the others less.
    np.testing.assert_allclose(errors(first), stated, rtol=0.1)
    assert errors(first)[P.TURN] < 0.8 * errors(once)[P.TURN]
    joint = first.joint_covariance
    sigma = np.sqrt(joint[P.LENS_TO_ARRAY, P.LENS_TO_ARRAY] + joint[-1, -1] - 2.0 * joint[P.LENS_TO_ARRAY, -1])
    assert (
        abs(second[P.LENS_TO_ARRAY] - first[P.LENS_TO_ARRAY]) < 4 * sigma < 0.2 * first.standard_error(P.LENS_TO_ARRAY)
    )


def test_microlenses_beside_their_places_are_so_at_all_settings():
    """Of centres that deviate alike in two white images the second tells nothing of the array."""
    usual, white = setting(n=5, noise=(0.05, 1e-4)), white_only(setting(n=1, seed=9, noise=(0.05, 1e-4)))
    rng = np.random.default_rng(4)

    def displaced(observations, offset):
        return dataclasses.replace(observations, centre_pixel=observations.centre_pixel + offset)

    alike, other = 0.02 * rng.standard_normal((2, *usual.centre_pixel.shape))
    once = calibrate(displaced(usual, alike))[0]
    for offset, gain in ((alike, 1.0), (other, 0.5**0.5)):
        both = calibrate(displaced(usual, alike), displaced(white, offset))[0]
        # The turn follows from the centres alone; errors by 2000 residuals are known to some 3 %.
        assert abs(errors(both)[P.TURN] / errors(once)[P.TURN] / gain - 1.0) < 0.1


def test_cameras_drawn_with_one_seed_are_one_camera_at_both_settings():
    calibrations = calibrate(setting(), setting(62.1, 2, 1), priors={P.EXIT_PUPIL: (0.0, 1e-4)})
    twins = [each.sample(30, seed=2) for each in calibrations]
    rear = [[pl.paraxial.cardinal_points(twin.lens).rear_principal for twin in drawn] for drawn in twins]
    arrays = np.array([[twin.stop_to_microlenses for twin in drawn] for drawn in twins]) - rear
    distances = np.array([each[P.LENS_TO_ARRAY] for each in calibrations])
    scatter = arrays - arrays.mean(axis=1, keepdims=True)
    assert abs(arrays[0].mean() - distances[0]) < 4 * scatter[0].std() / 30**0.5
    joint, columns = calibrations[0].joint_covariance, [P.LENS_TO_ARRAY, COUNT]
    sigma = np.sqrt([1.0, -1.0] @ joint[np.ix_(columns, columns)] @ [1.0, -1.0])
    # The standard deviation of 30 numbers is known to 13 %.
    assert 0.6 < np.std(scatter[0] - scatter[1]) / sigma < 1.4 and sigma < 0.1 * scatter[0].std()
    np.testing.assert_allclose(np.diff(arrays.mean(axis=1)), np.diff(distances), rtol=0.05)


def test_each_calibration_has_the_twin_the_residuals_and_the_figures_of_its_setting(tmp_path):
    settings = setting(), setting(62.1, 2, 1)
    for observations, calibration in zip(settings, calibrate(*settings), strict=True):
        rows = np.flatnonzero(observations.frame == 1)
        seen = pl.project(calibration.camera, calibration.points(1), rays=32, progress=False)
        place = {(int(p), *map(int, i)): pixel for p, i, pixel in zip(seen.point, seen.index, seen.pixel, strict=True)}
        keys = [(int(observations.point[k]), *observations.index[k].tolist()) for k in rows]
        shown = [k for k, key in enumerate(keys) if key in place]
        assert len(shown) > 0.5 * len(rows)
        expected = (observations.pixel + calibration.corner_residual)[rows[shown]]
        np.testing.assert_allclose([place[keys[k]] for k in shown], expected, rtol=0, atol=1e-5)
        assert abs(calibration.centre_rms / 0.01 - 1.0) < 0.05 and abs(calibration.corner_rms / 0.05 - 1.0) < 0.05
        pl.plots.plot_residuals(calibration, observations)
        plt.close("all")
        pl.export.compote_calibration(tmp_path, calibration, observations)
        with pytest.raises(pl.errors.InvalidValueError, match="number microlenses otherwise"):
            pl.export.compote_calibration(tmp_path, calibration, renumbered(observations, np.eye(2, dtype=int), (1, 0)))


def test_blur_at_two_settings_gives_the_focal_lengths_of_the_types():
    lengths, arrays = (0.62, 0.66, 0.71), (ARRAY, 61.0)
    settings = [
        blurred(setting(array, n, k), lengths, parameters(LENS_TO_ARRAY=array), boards_of_50mm(DESIGN, n, seed=k))
        for k, (array, n) in enumerate(zip(arrays, (3, 7), strict=True))
    ]
    for calibration in calibrate(*settings):
        ratio = calibration[P.ARRAY_TO_SENSOR] / parameters()[P.ARRAY_TO_SENSOR]
        np.testing.assert_allclose(np.array(calibration.layout.focal_lengths) / ratio, lengths, rtol=0.01)


def refused(sentence, *settings, **options):
    with pytest.raises(pl.errors.InvalidValueError, match=sentence):
        calibrate(*settings, **options)


def test_settings_that_are_not_of_one_camera_are_refused():
    usual, second = setting(), setting(62.1, 2, 1)
    differ = r"observations\[1\] has another "
    refused(differ + "board", usual, dataclasses.replace(second, board=2.0 * DESIGN))
    finer = pl.Sensor(shape=SENSOR.shape, pixel_pitch=0.01)
    refused(differ + "sensor", usual, dataclasses.replace(second, sensor=finer))
    refused("pitches .* another camera", usual, setting(62.1, 2, 1, PITCH=0.23))
    refused("turned, or displaced", usual, setting(62.1, 2, 1, TURN=0.4))
    # An array whose lattice agrees almost, and one at another place.
    refused(r"explains observations\[1\] .* its array or sensor was moved", usual, setting(62.1, 2, 1, TURN=0.305))
    refused(r"explains observations\[1\]", usual, setting(62.1, 2, 1, PITCH=0.252))
    refused("displaced by 0.2", usual, white_only(setting(62.1, 2, 1, SHIFT_X=0.1)))
    refused(r"observations\[0\]: the observations hold 2 frames", second, usual)
    few = dataclasses.replace(second, centre_index=second.centre_index[:5], centre_pixel=second.centre_pixel[:5])
    refused(r"observations\[1\]: the observations hold 5 centres", usual, few)
    rows = (second.frame == 1) & (second.point > 2)
    line = {name: getattr(second, name)[~rows] for name in ("index", "pixel", "frame", "point")}
    refused(r"observations\[1\]: frame 1 shows 3 points", usual, dataclasses.replace(second, **line))
    refused("observations is empty")
    refused(r"observations\[2\] are the same as observations\[0\]", usual, second, usual)
    whites = [{name: getattr(each, name) for name in ("centre_index", "centre_pixel")} for each in (second, usual)]
    exchanged = [dataclasses.replace(each, **white) for each, white in zip((usual, second), whites, strict=True)]
    refused(r"white images of observations\[0\] and observations\[1\] are exchanged", *exchanged)
    refused("observations is a str", usual, "raw.png")


def test_the_pupil_of_a_prescription_is_the_same_at_all_distances():
    """A chief ray leaves the iris: it knows no array."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(8.0))
    near, far = (trace_lens(lens, ratio, 0.13).pupil for ratio in (1.0, 1.5))
    square = np.linspace(0.0, 0.13**2, 9)
    # Both are polynomials of the fourth degree through other rays.
    np.testing.assert_allclose(near(square), far(square), rtol=0, atol=1e-6)


@pytest.mark.slow
def test_projected_cameras_with_a_prescription_come_back_at_two_settings():
    design, board = board_points()
    cameras = [
        camera_as_built(2, distances=(array, GALILEAN[1]), model=pl.LensModel.EXACT)
        for array in (GALILEAN[0], GALILEAN[0] - 0.8)
    ]
    settings = [observed(each, boards_in_view(board, 6, k), design, seed=k) for k, each in enumerate(cameras)]
    start = pl.calibration.NominalCamera(100.0, 7.0)
    for camera, calibration in zip(cameras, calibrate(*settings, start=start, lens=cameras[0].lens), strict=True):
        z = (calibration.values - true_values(camera, calibration))[: P.STRETCH] / errors(calibration)
        assert np.abs(z).max() < 4
