"""Errors of a calibration if more were photographed or measured, by the information of the observations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.fitting.covariance import information, inverse
from plenoptic.calibration.fitting.geometry import Parameter, Poses, rotations
from plenoptic.calibration.fitting.settings import distance_columns
from plenoptic.calibration.fitting.solve import Problem, State, evaluate, prior_precision
from plenoptic.core.values import Floats

P = Parameter
_TILT = math.radians(20.0)
_IMAGE_SHIFT = 0.5
"""Distance by which nearer boards move their images, and the second focus setting the array, over that from array to
sensor."""


def error_table(problem: Problem, state: State, covariance: Floats) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Names of proposals and the standard errors that all parameters would then have.

    New frames show the same corners through the same microlenses, with poses of their own; errors of these
    observations are the stated ones, and others are in proportion.
    """
    n_free, first = problem.n_free, problem.n_free + 6 * problem.frames
    camera = np.arange(n_free)
    board = np.arange(n_free, n_free + problem.unknowns - first)
    poses = state.poses
    normal = poses.turn[:, :, 2]
    sideways = np.cross([0.0, 0.0, 1.0], normal)
    length = np.linalg.norm(sideways, axis=1, keepdims=True)
    axis = np.where(length > 0, sideways / np.where(length > 0, length, 1.0), [1.0, 0.0, 0.0])
    tilted = Poses(rotations(_TILT * axis) @ poses.turn, poses.shift)
    f = state.parameters[P.FOCAL_LENGTH]
    move = _IMAGE_SHIFT * state.parameters[P.ARRAY_TO_SENSOR]
    depth = -poses.shift[:, 2:]
    ratio = f / depth / (1.0 - 1.0 / (depth / (depth - f) + move / f))
    nearer = f"as many, {100 * (1 - np.median(ratio)):.0f} % nearer"
    distances = distance_columns(len(problem.free))
    refocused = state.parameters - move * np.isin(np.arange(len(problem.free)), distances)
    own_array = np.flatnonzero(np.isin(np.flatnonzero(problem.free), distances))
    none = np.zeros(0, dtype=np.int64)

    matrix, centres = _information_at(problem, state)
    now, prior = _without_poses(problem, matrix), np.delete(prior_precision(problem), np.arange(n_free, first))
    white = np.zeros_like(now)
    white[:n_free, :n_free] = centres
    on_stage = np.delete(np.delete(matrix, np.arange(n_free, first), axis=0), np.arange(n_free, first), axis=1)

    def again(changed: State, own: NDArray[np.int64] = none) -> Floats:
        return now + _without_poses(problem, _information_at(problem, changed)[0], own)

    proposals: dict[str, tuple[Floats, NDArray[np.int64]]] = {
        "these observations": (now, none),
        "as many frames again": (2.0 * now - white, none),
        "as many, tilted 20 degrees more": (again(state._replace(poses=tilted)) - white, none),
        nearer: (again(state._replace(poses=poses._replace(shift=ratio * poses.shift))) - white, none),
        "all again at a second focus": (again(state._replace(parameters=refocused), own_array), none),
        "a white image at another f-number": (now + white, none),
        "board measured": (now, board),
        "board on a stage, poses known": (on_stage, none),
        "focal length known": (now, camera[np.flatnonzero(problem.free) == P.FOCAL_LENGTH]),
    }  # fmt: skip
    stated, base = np.sqrt(np.diag(covariance)), np.ones(len(covariance))
    rows: list[tuple[str, tuple[float, ...]]] = []
    for name, (total, fixed) in proposals.items():
        fitted = np.setdiff1d(np.arange(len(prior)), fixed)
        variance = np.zeros(len(prior))
        variance[fitted] = np.diag(inverse((total + np.diag(prior))[np.ix_(fitted, fitted)]))
        error = np.zeros(len(stated))
        error[problem.free] = np.sqrt(np.maximum(variance[:n_free], 0.0))
        base = np.where(error > 0, error, 1.0) if not rows else base
        rows.append((name, tuple((stated * error / base).tolist())))
    return tuple(rows)


def _information_at(problem: Problem, state: State) -> tuple[Floats, Floats]:
    """Information of observations that agree with a state, without priors, and the part of the centres."""
    at = evaluate(problem, state)
    at = at._replace(corners=np.zeros_like(at.corners), centres=np.zeros_like(at.centres))
    centres = np.einsum("mij,mik->jk", at.centre_slope, at.centre_slope)
    return information(problem, at) - np.diag(prior_precision(problem)), centres


def _without_poses(problem: Problem, matrix: Floats, own: NDArray[np.int64] | None = None) -> Floats:
    """Information of camera and board with free poses, and with free values of the observations' own parameters."""
    poses = np.arange(problem.n_free, problem.n_free + 6 * problem.frames)
    free = poses if own is None else np.concatenate([own, poses])
    shared = np.delete(np.arange(len(matrix)), free)
    cross = matrix[np.ix_(shared, free)]
    reduced = np.zeros_like(matrix)
    reduced[np.ix_(shared, shared)] = (
        matrix[np.ix_(shared, shared)] - cross @ inverse(matrix[np.ix_(free, free)]) @ cross.T
    )
    return np.delete(np.delete(reduced, poses, axis=0), poses, axis=1)
