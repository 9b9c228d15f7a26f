"""Observations from which no camera can be calibrated, each refused with a sentence."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.fitting.geometry import COUNT, Parameter, Poses
from plenoptic.calibration.fitting.settings import distance_columns
from plenoptic.calibration.fitting.solve import Evaluation, Problem, State, centres_of, problem_of
from plenoptic.calibration.fitting.start_values import FARTHEST, MIN_LENSES, NEAREST, image_lattice, setting_part
from plenoptic.calibration.observations import Observations
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError

_MIN_FRAMES, _MIN_CENTRES = 3, 20
_MIN_POINTS = 4
"""Least number of points of a board in each frame."""
_LATTICE_RESIDUAL = 0.05
"""Largest root mean square deviation of centres from a lattice, in pitches."""
_REACH, _MAX_OUTSIDE = 0.75, 0.05
"""Distance of a corner from the centre of its micro image in pitches, and fraction of the corners beyond it."""
_FIELDS, _MAGNIFICATIONS = (0.002, 5.0), (0.0005, 40.0)
"""Size of the white image over the focal length, and of the boards' images over the boards, from a phone's camera to a
microscope: a factor of 1000 between units leads beyond them for most cameras."""
_MIN_TILT = math.radians(3.0)
_FOCAL_LENGTH_RATIO = 1.08
"""Largest ratio of the fitted and the nominal focal length: a board twice as large as stated fits as well, with a focal
length that is 7 to 10 % shorter."""
_MAX_RESIDUAL = 0.15
"""Largest standard deviation of corners, in pitches of the micro images."""
_MAX_RELATIVE_ERROR, _BY_CHANCE = 0.1, 2.0
"""Largest standard error of the focal length, over it, and largest distance from the nominal one by chance, in them."""
_LATTICE_RATIO, _MAX_DEVIATION = 3.0, 0.02
"""Largest root mean square of the centres' residuals, as a ratio to their deviation from a lattice of their own, and
beyond it in pitches."""
_EXCHANGED = 0.8
"""Centres' residuals with the distances of two settings exchanged, over those without, below which they are."""


def check_settings(settings: tuple[Observations, ...], basis: Floats, free: NDArray[np.bool_]) -> None:
    """Raise an InvalidValueError, which names the focus setting of several, if its observations are refused."""
    for k, observations in enumerate(settings):
        try:
            _check_observations(observations, problem_of(observations, basis, free), 0 if k else _MIN_FRAMES)
        except InvalidValueError as error:
            if len(settings) == 1:
                raise
            raise InvalidValueError(f"observations[{k}]: {error}") from None


def _check_observations(observations: Observations, problem: Problem, min_frames: int) -> None:
    """Raise an InvalidValueError if boards are too few, or corners and centres do not belong together."""
    frames, views = observations.frames, "in {} views" if observations.in_views else "through {} microlenses"
    if len(frames) < min_frames:
        raise InvalidValueError(
            f"the observations hold {len(frames)} frame{'s' * (len(frames) != 1)}; a calibration needs at least "
            f"{min_frames}, better 10, of boards tilted in different directions"
        )
    for frame in frames.tolist():
        counts = np.bincount(observations.point[observations.frame == frame], minlength=len(observations.board))
        points = np.flatnonzero(counts >= MIN_LENSES)
        flat = observations.board[points] - observations.board[points[:1]]
        if len(points) < _MIN_POINTS or np.linalg.matrix_rank(flat, tol=1e-6 * np.abs(flat).max()) < 2:
            raise InvalidValueError(
                f"frame {frame} shows {len(points)} points of the board {views.format(MIN_LENSES)} or more; it "
                f"needs at least {_MIN_POINTS} that do not lie on a line: leave the frame out"
            )
    index = observations.centre_index
    if len(index) < _MIN_CENTRES or np.linalg.matrix_rank(index - index[:1]) < 2:
        raise InvalidValueError(
            f"the observations hold {len(index)} centres of micro images; at least {_MIN_CENTRES} are needed, over the "
            "whole white image: without them focal length, distances and pitch cannot be told apart"
        )
    lattice = image_lattice(problem.centre_grid, problem.centre_pixel)
    pitch = math.sqrt(abs(float(np.linalg.det(lattice.steps))))
    if not lattice.residual < _LATTICE_RESIDUAL * pitch:
        raise InvalidValueError(
            f"the centres deviate by {lattice.residual:.2f} pixels from a lattice of the pitch {pitch:.2f} pixels; "
            f"check their indices and that the lattice is {observations.lattice.name}"
        )
    if np.linalg.det(lattice.steps) < 0:
        raise InvalidValueError(
            "the centres of the white image are mirrored: the second index must count counter-clockwise from the "
            "first as seen from the lens; mirror the image or exchange the indices"
        )
    if not len(problem.pixel):
        return
    distance = np.hypot(*(lattice.origin + problem.grid @ lattice.steps - problem.pixel).T)
    outside = float(np.mean(distance > _REACH * pitch))
    if outside > _MAX_OUTSIDE:
        raise InvalidValueError(
            f"{100 * outside:.0f} % of the corners lie outside the micro image of their microlens, as far as the white "
            "image shows it: it is of another camera or focus setting, mirrored, or has other indices"
        )


