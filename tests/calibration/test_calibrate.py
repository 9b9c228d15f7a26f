"""Calibration of simulated cameras: values, errors, terms, and observations that are refused."""

import dataclasses
import functools
import pickle

import numpy as np
import pytest
from calibration_helpers import NOMINAL, P, blurred, board_points, boards_of_50mm, parameters, simulated

import plenoptic as pl
from plenoptic.calibration.fitting.solve import cell_products, cells_of, evaluate, normal_equations, problem_of, weight

DESIGN, _ = board_points()
NOISE = 0.15, 0.03


@functools.cache
def observed(**options):
    bend, changes = options.pop("bend", 0.0), options.pop("changes", ())
    values = parameters(**dict(changes))
    boards = boards_of_50mm(board_points(bend, 3)[1], options.pop("n", 10), tilt=options.pop("tilt", 0.5))
    return simulated(values, boards, DESIGN, **({"noise": NOISE, "seed": 5} | options))


@functools.cache
def calibrated(**options):
    return pl.calibrate(observed(**options), start=NOMINAL)


def z_scores(calibration, values):
    fitted = np.diag(calibration.covariance) > 0
    # The pivot of the calibration may be another microlens.
    fitted[[P.SHIFT_X, P.SHIFT_Y]] = False
    return (calibration.values - values)[fitted] / np.sqrt(np.diag(calibration.covariance))[fitted]


def test_exact_observations_give_the_camera_back():
    calibration = pl.calibrate(observed(noise=(1e-3, 2e-4)), start=NOMINAL)
    assert calibration.corner_rms < 1.1e-3 and calibration.centre_rms < 2.2e-4
    errors = np.abs(calibration.values - parameters())[[P.FOCAL_LENGTH, P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR, P.PITCH]]
    assert (errors < [0.02, 0.02, 1e-3, 1e-6]).all()


def test_a_flat_board_stays_flat_and_values_agree_within_their_errors():
    calibration = calibrated()
    assert [test.accepted for test in calibration.held_out] == [False, False, False]
    assert calibration.error_cluster is pl.calibration.ErrorCluster.CORNER
    np.testing.assert_array_equal(calibration.board, DESIGN)
    # Residuals are the noise, but for the unknowns: 1 % of the corners' numbers.
    assert abs(calibration.corner_rms / NOISE[0] - 1) < 0.03 and abs(calibration.centre_rms / NOISE[1] - 1) < 0.05
    assert np.abs(z_scores(calibration, parameters())).max() < 4


def test_a_bent_board_is_found():
    calibration = calibrated(bend=0.25)
    board, *_ = calibration.held_out
    assert board.accepted and board.name == "free board" and board.with_term[0] < board.without[0]
    _, real = board_points(0.25, 3)
    # Up to a rigid motion and scale, which its poses and the prior share.
    bent, fitted = (each - each.mean(axis=0) for each in (real, calibration.board))
    u, s, v = np.linalg.svd(fitted.T @ bent)
    aligned = fitted @ u @ v * (s.sum() / np.sum(fitted**2))
    assert np.std(aligned - bent) < 0.15 * np.std(real - DESIGN)
    assert np.abs(z_scores(calibration, parameters())).max() < 4
    assert (calibration.board_error > 0).all()


def test_a_stretched_array_is_found_and_is_in_the_twin():
    calibration = calibrated(changes=(("STRETCH", 3e-4),))
    assert [test.accepted for test in calibration.held_out] == [False, True, False]
    assert abs(calibration[P.STRETCH] - 3e-4) < 4 * calibration.standard_error(P.STRETCH) < 1e-4
    assert calibration.camera.microlenses.imperfections is not None


def test_distortion_is_asked_for_where_the_lens_has_it():
    calibration = calibrated(changes=(("DISTORTION", -3e-3),))
    assert calibration.held_out[-1].name == "radial distortion" and calibration.held_out[-1].accepted
    assert calibration[P.DISTORTION] == 0, "the twin cannot distort"


