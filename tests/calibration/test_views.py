"""Calibration of simulated unfocused cameras (1.0) from corners in views."""

import dataclasses
import functools

import numpy as np
import pytest
from calibration_helpers import (
    NOMINAL,
    SENSOR,
    P,
    board_points,
    boards_of_50mm,
    parameters_1_0,
    seen_in_views,
    simulated_views,
)

import plenoptic as pl
from plenoptic.calibration.fitting.geometry import lenslets, project_corners, project_views
from plenoptic.calibration.fitting.traced_lens import trace_lens
from plenoptic.errors import InvalidValueError

DESIGN, _ = board_points()
NOISE = 0.3, 0.03
SHARED = [P.FOCAL_LENGTH, P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR, P.PITCH, P.TURN, P.TILT_X, P.TILT_Y, P.AXIS_ROW]


def simulated_camera(seed, n=10, **options):
    rng = np.random.default_rng(seed)
    values = parameters_1_0(
        LENS_TO_ARRAY=58.0 + rng.uniform(-1.5, 1.5), ARRAY_TO_SENSOR=rng.uniform(0.4, 0.7), TURN=rng.uniform(-1.0, 1.0)
    )
    boards = boards_of_50mm(DESIGN, n, seed)
    return values, boards, simulated_views(values, boards, DESIGN, **({"noise": NOISE, "seed": seed} | options))


@functools.cache
def calibrated(seed=0, n=10):
    values, _, observations = simulated_camera(seed, n, radius=2.3)
    return values, observations, pl.calibrate(observations, start=NOMINAL)


def points_and_rays(seed=0, n=30, main_lens=None):
    """Values with all terms, points whose images lie in front of the array, on it and behind the sensor, and rays."""
    rng, values = np.random.default_rng(seed), parameters_1_0(STRETCH=1e-3)
    depth = rng.uniform(350.0, 520.0, n)
    depth[:5] = 51.0 * 58.0 / 7.0
    points = np.column_stack([rng.uniform(-15.0, 15.0, (n, 2)), -depth])
    return values, points, *seen_in_views(values, points, rng.uniform(-4.0, 4.0, (n, 2)), main_lens)


def test_rays_through_lattice_positions_agree_with_those_through_microlenses():
    values, points, position, pixel = points_and_rays()
    away = np.abs(51.0 * points[:, 2] / (51.0 + points[:, 2]) - 58.0) > 0.05
    seen = project_corners(values, position, points, SENSOR.pixel_pitch).pixel
    np.testing.assert_allclose(seen[away], pixel[away], rtol=0, atol=1e-8)
    # A displacement on the array is one in the plane of the image, but for the distance of the micro images.
    step = np.array([0.1, 0.0])
    offset = project_views(values, position + step, pixel, points, SENSOR.pixel_pitch).pixel
    centre = lenslets(values, np.vstack([position, position + step])).centre[:, :2]
    moved = np.diff(centre.reshape(2, -1, 2), axis=0)[0] / SENSOR.pixel_pitch
    gap = 58.0 - 51.0 * points[:, 2] / (51.0 + points[:, 2])
    expected = -np.column_stack([moved[:, 1], -moved[:, 0]]) * (1.0 + gap / 0.5)[:, None]
    np.testing.assert_allclose(offset, expected, rtol=0.02, atol=1e-3)


@pytest.mark.parametrize("traced", [False, True])
def test_derivatives_are_those_of_differences(traced):
    main_lens = trace_lens(pl.load_lens("double-gauss-100mm-f2"), 58.0 / 51.0, 0.1) if traced else None
    values, points, position, pixel = points_and_rays(main_lens=main_lens)
    position = position + 0.05 * np.random.default_rng(1).standard_normal(position.shape)

    def offset(values, points):
        return project_views(values, position, pixel, points, SENSOR.pixel_pitch, main_lens).pixel

    at = project_views(values, position, pixel, points, SENSOR.pixel_pitch, main_lens)
    for p in P:
        step = 1e-5 * max(abs(values[p]), 1e-2) * (np.arange(len(P)) == p)
        numeric = (offset(values + step, points) - offset(values - step, points)) / (2.0 * step[p])
        # Derivatives of traced rays are themselves differences, with errors of 1e-5.
        np.testing.assert_allclose(at.slope[:, :, p], numeric, rtol=0, atol=3e-5 * np.abs(numeric).max() + 1e-9)
    for k, step in enumerate(1e-3 * np.eye(3)):
        numeric = (offset(values, points + step) - offset(values, points - step)) / 2e-3
        np.testing.assert_allclose(at.by_point[:, :, k], numeric, rtol=0, atol=1e-6 * np.abs(numeric).max())


