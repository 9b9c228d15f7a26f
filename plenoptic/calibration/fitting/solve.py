"""Damped least squares (Levenberg and Marquardt) with a robust loss, for camera, poses and board together."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.fitting.geometry import (
    COUNT,
    Corners,
    Poses,
    project_centres,
    project_corners,
    project_views,
    rotate_points,
    rotations,
)
from plenoptic.calibration.fitting.settings import project_settings
from plenoptic.calibration.fitting.traced_lens import TracedLens
from plenoptic.calibration.observations import Observations
from plenoptic.core.values import Floats

LOSS_SCALE = 2.0
"""Standard deviations at which the pseudo-Huber loss goes over from squares to absolute values."""
_GAUSSIAN_MOMENT = 0.784624
"""Mean of z^2 times its weight for a normal z of variance 1. Gaussian errors make estimates 1 % less exact."""
_TRIALS, _MORE, _LESS, _LEAST = 12, 10.0, 0.01, 1e-13
"""Dampings that are tried in one step, factors on the damping after failure and success, and the least one."""
_UNDAMPED = 1e-10
"""Damping, relative to the information of each unknown alone, that changes no step."""
_TOLERANCES = (100.0, 1.0, *6 * (0.01,))
"""Decrease of the cost at which rounds of steps end; in between standard deviations are estimated."""
_LEAST_ERROR = 0.5
"""Least standard error of a corner over their median: displacements that are none of noise are in all of them."""
_BETTER_TILT = 0.95
"""Cost of the corners of a board tilted the other way, over that of its pose, below which it stands so."""


class Problem(NamedTuple):
    """Observations as arrays, standard deviations, and unknowns."""

    grid: Floats
    """(n, 2) microlenses of the corners, or lattice positions between them, in pitches from the pivot."""
    pixel: Floats
    error: Floats
    """(n, 2) standard deviation of each coordinate of the corners over their root mean square."""
    frame: NDArray[np.int64]
    """(n,) numbered from 0 without gaps."""
    point: NDArray[np.int64]
    setting: NDArray[np.int64]
    """(n,) focus settings of the corners, ascending."""
    centre_grid: Floats
    centre_pixel: Floats
    centre_setting: NDArray[np.int64]
    pixel_pitch: float
    board: Floats
    """(p, 3) points as designed, relative to their mean."""
    free: NDArray[np.bool_]
    """(COUNT + further settings,) parameters that are fitted."""
    prior: Floats
    """(..., 2) mean and precision 1 / sigma^2 of the parameters."""
    board_sigma: float
    """Standard deviation in mm of a coordinate of a board point; 0: the board is as designed."""
    sigma: tuple[float, float] = (0.7, 0.18)
    """Standard deviation of a coordinate of corners and of centres in pixels."""
    main_lens: TracedLens | None = None
    """Prescription of the main lens; None: a thin lens."""
    in_views: bool = False
    """True for corners in views, whose residuals are those in the plane of their image."""

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.frame.max(initial=-1)) + 1

    @property
    def n_free(self) -> int:
        """Number of fitted parameters of the camera."""
        return int(self.free.sum())

    @property
    def unknowns(self) -> int:
        """Number of unknowns: parameters, poses, board."""
        return self.n_free + 6 * self.frames + (self.board.size if self.board_sigma > 0 else 0)


class State(NamedTuple):
    """Values of all unknowns."""

    parameters: Floats
    poses: Poses
    offset: Floats
    """(p, 3) board points minus their designed positions, mm."""


class Evaluation(NamedTuple):
    """Residuals over their standard deviations, and their derivatives by the unknowns that they depend on."""

    corners: Floats
    """(n, 2)"""
    corner_slope: Floats
    """(n, 2, k): parameters, pose of the frame, board point."""
    centres: Floats
    """(m, 2)"""
    centre_slope: Floats
    """(m, 2, parameters)"""
    penalty: Floats
    """(unknowns,) residuals of the priors over their standard deviations."""
    cost: float


class CornerGroups(NamedTuple):
    """Corners grouped by frame and board point."""

    rows: NDArray[np.int64]
    """(c, most) rows of each cell; the number of all rows where there is none."""
    unknowns: NDArray[np.int64]
    """(c, k) unknowns that each cell depends on."""


def loss(residuals: Floats) -> float:
    """Pseudo-Huber loss, for small residuals the sum of squares."""
    scaled = residuals / LOSS_SCALE
    return float(2.0 * LOSS_SCALE**2 * np.sum(scaled**2 / (1.0 + np.sqrt(1.0 + scaled**2))))


def weight(residuals: Floats) -> Floats:
    """Weight of each residual: half the derivative of the loss over the residual."""
    return np.asarray(1.0 / np.sqrt(1.0 + (residuals / LOSS_SCALE) ** 2))


def curvature(residuals: Floats) -> Floats:
    """Half the second derivative of the loss."""
    return np.asarray(weight(residuals) ** 3)


def cells_of(problem: Problem) -> CornerGroups:
    """Group the corners of a problem."""
    points = len(problem.board)
    names, cell, counts = np.unique(problem.frame * points + problem.point, return_inverse=True, return_counts=True)
    order = np.argsort(cell, kind="stable")
    within = np.arange(len(cell)) - np.repeat(np.cumsum(counts) - counts, counts)
    rows = np.full((len(names), counts.max(initial=0)), len(cell))
    rows[cell[order], within] = order
    frame, point = names[:, None] // points, names[:, None] % points
    unknowns = [np.tile(np.arange(problem.n_free), (len(names), 1)), problem.n_free + 6 * frame + np.arange(6)]
    if problem.board_sigma > 0:
        unknowns.append(problem.n_free + 6 * problem.frames + 3 * point + np.arange(3))
    return CornerGroups(rows, np.concatenate(unknowns, axis=1))


def points_of(problem: Problem, state: State) -> tuple[Floats, Floats]:
    """Points of the corners (n, 3) in the camera's axes, and relative to the origins of their boards."""
    arms = rotate_points(state.poses, problem.frame, (problem.board + state.offset)[problem.point])
    return arms + state.poses.shift[problem.frame], arms