def test_the_twin_projects_as_the_fit():
    calibration, observations = calibrated(), observed()
    rows = np.flatnonzero(observations.frame == 2)
    seen = pl.project(calibration.camera, calibration.points(2), rays=32, progress=False)
    place = {(int(p), *map(int, i)): pixel for p, i, pixel in zip(seen.point, seen.index, seen.pixel, strict=True)}
    keys = [(int(observations.point[k]), *observations.index[k].tolist()) for k in rows]
    shown = [k for k, key in enumerate(keys) if key in place]
    assert len(shown) > 0.5 * len(rows)
    expected = (observations.pixel + calibration.corner_residual)[rows[shown]]
    np.testing.assert_allclose([place[keys[k]] for k in shown], expected, rtol=0, atol=1e-5)


def test_errors_that_go_together_widen_the_intervals():
    alone = calibrated()
    for name, expected in (("by_point", "BOARD_POINT"), ("by_frame", "FRAME")):
        together = calibrated(**{name: 0.2 if name == "by_point" else 0.01})
        assert together.error_cluster.name == expected
        assert together.standard_error(P.FOCAL_LENGTH) > 1.5 * alone.standard_error(P.FOCAL_LENGTH)


def test_intervals_hold_the_exit_pupil():
    """A lens whose exit pupil is 5 mm before its principal plane, fitted with a thin one and with its own pupil."""
    observations = observed(changes=(("EXIT_PUPIL", 5.0),))
    thin = pl.calibrate(observations, start=NOMINAL, board=0.0)
    thick = pl.calibrate(observations, start=NOMINAL, board=0.0, priors={P.EXIT_PUPIL: (5.0, 1e-3)})
    assert thin.camera.lens.model is pl.LensModel.THIN and thick.camera.lens.model is pl.LensModel.PARAXIAL
    expected = 5.0 * thin.model_change / thin.model_change[P.EXIT_PUPIL]
    change = thick.values - thin.values
    for p in (P.FOCAL_LENGTH, P.LENS_TO_ARRAY, P.PITCH, P.TILT_X):
        # To first order: 5 mm are 8 % of the distance from the pupil to the array.
        assert abs(change[p] - expected[p]) < 0.2 * abs(expected[p]), p.name
        low, high = thin.interval(p)
        assert low < parameters()[p] < high, p.name
    assert abs(change[P.PITCH]) > 20 * thin.standard_error(P.PITCH)


def test_a_prior_moves_a_value_as_its_precision_says():
    calibration = calibrated()
    mean, sigma = calibration[P.FOCAL_LENGTH] + 0.3, calibration.standard_error(P.FOCAL_LENGTH)
    held = pl.calibrate(observed(), start=NOMINAL, priors={P.FOCAL_LENGTH: (mean, sigma)}, board=0.0)
    assert abs(held[P.FOCAL_LENGTH] - calibration[P.FOCAL_LENGTH] - 0.15) < 0.02
    assert abs(held.standard_error(P.FOCAL_LENGTH) / sigma - 0.5**0.5) < 0.03


def test_samples_scatter_by_the_errors():
    calibration = calibrated()
    cameras = calibration.sample(40, seed=1)
    assert cameras == calibration.sample(40, seed=1)
    gaps = np.array([camera.microlenses_to_sensor for camera in cameras])
    k = P.ARRAY_TO_SENSOR
    sigma = np.hypot(calibration.standard_error(k), calibration.model_change[k])
    # The standard deviation of 40 numbers is known to 11 %.
    assert 0.6 < gaps.std() / sigma < 1.4 and abs(gaps.mean() - calibration[k]) < 4 * sigma / 40**0.5