def test_exact_corners_in_views_give_the_camera_back():
    values, _, observations = simulated_camera(3, n=5, noise=(0.0, 0.0), radius=2.0)
    calibration = pl.calibrate(observations, start=NOMINAL, board=0.0)
    np.testing.assert_allclose(calibration.values[SHARED], values[SHARED], rtol=1e-6, atol=1e-9)
    assert calibration.corner_rms < 1e-6


def test_errors_are_those_of_the_noise_and_the_twin_is_unfocused():
    values, _, calibration = calibrated()
    z = (calibration.values - values)[SHARED] / np.sqrt(np.diag(calibration.covariance))[SHARED]
    assert np.abs(z).max() < 4
    # Residuals are errors of the lattice position, but for the distances of micro images and microlenses.
    assert abs(calibration.corner_rms / NOISE[0] - 1) < 0.05
    assert calibration.error_cluster is pl.calibration.ErrorCluster.CORNER
    assert calibration.camera.report().kind is pl.CameraKind.PLENOPTIC_1
    assert calibration.camera.microlenses.focal_lengths == (calibration[P.ARRAY_TO_SENSOR],)


@pytest.mark.slow
def test_advice_is_what_more_boards_give():
    _, _, calibration = calibrated(n=6)
    rows = dict(calibration.error_table)
    _, _, twice = simulated_camera(0, n=12, radius=2.3)
    real = pl.calibrate(twice, start=NOMINAL).standard_error(P.FOCAL_LENGTH)
    assert rows["as many frames again"][P.FOCAL_LENGTH] == pytest.approx(real, rel=0.3)


@pytest.mark.slow
def test_errors_of_many_unfocused_cameras_are_those_that_are_stated():
    z = []
    for seed in range(12):
        values, _, calibration = calibrated(seed, 6)
        z.append(((calibration.values - values) / np.sqrt(np.maximum(np.diag(calibration.covariance), 1e-300)))[SHARED])
    # As of focused cameras: some 5 independent parameters of 12 cameras.
    assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.25


def test_a_traced_lens_gives_the_camera_back():
    values, lens = parameters_1_0(), pl.load_lens("double-gauss-100mm-f2")
    main_lens = trace_lens(lens, 58.0 / 51.0, 0.1)
    boards = boards_of_50mm(DESIGN, 5, 2)
    observations = simulated_views(values, boards, DESIGN, radius=2.0, noise=(1e-3, 1e-3), main_lens=main_lens)
    calibration = pl.calibrate(observations, start=NOMINAL, lens=lens, board=0.0)
    # The pupil's position at the array's distance is one of the lens, fitted over another field.
    assert abs(calibration[P.FOCAL_LENGTH] - 51.0) < 0.05 and calibration.corner_rms < 5e-3
    assert abs(calibration[P.ARRAY_TO_SENSOR] - 0.5) < 1e-3


def test_corners_in_views_of_another_board_and_tables_of_micro_images_are_refused(tmp_path):
    _, observations, calibration = calibrated()
    with pytest.raises(InvalidValueError, match="in micro images only"):
        pl.export.compote_calibration(tmp_path, calibration, observations)
    shown = observations.frame == 1
    rare = np.flatnonzero(~shown | (np.cumsum(shown) % 70 == 1))
    parts = {name: getattr(observations, name)[rare] for name in ("index", "pixel", "frame", "point")}
    with pytest.raises(InvalidValueError, match="in 3 views or more"):
        pl.calibrate(dataclasses.replace(observations, **parts), start=NOMINAL)
    with pytest.raises(InvalidValueError, match="outside the micro image"):
        pl.calibrate(dataclasses.replace(observations, pixel=np.add(observations.pixel, [0.0, 20.0])), start=NOMINAL)


def test_whole_indices_are_those_of_micro_images():
    _, observations, _ = calibrated()
    assert observations.in_views and observations.index.dtype == np.float64
    whole = dataclasses.replace(observations, index=np.rint(observations.index))
    assert not whole.in_views and whole.index.dtype == np.int64
    with pytest.raises(InvalidValueError, match="index"):
        dataclasses.replace(observations, index=np.full_like(observations.index, np.nan))
