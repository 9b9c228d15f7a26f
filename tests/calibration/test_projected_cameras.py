"""Calibration of cameras by their own projections: errors are those that are stated, and as small as they can be."""

import numpy as np
import pytest
from calibration_helpers import (
    GALILEAN,
    KEPLERIAN,
    P,
    board_points,
    boards_in_view,
    camera_as_built,
    observed,
    true_values,
)

import plenoptic as pl

NOISE = 0.3, 0.05
CASES = [(GALILEAN, 0.0), (KEPLERIAN, 0.0), (GALILEAN, 0.3), (KEPLERIAN, 0.3)]


def calibrated(seed, distances, bend, n=12, shape=(700, 900)):
    camera, (design, board) = camera_as_built(seed, distances=distances, shape=shape), board_points(bend, seed)
    observations = observed(camera, boards_in_view(board, n, seed), design, noise=NOISE, seed=seed)
    return camera, pl.calibrate(observations, start=pl.calibration.NominalCamera(100.0, 7.0))


def scores(camera, calibration):
    sigma = np.sqrt(np.diag(calibration.covariance))[: P.STRETCH]
    return (calibration.values - true_values(camera, calibration))[: P.STRETCH] / sigma


def test_a_projected_camera_comes_back():
    camera, calibration = calibrated(0, GALILEAN, 0.0)
    assert np.abs(scores(camera, calibration)).max() < 4
    assert calibration.error_cluster is pl.calibration.ErrorCluster.CORNER
    assert not any(test.accepted for test in calibration.held_out)


@pytest.mark.slow
def test_errors_of_many_cameras_are_those_that_are_stated():
    """Twelve cameras with Galilean and Keplerian arrays, of which half see a bent board."""
    cases = [(4 * k + n, *case) for k in range(3) for n, case in enumerate(CASES)]
    z = np.array([scores(*calibrated(*case, n=10, shape=(490, 630))) for case in cases])
    # Of 12 normal numbers the root mean square is 1 +- 0.2, and all parameters together are some 5 independent ones.
    rms = np.sqrt(np.mean(z**2, axis=0))
    assert ((rms > 0.4) & (rms < 1.6)).all(), rms
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.25


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_prescriptions_give_the_camera_back_and_intervals_hold_it_with_another_lens(seed):
    distances, bend = CASES[seed]
    camera = camera_as_built(seed, distances=distances, model=pl.LensModel.EXACT, shape=(560, 720))
    design, board = board_points(bend, seed)
    observations = observed(camera, boards_in_view(board, 6, seed), design, noise=NOISE, seed=seed)
    errors = NOISE[0] * np.random.default_rng(seed).standard_normal(observations.pixel.shape)
    start = pl.calibration.NominalCamera(100.0, 7.0)
    for lens in (camera.lens, pl.load_lens("double-gauss-105mm-f1.4")):
        calibration = pl.calibrate(observations, start=start, lens=lens)
        twin = calibration.camera.lens
        points = pl.paraxial.cardinal_points(twin)
        assert twin.name == lens.name and abs(points.efl - calibration[P.FOCAL_LENGTH]) < 1e-9 * points.efl
        assert abs(calibration[P.EXIT_PUPIL] - points.rear_principal + points.exit_pupil) < 1e-3
        off = observations.pixel + calibration.corner_residual - (observations.pixel - errors)
        assert np.sqrt(np.mean(off**2)) < 0.05
        truth = true_values(camera, calibration)
        held = [low < truth[p] < high for p in list(P)[: P.STRETCH] for low, high in [calibration.interval(p)]]
        assert np.mean(held) > 0.8
        if lens is camera.lens:
            assert np.abs(scores(camera, calibration)).max() < 4