def test_blur_gives_the_focal_lengths_of_the_types():
    for lengths in ((0.62, 0.66, 0.71), (0.65,)):
        calibration = pl.calibrate(
            blurred(observed(), lengths, parameters(), boards_of_50mm(DESIGN)), start=NOMINAL, board=0.0
        )
        # The distances of the calibration, 1 % off, are in them.
        ratio = calibration[P.ARRAY_TO_SENSOR] / parameters()[P.ARRAY_TO_SENSOR]
        found = calibration.camera.microlenses.focal_lengths
        np.testing.assert_allclose(np.array(found) / ratio, lengths, rtol=0.01)
        # Without signs its change with the distance of the boards tells.
        unsigned = blurred(observed(), lengths, parameters(), boards_of_50mm(DESIGN))
        unsigned = dataclasses.replace(unsigned, blur=np.abs(unsigned.blur))
        found = pl.calibrate(unsigned, start=NOMINAL, board=0.0).camera.microlenses.focal_lengths
        np.testing.assert_allclose(np.array(found) / ratio, lengths, rtol=0.01)


def test_gross_errors_do_not_matter():
    usual, rng = observed(), np.random.default_rng(7)
    wrong = rng.random(len(usual.pixel)) < 0.03
    pixel = usual.pixel + wrong[:, None] * rng.uniform(-6.0, 6.0, usual.pixel.shape)
    calibration = pl.calibrate(dataclasses.replace(usual, pixel=pixel), start=NOMINAL, board=0.0)
    assert calibration.corner_rms > 3 * NOISE[0]
    assert np.abs(z_scores(calibration, parameters())).max() < 4
    # Least squares would have three times the error.
    assert calibration.standard_error(P.FOCAL_LENGTH) < 1.6 * calibrated().standard_error(P.FOCAL_LENGTH)


def test_corners_weigh_by_their_errors():
    """Of corners whose errors differ tenfold the good ones tell nearly all."""
    exact, rng = observed(noise=(0.0, NOISE[1])), np.random.default_rng(9)
    bad = rng.random(exact.pixel.shape) < 0.5
    errors = np.where(bad, 1.0, 0.1) * NOISE[0]
    noisy = dataclasses.replace(exact, pixel=exact.pixel + errors * rng.standard_normal(errors.shape))
    even, weighed, tenfold = (
        pl.calibrate(dataclasses.replace(noisy, standard_error=each), start=NOMINAL, board=0.0)
        for each in (None, errors, 10 * errors)
    )
    np.testing.assert_array_equal(tenfold.values, weighed.values)
    assert np.abs(z_scores(weighed, parameters())).max() < 4
    # Information per coordinate is the mean of 1 / error^2; none has more than four times the usual weight.
    ratio = weighed.standard_error(P.FOCAL_LENGTH) / even.standard_error(P.FOCAL_LENGTH)
    assert ratio < 0.75, ratio
    assert abs(weighed.corner_residual[bad].std() / NOISE[0] - 1) < 0.05
    with pytest.raises(pl.errors.InvalidValueError, match="errors of corners are above 0"):
        dataclasses.replace(noisy, standard_error=0 * errors)


def test_few_frames_are_fitted_without_leaving_any_out():
    calibration = pl.calibrate(observed(n=4, bend=0.1), start=NOMINAL)
    assert calibration.held_out == () and calibration.standard_error(P.STRETCH) == 0
    assert (calibration.board_error > 0).all(), "the prior holds the board"
    assert np.abs(z_scores(calibration, parameters())).max() < 4


