"""Start values of a calibration, from the lattices of micro images and nominal data."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.fitting.geometry import COUNT, Parameter, Poses
from plenoptic.calibration.fitting.solve import Problem, State, minimise
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError

P = Parameter
_MAGNIFICATIONS, _GAPS = np.geomspace(0.001, 20.0, 44), np.geomspace(1.0, 50.0, 26)
"""Magnifications of boards by the lens, and distances from array to sensor in pitches, that are tried."""
MIN_LENSES = 3
"""Least number of microlenses in which a corner must be seen."""
_CANDIDATES = 4
NEAREST, FARTHEST = 0.9, 21.0
"""Least and largest distance from lens to array at a further focus setting, in focal lengths."""


class ImageLattice(NamedTuple):
    """Lattice of the micro images: the pixel row, column at lattice position (x, y) is origin + (x, y) @ steps."""

    origin: Floats
    steps: Floats
    """(2, 2)"""
    residual: float
    """Root mean square of a coordinate in pixels."""


def image_lattice(grid: Floats, pixel: Floats) -> ImageLattice:
    """Fit of the lattice to centres of micro images."""
    table = np.column_stack([np.ones(len(grid)), grid])
    solution: Floats = np.asarray(np.linalg.lstsq(table, pixel, rcond=None)[0], dtype=np.float64)
    return ImageLattice(solution[0], solution[1:], float(np.sqrt(np.mean((table @ solution - pixel) ** 2))))


class _Bundles(NamedTuple):
    """Lines of light through the array: scale times a corner's pixel is height + slope times that of the centre."""

    frame: NDArray[np.int64]
    point: NDArray[np.int64]
    scale: Floats
    slope: Floats
    height: Floats
    """(c, 2) x and y in mm."""


def _bundles(problem: Problem, lattice: ImageLattice, axis: Floats) -> _Bundles:
    """Fit of each corner of each frame that enough microlenses see, to x and y in mm from the axis.

    Scales are 1 in micro images. In views slopes are 1, as one position of the array may have the corner in all views.
    """
    to_xy = problem.pixel_pitch * np.array([[0.0, 1.0], [-1.0, 0.0]])
    centre, corner = ((each - axis) @ to_xy for each in (lattice.origin + problem.grid @ lattice.steps, problem.pixel))
    points = len(problem.board)
    names, cell, counts = np.unique(problem.frame * points + problem.point, return_inverse=True, return_counts=True)

    def mean(values: Floats) -> Floats:
        return np.column_stack([np.bincount(cell, each, len(names)) / counts for each in values.T])

    by, of = (corner, centre) if problem.in_views else (centre, corner)
    by_mean, of_mean = mean(by), mean(of)
    spread = mean((by - by_mean[cell]) ** 2).sum(axis=1)
    both = mean((by - by_mean[cell]) * (of - of_mean[cell])).sum(axis=1)
    # Three microlenses in a triangle are the fewest that tell the slope.
    used = (counts >= MIN_LENSES) & (spread > 0)
    slope = both[used] / spread[used]
    frame, point, ones = names[used] // points, names[used] % points, np.ones(len(slope))
    height = of_mean[used] - slope[:, None] * by_mean[used]
    if problem.in_views:
        return _Bundles(frame, point, slope, ones, -height)
    return _Bundles(frame, point, ones, slope, height)


def start_state(problem: Problem, focal_length: float, distances: tuple[float, float] | None = None) -> State:
    """State from which the solver converges.

    Of trial distances from lens to array and from array to sensor, those are refined with which the images of the
    boards, brought back through the lens, are closest to the boards. Nominal distances leave no trials. Distances to
    the array at further focus settings follow from the pitch of their micro images.
    """
    first = setting_part(problem, 0)
    lattice = image_lattice(first.centre_grid, first.centre_pixel)
    gaps = _GAPS * _pitch(lattice) * problem.pixel_pitch
    arrays = focal_length * (1.0 + _MAGNIFICATIONS)
    trials = [(z, d) for z in arrays.tolist() for d in gaps.tolist()] if distances is None else [distances]
    state = _setting_state(first, focal_length, trials, [P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR, P.PITCH])
    array, gap = state.parameters[[P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR]].tolist()
    parameters, poses = [state.parameters], [state.poses]
    for k in range(1, len(problem.free) - COUNT + 1):
        part = setting_part(problem, k)
        ratio = _pitch(image_lattice(part.centre_grid, part.centre_pixel)) / _pitch(lattice)
        # Micro images are 1 + gap / array times as far apart as microlenses.
        moved = gap / max(ratio * (1.0 + gap / array) - 1.0, 1e-300)
        moved = moved if NEAREST * focal_length < moved < FARTHEST * focal_length else array
        if part.frames:
            trials = [(moved, gap), (array, gap)]
            other = _setting_state(part, focal_length, trials, [P.LENS_TO_ARRAY])
            moved = float(other.parameters[P.LENS_TO_ARRAY])
            poses.append(other.poses)
        parameters.append(np.array([moved]))
    stacked = Poses(*(np.concatenate(arrays) for arrays in zip(*poses, strict=True)))
    return State(np.concatenate(parameters), stacked, state.offset)