def evaluate(problem: Problem, state: State) -> Evaluation:
    """Residuals and derivatives at a state."""
    free, (corner_sigma, centre_sigma) = problem.free, problem.sigma
    points, arms = points_of(problem, state)
    pitch, lens = problem.pixel_pitch, problem.main_lens

    def project(parameters: Floats, rows: Any) -> Corners:
        if problem.in_views:
            return project_views(parameters, problem.grid[rows], problem.pixel[rows], points[rows], pitch, lens)
        return project_corners(parameters, problem.grid[rows], points[rows], pitch, lens)

    projection = Corners(*project_settings(state.parameters, problem.setting, project))
    slopes = [projection.slope[:, :, free], np.cross(arms[:, None, :], projection.by_point), projection.by_point]
    if problem.board_sigma > 0:
        slopes.append(projection.by_point @ state.poses.turn[problem.frame])
    corner_error = corner_sigma * problem.error
    corners = (projection.pixel - (0.0 if problem.in_views else problem.pixel)) / corner_error
    middle, middle_slope = centres_of(problem, state.parameters)
    centres = (middle - problem.centre_pixel) / centre_sigma
    penalty = np.zeros(problem.unknowns)
    mean, precision = problem.prior.T
    penalty[: problem.n_free] = (np.sqrt(precision) * (state.parameters - mean))[free]
    if problem.board_sigma > 0:
        penalty[-state.offset.size :] = state.offset.ravel() / problem.board_sigma
    cost = loss(corners) + loss(centres) + float(penalty @ penalty)
    # A point at the focal plane or in the plane of its microlens has no image.
    cost = cost if np.isfinite(cost) and bool((points[:, 2] < -state.parameters[0]).all()) else np.inf
    slope = np.concatenate(slopes, axis=2) / np.broadcast_to(corner_error, corners.shape)[:, :, None]
    return Evaluation(corners, slope, centres, middle_slope[:, :, free] / centre_sigma, penalty, cost)