def test_what_is_said_of_the_calibration():
    calibration = calibrated()
    assert "FOCAL_LENGTH and LENS_TO_ARRAY" in " ".join(calibration.valleys)
    errors = {name: np.array(row) for name, row in calibration.error_table}
    now = errors["these observations"]
    np.testing.assert_allclose(now, np.sqrt(np.diag(calibration.covariance)), rtol=1e-12)
    np.testing.assert_allclose(errors["as many frames again"][:2], now[:2] / 2**0.5, rtol=0.05)
    assert errors["board on a stage, poses known"][0] < 0.5 * now[0]
    assert errors["focal length known"][0] == 0 < errors["focal length known"][1] < 0.5 * now[1]
    white = errors["a white image at another f-number"]
    assert (white <= now * (1 + 1e-6)).all() and (white < 0.9 * now).any()
    assert errors["as many, tilted 20 degrees more"][0] < errors["as many frames again"][0]
    names = ("nearer", "a second focus", "another f-number", "on a stage", "board measured", "tilted")
    assert all(name in calibration.advice for name in names)
    assert "focal_length, mm" in repr(calibration) and "free board not needed" in repr(calibration)
    assert pickle.loads(pickle.dumps(calibration)) == calibration
    for level in (0.0, 1.0, "much"):
        with pytest.raises(pl.errors.InvalidValueError, match="level"):
            calibration.interval(P.PITCH, level)


def test_normal_equations_are_the_products_of_all_derivatives():
    observations = observed(n=3)
    free = np.arange(len(P)) < P.STRETCH
    problem = problem_of(observations, np.array([[3**0.5 / 2, 0.5], [0.0, 1.0]]), free)
    problem = problem._replace(board_sigma=0.3, prior=np.tile([1.0, 0.5], (len(P), 1)))
    from plenoptic.calibration.fitting.solve import State
    from plenoptic.calibration.fitting.start_values import start_state

    start = start_state(problem._replace(board_sigma=0.0), 50.0)
    state = State(start.parameters, start.poses, 0.1 * np.ones_like(problem.board))
    at, cells = evaluate(problem, state), cells_of(problem)
    weights = weight(at.corners), weight(at.centres)
    matrix, side = normal_equations(problem, cells, at, weights)
    rows = np.zeros((*at.corners.shape, problem.unknowns))
    for unknowns, members in zip(cells.unknowns, cells.rows, strict=True):
        for k in members[members < len(rows)]:
            rows[k][:, unknowns] = at.corner_slope[k]
    centres = np.zeros((*at.centres.shape, problem.unknowns))
    centres[:, :, : problem.n_free] = at.centre_slope
    precision = np.zeros(problem.unknowns)
    precision[: problem.n_free], precision[-problem.board.size :] = 0.5, 1 / 0.3**2
    dense = np.diag(precision)
    pull = -np.sqrt(precision) * at.penalty
    for slope, residual, w in ((rows, at.corners, weights[0]), (centres, at.centres, weights[1])):
        dense += np.einsum("nri,nr,nrj->ij", slope, w, slope, optimize=True)
        pull -= np.einsum("nri,nr->i", slope, w * residual)
    np.testing.assert_allclose(matrix, dense, rtol=1e-9, atol=1e-9 * np.abs(dense).max())
    np.testing.assert_allclose(side, pull, rtol=1e-9, atol=1e-9 * np.abs(pull).max())
    assert cell_products(cells, at.corner_slope).shape == (len(cells.rows), *(at.corner_slope.shape[2],) * 2)


def mirrored(observations):
    """Images seen in a mirror beside the camera: columns run the other way, and indices with them."""
    columns = observations.sensor.shape[1] - 1
    flip = [1.0, -1.0]
    return dataclasses.replace(
        observations,
        pixel=observations.pixel * flip + [0.0, columns],
        centre_pixel=observations.centre_pixel * flip + [0.0, columns],
        index=observations.index[:, ::-1],
        centre_index=observations.centre_index[:, ::-1],
    )


def refused(observations, sentence, **options):
    with pytest.raises(pl.errors.InvalidValueError, match=sentence):
        pl.calibrate(observations, **({"start": NOMINAL} | options))