def setting_part(problem: Problem, k: int) -> Problem:
    """Problem of one focus setting alone."""
    rows, centres = problem.setting == k, problem.centre_setting == k
    return problem._replace(
        grid=problem.grid[rows], pixel=problem.pixel[rows], error=problem.error[rows], point=problem.point[rows],
        setting=problem.setting[rows],
        frame=np.unique(problem.frame[rows], return_inverse=True)[1], centre_grid=problem.centre_grid[centres],
        centre_pixel=problem.centre_pixel[centres], centre_setting=problem.centre_setting[centres],
        free=problem.free[:COUNT], prior=problem.prior[:COUNT],
    )  # fmt: skip


def _setting_state(
    problem: Problem, focal_length: float, trials: list[tuple[float, float]], fitted: list[Parameter]
) -> State:
    """State of one focus setting, by trial distances from lens to array and from array to sensor."""
    lattice = image_lattice(problem.centre_grid, problem.centre_pixel)
    shape_axis = 0.5 * (problem.centre_pixel.min(axis=0) + problem.centre_pixel.max(axis=0))
    bundles = _bundles(problem, lattice, shape_axis)
    scored = [_poses(problem, bundles, focal_length, *trial) for trial in trials]
    order = np.argsort([score for score, _ in scored], kind="stable")[:_CANDIDATES]
    best, lowest_cost = None, np.inf
    for k in order.tolist():
        score, poses = scored[k]
        if not math.isfinite(score):
            continue
        parameters = _parameters(problem, lattice, shape_axis, focal_length, trials[k])
        held = problem._replace(free=np.isin(np.arange(COUNT), fitted))
        held = held._replace(sigma=(3.0, 1.0))
        state, at = minimise(held, State(parameters, poses, np.zeros_like(problem.board)), steps=12, tolerance=100.0)
        if at.cost < lowest_cost:
            best, lowest_cost = state, at.cost
    if best is None:
        raise InvalidValueError(
            "no camera with a real image of the boards explains the corners; check the focal length f, the board's "
            "points in mm, and that corners and centres are of one camera"
        )
    return best


def _pitch(lattice: ImageLattice) -> float:
    """Distance of micro images per lattice pitch, pixels."""
    return math.sqrt(abs(float(np.linalg.det(lattice.steps))))


def _parameters(
    problem: Problem, lattice: ImageLattice, axis: Floats, focal_length: float, distances: tuple[float, float]
) -> Floats:
    """Parameters of a thin lens whose micro images form a lattice."""
    array, gap = distances
    parameters = np.zeros(COUNT)
    spacing = problem.pixel_pitch / (1.0 + gap / array)
    x_step = np.array([-lattice.steps[0, 1], lattice.steps[0, 0]])
    parameters[[P.FOCAL_LENGTH, P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR]] = focal_length, array, gap
    parameters[P.PITCH], parameters[P.TURN] = spacing * _pitch(lattice), math.atan2(x_step[1], x_step[0])
    row, column = lattice.origin - axis
    parameters[[P.SHIFT_X, P.SHIFT_Y]] = -spacing * column, spacing * row
    parameters[[P.AXIS_ROW, P.AXIS_COLUMN]] = axis
    return parameters


def _poses(problem: Problem, bundles: _Bundles, focal_length: float, array: float, gap: float) -> tuple[float, Poses]:
    """Mean square distance of the boards from their images brought back through the lens, mm^2, and their poses."""
    at_infinity = gap / array
    s = bundles.slope * (1.0 + at_infinity) - bundles.scale
    frames = problem.frames
    nothing = np.inf, Poses(np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3)))
    with np.errstate(divide="ignore", invalid="ignore"):
        z = array - gap * bundles.scale / s
        depth = focal_length * z / (z - focal_length)
        points = np.column_stack([bundles.height / s[:, None] * (depth / z)[:, None], -depth])
    real = np.isfinite(points).all(axis=1) & (z > focal_length) & (depth < 1e4 * focal_length)
    frame = bundles.frame[real]
    counts = np.bincount(frame, minlength=frames)
    if real.mean() < 0.9 or counts.min() < 3:
        return nothing
    first = np.cumsum(counts) - counts
    board, image = problem.board[bundles.point[real]], points[real]
    middle = np.add.reduceat(board, first) / counts[:, None]
    centre = np.stack([_medians(each, frame, first, counts) for each in image.T], axis=1)
    board, image = board - middle[frame], image - centre[frame]
    u, _, v = np.linalg.svd(np.add.reduceat(image[:, :, None] * board[:, None], first))
    u[:, :, 2] *= np.linalg.det(u @ v)[:, None]
    turns = u @ v
    # In directions, where blur in depth does not hide the rest.
    miss = np.sum((image - np.einsum("nij,nj->ni", turns[frame], board)) ** 2, axis=1)
    shifts = centre - np.einsum("nij,nj->ni", turns, middle)
    return float(np.median(_medians(miss, frame, first, counts))), Poses(turns, shifts)


def _medians(values: Floats, frame: NDArray[np.int64], first: NDArray[np.int64], counts: NDArray[np.int64]) -> Floats:
    """Median (f,) of the values (n,) of each frame, whose rows follow one another."""
    ordered = values[np.lexsort((values, frame))]
    return np.asarray(0.5 * (ordered[first + (counts - 1) // 2] + ordered[first + counts // 2]))