def check_units(problem: Problem, focal_length: float) -> None:
    """Raise an InvalidValueError if pixel pitch, board and nominal focal length cannot be in one unit."""
    size = problem.pixel_pitch * float(np.hypot(*np.ptp(problem.centre_pixel, axis=0)))
    if not _FIELDS[0] < size / focal_length < _FIELDS[1]:
        raise InvalidValueError(
            f"the white image is {size:.3g} mm across by a pixel pitch of {problem.pixel_pitch:g} mm, behind a lens of "
            f"{focal_length:g} mm: give the pixel pitch (0.0055 for 5.5 micrometres) and the focal length in mm"
        )
    first = problem.frame == 0
    board, image = problem.board[problem.point[first], :2].std(), problem.pixel_pitch * problem.pixel[first].std()
    if not _MAGNIFICATIONS[0] * board < image < _MAGNIFICATIONS[1] * board:
        raise InvalidValueError(
            f"the boards' images are {image / board:.2g} times as large as the boards, whose points are up to "
            f"{np.hypot(*np.ptp(problem.board, axis=0)[:2]):.2g} mm apart: give squares and pixel pitch in mm"
        )


def check_poses(poses: Poses) -> None:
    """Raise an InvalidValueError if boards show their backs, or all are parallel."""
    normals = poses.turn[:, :, 2]
    if np.median(normals[:, 2]) < 0:
        raise InvalidValueError(
            "the boards are seen from behind: the images are mirrored, or the board's points are; give points with "
            "x to the right and y up on the side that the camera sees"
        )
    largest = float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max())
    if largest < _MIN_TILT:
        raise InvalidValueError(
            f"all boards are parallel within {math.degrees(largest):.1f} degrees, from which focal length and "
            "distances cannot be told apart; tilt boards by 20 degrees or more in different directions"
        )


def check_residuals(problem: Problem) -> None:
    """Raise an InvalidValueError if the fitted camera misses the corners."""
    lattice = image_lattice(problem.centre_grid, problem.centre_pixel)
    pitch = math.sqrt(abs(float(np.linalg.det(lattice.steps))))
    if not problem.sigma[0] < _MAX_RESIDUAL * pitch:
        raise InvalidValueError(
            f"no camera explains the corners: they deviate by {problem.sigma[0]:.2f} pixels, where micro images are "
            f"{pitch:.1f} pixels apart; check the board's points in mm, and that all frames have one focus setting"
        )


def check_arrays(problem: Problem, state: State, at: Evaluation) -> None:
    """Raise an InvalidValueError if further focus settings are not those of the first one's camera."""
    f = state.parameters[Parameter.FOCAL_LENGTH]
    for k, array in enumerate(state.parameters[COUNT:].tolist(), start=1):
        part = setting_part(problem, k)
        lattice = image_lattice(part.centre_grid, part.centre_pixel)
        pitch = math.sqrt(abs(float(np.linalg.det(lattice.steps))))
        rms = problem.sigma[1] * float(np.sqrt(np.mean(at.centres[problem.centre_setting == k] ** 2)))
        if not NEAREST * f < array < FARTHEST * f or rms > _LATTICE_RATIO * lattice.residual + _MAX_DEVIATION * pitch:
            raise InvalidValueError(
                f"no distance from lens to array explains observations[{k}] with the camera of observations[0]: at "
                f"{array:.4g} mm centres of micro images deviate by {rms:.3f} pixels, and by {lattice.residual:.3f} "
                "pixels from a lattice of their own; they are of another camera, or its array or sensor was moved"
            )
    columns = distance_columns(len(state.parameters))
    for i, j in combinations(range(len(columns)), 2):
        exchanged = state.parameters.copy()
        exchanged[columns[[i, j]]] = exchanged[columns[[j, i]]]
        rows = np.isin(problem.centre_setting, (i, j))
        rms, other = (
            float(np.sqrt(np.mean((centres_of(problem, each)[0] - problem.centre_pixel)[rows] ** 2)))
            for each in (state.parameters, exchanged)
        )
        if other < _EXCHANGED * rms:
            raise InvalidValueError(
                f"the white images of observations[{i}] and observations[{j}] are exchanged: with the distances from "
                f"lens to array that the boards ask for, centres of micro images deviate by {rms:.3f} pixels, and by "
                f"{other:.3f} if they are of the other focus setting"
            )


def check_focal_length(parameters: Floats, errors: Floats, nominal: float, thin: float, lens: str) -> None:
    """Raise an InvalidValueError if the boards leave the focal length open, or if it is far from the nominal one.

    If a thin lens has a focal length near the nominal one, the prescription, if it is named, is that of another lens.
    """
    focal_length, error = (float(each[Parameter.FOCAL_LENGTH]) for each in (parameters, errors))
    is_far, is_thin_far = (
        not 1.0 / _FOCAL_LENGTH_RATIO < f / nominal < _FOCAL_LENGTH_RATIO for f in (focal_length, thin)
    )
    is_open = not error < _MAX_RELATIVE_ERROR * focal_length
    if lens and (is_far or is_open) and not is_thin_far:
        raise InvalidValueError(
            f"lens {lens!r} is not that of the observations: they ask for a focal length of {focal_length:.3g} +- "
            f"{error:.2g} mm with it, for {thin:.3g} mm with a thin lens, and the nominal one is {nominal:g} mm; give "
            "the prescription of a lens like the real one, or none"
        )
    if is_open or (is_far and abs(focal_length - nominal) < _BY_CHANCE * error):
        raise InvalidValueError(
            f"the observations leave the focal length open: {focal_length:.3g} +- {error:.2g} mm; add nearer "
            "boards, more tilt, or a prior on the focal length"
        )
    if is_far:
        raise InvalidValueError(
            f"the observations ask for a focal length of {focal_length:.3g} +- {error:.2g} mm, and the nominal one is "
            f"{nominal:g} mm; check the board's points and the pixel pitch, both in mm: a board of twice the size "
            "alters the focal length by 10 %, and one that is 1 % longer along one side by some 5 %; if they are "
            "right, give the focal length that the lens has at this focus"
        )
