"""Fits to halves of the frames, judged by the other half, where poses alone are fitted again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.fitting.geometry import Parameter, Poses
from plenoptic.calibration.fitting.solve import Evaluation, Problem, State, minimise
from plenoptic.core.values import Floats


class HalfFit(NamedTuple):
    """Fit to one half of the frames."""

    problem: Problem
    state: State
    at: Evaluation
    held_out: Floats
    """(frames of the other half,) mean square of a coordinate of its corners in pixels^2."""
    corners: NDArray[np.int64]
    """(frames of the other half,) number of its corners."""


def part_of(problem: Problem, state: State, frames: NDArray[np.int64]) -> tuple[Problem, State]:
    """Problem and state of some frames, with all centres."""
    rows = np.isin(problem.frame, frames)
    part = problem._replace(
        grid=problem.grid[rows],
        pixel=problem.pixel[rows],
        error=problem.error[rows],
        frame=np.searchsorted(frames, problem.frame[rows]),
        point=problem.point[rows],
        setting=problem.setting[rows],
    )
    return part, state._replace(poses=Poses(state.poses.turn[frames], state.poses.shift[frames]))


def fit_halves(problem: Problem, state: State) -> tuple[HalfFit, HalfFit]:
    """Fits to the even and to the odd frames, from the state of all and with its standard deviations."""
    numbers = np.arange(problem.frames)
    even, odd = numbers[::2], numbers[1::2]
    return _fit_half(problem, state, even, odd), _fit_half(problem, state, odd, even)


def _fit_half(problem: Problem, state: State, frames: NDArray[np.int64], others: NDArray[np.int64]) -> HalfFit:
    part, start = part_of(problem, state, frames)
    fitted, at = minimise(part, start)
    # Distances of the boards go with the focal length, which one half may leave open.
    longer = fitted.parameters[Parameter.FOCAL_LENGTH] / state.parameters[Parameter.FOCAL_LENGTH]
    poses = state.poses._replace(shift=state.poses.shift * longer)
    held, start = part_of(problem, State(fitted.parameters, poses, fitted.offset), others)
    held = held._replace(free=np.zeros_like(problem.free), board=problem.board + fitted.offset, board_sigma=0.0)
    _, result = minimise(held, start._replace(offset=np.zeros_like(fitted.offset)))
    squares = np.mean((result.corners * held.error * held.sigma[0]) ** 2, axis=1)
    counts = np.bincount(held.frame)
    return HalfFit(part, fitted, at, np.bincount(held.frame, squares) / counts, counts)