def test_observations_that_give_no_camera_are_refused():
    usual = observed()
    few = usual.frame < 2
    parts = {name: getattr(usual, name)[few] for name in ("index", "pixel", "frame", "point")}
    refused(dataclasses.replace(usual, **parts), "hold 2 frames; a calibration needs at least 3")
    refused(observed(tilt=0.0), "all boards are parallel")
    for n, tilt in ((4, 0.08), (3, 0.12)):  # 38 +- 6 and 54 +- 3 mm, of 50
        refused(observed(n=n, tilt=tilt), "leave the focal length open", board=0.0)
    refused(mirrored(usual), "seen from behind: the images are mirrored")
    refused(dataclasses.replace(usual, centre_index=usual.centre_index[:, ::-1]), "mirrored")
    refused(
        dataclasses.replace(usual, centre_pixel=np.add(usual.centre_pixel, (14.0, 0.0))), "lie outside the micro image"
    )
    for factor in (2.0, 0.5):
        refused(dataclasses.replace(usual, board=factor * usual.board), "check the board's points", board=0.0)
    for factor in (1e-3, 1e3):
        refused(dataclasses.replace(usual, board=factor * usual.board), "give squares and pixel pitch in mm")
        sensor = pl.Sensor(usual.sensor.shape, factor * usual.sensor.pixel_pitch)
        refused(dataclasses.replace(usual, sensor=sensor), "give the pixel pitch .0.0055")
    longer = {"board": usual.board * [1.02, 1.0, 1.0]}
    refused(dataclasses.replace(usual, **longer), "one that is 1 % longer along one side", board=0.0)
    lens = pl.load_lens("double-gauss-105mm-f1.4")
    refused(observed(n=4), "lens 'double-gauss-105mm-f1.4' is not that of", board=0.0, lens=lens)
    refused(
        dataclasses.replace(usual, centre_index=usual.centre_index[:5], centre_pixel=usual.centre_pixel[:5]), "hold 5"
    )
    wrong = usual.centre_index + (np.arange(len(usual.centre_index)) % 2)[:, None]
    refused(dataclasses.replace(usual, centre_index=wrong), "deviate .* from a lattice")
    small = observed(n=3)
    refused(dataclasses.replace(small, point=np.roll(small.point, 300)), "no camera")


def test_images_that_do_not_belong_together_are_refused():
    usual = observed()
    # The white image of a camera with a finer array, and one that was taken for a board.
    other = simulated(parameters(PITCH=0.23), boards_of_50mm(DESIGN, 3), DESIGN)
    white = {"centre_index": other.centre_index, "centre_pixel": other.centre_pixel}
    refused(dataclasses.replace(usual, **white), "of another camera")
    swapped = {"centre_index": usual.index[:600], "centre_pixel": usual.pixel[:600]}
    refused(dataclasses.replace(usual, **swapped), "deviate .* from a lattice")


def test_a_calibration_starts_from_a_design():
    usual = calibrated()
    design = dataclasses.replace(usual.camera, microlenses_to_sensor=0.9)
    again = pl.calibrate(observed(), start=design)
    # The same minimum, to the tolerance of the cost.
    np.testing.assert_allclose(again.values, usual.values, rtol=0, atol=0.05 * np.sqrt(np.diag(usual.covariance)).max())
    assert abs(again[P.FOCAL_LENGTH] - usual[P.FOCAL_LENGTH]) < 0.05 * usual.standard_error(P.FOCAL_LENGTH)
    refused(observed(), "start has no microlenses", start=pl.PlenopticCamera(design.lens, design.sensor, 60.0))


def test_arguments_are_checked():
    refused(observed(), "start is a float", start=50.0)
    refused(observed(), "lens is a str", lens="double-gauss-100mm-f2")
    refused(observed(), "board is -1.0", board=-1.0)
    refused(observed(), "prior of PITCH", priors={P.PITCH: (1.0, 0.0)})
    refused("raw.png", "observations is a str")
    with pytest.raises(pl.errors.InvalidValueError, match="focal_length"):
        pl.calibration.NominalCamera(-50.0, 4.0)