def centres_of(problem: Problem, parameters: Floats) -> tuple[Floats, ...]:
    """Centres of micro images: row and column (m, 2), and derivatives (m, 2, parameters)."""
    return project_settings(
        parameters,
        problem.centre_setting,
        lambda values, rows: project_centres(values, problem.centre_grid[rows], problem.pixel_pitch, problem.main_lens),
    )


def prior_precision(problem: Problem) -> Floats:
    """Precision (unknowns,) of the priors."""
    precision = np.zeros(problem.unknowns)
    precision[: problem.n_free] = problem.prior[problem.free, 1]
    if problem.board_sigma > 0:
        precision[-problem.board.size :] = 1.0 / problem.board_sigma**2
    return precision


def cell_products(cells: CornerGroups, rows: Floats) -> Floats:
    """Sums (c, k, k) over the rows of each cell of the products of rows (n, 2, k) with themselves."""
    padded = np.concatenate([rows, np.zeros((1, *rows.shape[1:]))])
    stacked = padded[cells.rows].reshape(len(cells.rows), -1, rows.shape[2])
    return np.asarray(stacked.transpose(0, 2, 1) @ stacked)


def normal_equations(
    problem: Problem, cells: CornerGroups, at: Evaluation, weights: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Matrix and right-hand side of the least-squares step, with weights of corners (n, 2) and centres (m, 2)."""
    n_free, total = problem.n_free, problem.unknowns
    corner_root, centre_root = (np.sqrt(each)[:, :, None] for each in weights)
    rows = np.concatenate([at.corner_slope, at.corners[:, :, None]], axis=2) * corner_root
    products = cell_products(cells, rows)
    matrix, side = np.diag(prior_precision(problem)), np.zeros(total)
    np.add.at(matrix, (cells.unknowns[:, :, None], cells.unknowns[:, None, :]), products[:, :-1, :-1])
    np.add.at(side, cells.unknowns, -products[:, :-1, -1])
    centre = (at.centre_slope * centre_root).reshape(2 * len(at.centres), n_free)
    matrix[:n_free, :n_free] += centre.T @ centre
    side[:n_free] -= centre.T @ (at.centres * centre_root[:, :, 0]).ravel()
    side -= np.sqrt(prior_precision(problem)) * at.penalty
    return matrix, side


def step(problem: Problem, state: State, change: Floats) -> State:
    """State after a change of all unknowns."""
    n_free, n_poses = problem.n_free, 6 * problem.frames
    parameters = state.parameters.copy()
    parameters[problem.free] += change[:n_free]
    poses = state.poses.advance(change[n_free : n_free + n_poses].reshape(-1, 6))
    offset = state.offset
    if problem.board_sigma > 0:
        offset = offset + change[n_free + n_poses :].reshape(-1, 3)
    return State(parameters, poses, offset)


def minimise(problem: Problem, state: State, *, steps: int = 60, tolerance: float = 0.01) -> tuple[State, Evaluation]:
    """Minimise the cost from a state; ends when an undamped step decreases it by less than a tolerance.

    A cost of 1 is one standard deviation, by which one combination of the unknowns can be wrong.
    """
    cells, at, damping = cells_of(problem), evaluate(problem, state), 1e-6
    for _ in range(steps):
        matrix, side = normal_equations(problem, cells, at, (weight(at.corners), weight(at.centres)))
        scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        scaled = matrix * scale[:, None] * scale
        used = damping
        for _ in range(_TRIALS):
            change = scale * np.linalg.solve(scaled + used * np.eye(len(scaled)), scale * side)
            trial = step(problem, state, change)
            result = evaluate(problem, trial)
            if result.cost < at.cost:
                break
            used *= _MORE
        else:
            return state, at
        decrease = at.cost - result.cost
        state, at, damping = trial, result, max(used * _LESS, _LEAST)
        if decrease < tolerance and used <= _UNDAMPED:
            break
    return state, at


def fit(problem: Problem, state: State) -> tuple[Problem, State, Evaluation]:
    """Minimise with standard deviations estimated from the residuals; returns the problem that has them."""
    for tolerance in _TOLERANCES:
        state, at = minimise(problem, state, tolerance=tolerance)
        factors = [
            np.sqrt(float(np.mean(weight(each) * each**2)) / _GAUSSIAN_MOMENT * count / max(count - unknowns, 1))
            for each, count, unknowns in (
                (at.corners, at.corners.size, problem.unknowns - problem.n_free),
                (at.centres, at.centres.size, problem.n_free),
            )
        ]
        # In steps, so that neither kind of observation outweighs the other before both are fitted.
        corners, centres = np.clip(factors, 0.2, 5.0).tolist()
        problem = problem._replace(sigma=(problem.sigma[0] * corners, problem.sigma[1] * centres))
        if tolerance == _TOLERANCES[-1] and max(abs(factor - 1.0) for factor in factors) < 0.003:
            break
    tilted = _tilt_back(problem, state)
    return (problem, state, evaluate(problem, state)) if tilted is None else fit(problem, tilted)


def _tilt_back(problem: Problem, state: State) -> State | None:
    """The state with boards tilted the other way from the line of sight whose corners then fit better; None without.

    Images of a flat board are nearly the same for two poses (D. Oberkampf, D. F. DeMenthon and L. S. Davis, Computer
    Vision and Image Understanding 63 (1996) 495, doi:10.1006/cviu.1996.0037).
    """
    turn, shift = state.poses
    sight, normal = shift / np.linalg.norm(shift, axis=1)[:, None], turn[:, :, 2]
    along = np.einsum("ni,ni->n", sight, normal)
    axis, sine = np.cross(normal, sight), np.sqrt(np.maximum(1.0 - along**2, 1e-24))
    vectors = axis * (2.0 * np.arctan2(sine, np.abs(along)) * np.sign(along) / sine)[:, None]
    flat = problem._replace(free=np.zeros_like(problem.free), board=problem.board + state.offset, board_sigma=0.0)
    start = State(state.parameters, Poses(rotations(vectors) @ turn, shift), np.zeros_like(state.offset))
    (other, at), before = minimise(flat, start), evaluate(problem, state)
    costs = [np.bincount(problem.frame, (weight(z) * z**2).sum(axis=1)) for z in (at.corners, before.corners)]
    better = (costs[0] < _BETTER_TILT * costs[1])[:, None]
    if not better.any():
        return None
    poses = Poses(np.where(better[..., None], other.poses.turn, turn), np.where(better, other.poses.shift, shift))
    return state._replace(poses=poses)


def pivot_of(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Lattice indices (2,) of the microlens in the middle of the observed ones."""
    return np.asarray(np.rint(index.mean(axis=0)), dtype=np.int64)


def problem_of(observations: Observations, basis: Floats, free: NDArray[np.bool_]) -> Problem:
    """Problem of one focus setting with a board as designed and without priors."""
    pivot = pivot_of(observations.centre_index)
    grid, centre_grid = ((each - pivot) @ basis for each in (observations.index, observations.centre_index))
    frame = np.searchsorted(observations.frames, observations.frame)
    board = observations.board - observations.board.mean(axis=0)
    return Problem(
        grid, observations.pixel, _relative_errors(observations), frame, observations.point, np.zeros_like(frame),
        centre_grid, observations.centre_pixel, np.zeros(len(centre_grid), np.int64), observations.sensor.pixel_pitch,
        board, free,
        np.zeros((COUNT, 2)), 0.0, in_views=observations.in_views,
    )  # fmt: skip


def _relative_errors(observations: Observations) -> Floats:
    """Standard errors (n, 2) of corners over their median, none below half of it."""
    errors = observations.standard_error
    if errors is None:
        return np.ones_like(observations.pixel)
    return np.asarray(np.maximum(errors / np.median(errors), _LEAST_ERROR))
