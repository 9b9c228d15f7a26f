"""Calibration of a plenoptic camera from corners of boards and centres of micro images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from plenoptic.calibration.calibration_result import Calibration, HeldOut
from plenoptic.calibration.fitting.advice import error_table
from plenoptic.calibration.fitting.checks import (
    check_arrays,
    check_focal_length,
    check_poses,
    check_residuals,
    check_settings,
    check_units,
)
from plenoptic.calibration.fitting.covariance import clustered_covariance, pupil_sensitivity
from plenoptic.calibration.fitting.geometry import COUNT, Parameter, lenslets, sensor_rays
from plenoptic.calibration.fitting.halves import HalfFit, fit_halves
from plenoptic.calibration.fitting.settings import distance_columns, parameter_columns
from plenoptic.calibration.fitting.solve import Evaluation, Problem, State, fit, pivot_of, points_of, problem_of
from plenoptic.calibration.fitting.start_values import start_state
from plenoptic.calibration.fitting.traced_lens import trace_lens, trace_rays, trace_sources
from plenoptic.calibration.joint_observations import join_settings
from plenoptic.calibration.microlens_types import focal_lengths
from plenoptic.calibration.nominal import NominalCamera
from plenoptic.calibration.observations import Observations
from plenoptic.calibration.twin import FixedParts, measured_f_number, object_origin, twin_camera
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats, check_kind, choice, finite, number
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.lattice import lattice_basis

P = Parameter
_BOARD_SIGMA = 0.3
"""Standard deviation in mm of a coordinate of a board's points from their design: printed boards on plates bend so."""
_PUPIL_SIGMA = 0.14
"""Standard deviation of the exit pupil's distance from the rear principal plane, over the focal length: root mean
square of the 15 lenses in the library with less than 0.5, which leaves out telephoto and retrofocus lenses."""
_FIXED = (P.STRETCH, P.EXIT_PUPIL, P.DISTORTION)
_MIN_HELD_OUT = 6
"""Least number of frames for cross-validation by halves."""
_SIGNIFICANT = 2.0
_MAX_MISSED = 0.02
"""Largest fraction of corners, which may be outliers, whose rays a prescription does not pass."""


class _ModelFit(NamedTuple):
    problem: Problem
    state: State
    at: Evaluation
    halves: tuple[HalfFit, HalfFit] | None


def calibrate(
    observations: Observations | Sequence[Observations],
    *,
    start: NominalCamera | PlenopticCamera,
    lens: LensStack | None = None,
    board: float = _BOARD_SIGMA,
    priors: Mapping[Parameter, tuple[float, float]] | None = None,
) -> Calibration:
    """Calibrate a camera from corners of boards and centres of micro images, fitted together.

    Parameters
    ----------
    observations : Observations, or list or tuple of them
        At least 3 frames, better 10 and more, with boards tilted in different directions. A list is of one camera at
        several focus settings, each with its own white image; the first has 3 frames or more, others may have none.
    start : NominalCamera or PlenopticCamera
        Focal length and f-number as printed on the lens, or the camera as designed: then the search begins with its
        distances, too.
    lens : LensStack, optional
        Prescription of the main lens, or of one like it, whose rays are traced exactly. It is scaled to the fitted
        focal length, with its iris (`LensStack.with_stop` gives it that of the photographs). None: a thin lens.
    board : float, optional
        Standard deviation in mm of a coordinate of the board's points from their design. They are fitted if
        frames that are left out ask for it. 0: the board is as designed.
    priors : mapping of Parameter to (float, float), optional
        Mean and standard deviation of parameters. That of EXIT_PUPIL is (0, 0.14 f) unless it is given; a `lens` has
        its own, from which that of the real lens deviates by this standard deviation.

    Returns
    -------
    Calibration
        Of the first focus setting, with those of the others in `settings`.

    Raises
    ------
    InvalidValueError
        If no camera follows from the observations: too few boards, all parallel, a wrong square of the board,
        mirrored images, the white image of another camera, another camera or board at a further focus setting. The
        message says which.

    Notes
    -----
    The main lens is thin, or a prescription. The array may be shifted, turned and tilted, and the principal point lies
    anywhere. The chief ray of a corner runs from its image by the lens through the microlens; the centre of a micro
    image is the image of the exit pupil's centre. Levenberg-Marquardt steps of camera, poses and board minimise the
    pseudo-Huber loss of corners and centres, whose standard deviations are estimated from the residuals. Terms beyond
    that (points of the board, an array stretched along one side, radial distortion) are accepted if frames that were
    left out are then predicted better by two standard errors. The twin cannot distort: with distortion asked for,
    `held_out` says so, and the twin is the best camera without it. Blur of corners gives the focal lengths of the
    microlenses, also of three types in a hexagonal array (two in a square one): without signs, by its change with the
    distance of the board. Without blur they are taken to focus the corners in the middle.

    Corners in views of an unfocused camera (1.0) are compared in the plane of their image by the main lens. Its
    microlenses are taken to have their focal planes on the sensor.

    Focus settings differ in LENS_TO_ARRAY alone, as of a lens that moves as a whole; a prior on it is one on the first.
    Microlenses have the indices of the first setting, to which those of others are brought by the whole steps of the
    lattice with which their micro images lie nearest. A white image at another f-number is a setting without corners.

    Errors follow from residuals summed over the images of a board point in a frame, or over frames, where these sums
    are larger than with 199 sets of random signs (`ErrorCluster`). Corners and centres hardly tell the exit pupil from
    the principal plane; its prior widens the intervals.

    Examples
    --------
    A simulated camera takes the place of a real one.

    >>> import numpy as np, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
    >>> camera = pl.PlenopticCamera(lens=lens.with_model(pl.LensModel.THIN), microlenses=pl.MicrolensArray(0.4, (2.0,)),
    ...     sensor=pl.Sensor(shape=(350, 400), pixel_pitch=0.02), stop_to_microlenses=156.0, microlenses_to_sensor=3.0)
    >>> design = pl.targets.checkerboard(6, 5, square=3.0)
    >>> axes = (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)
    >>> boards = [design.rotated_deg(axis, 25).translated(z=-380) for axis in axes]
    >>> corners, centres = pl.package.calibration_points(camera, boards), pl.microlens_centres(camera)
    >>> observations = pl.calibration.Observations(corners.index, corners.pixel, corners.frame, corners.point,
    ...     design.points, centres.index, centres.pixel, camera.sensor)
    >>> calibration = pl.calibrate(observations, start=pl.calibration.NominalCamera(100.0, 8.0), board=0.0)
    >>> f"{calibration[pl.calibration.Parameter.FOCAL_LENGTH]:.3f} mm, {calibration.camera.microlenses.pitch:.6f} mm"
    '100.716 mm, 0.400000 mm'
    >>> [twin.lens.model.name for twin in calibration.sample(2, seed=1)]  # with exit pupils of other lenses
    ['PARAXIAL', 'PARAXIAL']

    The same camera, its array 2 mm nearer to the lens, with a white image alone:

    >>> import dataclasses
    >>> moved = pl.microlens_centres(dataclasses.replace(camera, stop_to_microlenses=154.0))
    >>> corners = {"index": np.empty((0, 2)), "pixel": np.empty((0, 2)), "frame": [], "point": []}
    >>> white = dataclasses.replace(observations, centre_index=moved.index, centre_pixel=moved.pixel, **corners)
    >>> both = pl.calibrate([observations, white], start=pl.calibration.NominalCamera(100.0, 8.0), board=0.0)
    >>> first, second = both.cameras
    >>> f"{first.stop_to_microlenses - second.stop_to_microlenses:.3f} mm"
    '2.000 mm'
    """
    settings = tuple(observations) if isinstance(observations, (list, tuple)) else (observations,)
    for each in settings:
        check_kind(each, "observations", Observations, "pl.calibration.read_compote(...)")
    if not settings:
        raise InvalidValueError("observations is empty; give those of one focus setting or more")
    nominal, distances = _nominal(start)
    if lens is not None:
        check_kind(lens, "lens", LensStack, 'pl.load_lens("double-gauss-100mm-f2")')
        lens = lens.with_model(LensModel.EXACT)
    sigma = number(board, "board")
    if not 0 <= sigma < np.inf:
        raise InvalidValueError(f"board is {board!r}; it must be a standard deviation in mm, or 0")
    prior = _priors(priors, nominal.focal_length)
    basis = lattice_basis(settings[0].lattice, (1.0, 1.0))
    free = ~np.isin(np.arange(COUNT), _FIXED)
    check_settings(settings, basis, free)
    joint, setting, centre_setting = join_settings(settings)
    free = np.append(free, np.ones(len(settings) - 1, dtype=bool))
    problem = problem_of(joint, basis, free)._replace(setting=setting, centre_setting=centre_setting)
    check_units(problem, nominal.focal_length)
    state = start_state(problem, nominal.focal_length, distances)
    state.parameters[P.EXIT_PUPIL] = prior[P.EXIT_PUPIL, 0]
    problem = problem._replace(prior=np.pad(prior, ((0, len(free) - COUNT), (0, 0))))
    problem, state, at = fit(problem, state)
    check_arrays(problem, state, at)
    check_poses(state.poses)
    check_residuals(problem)
    if lens is not None:
        problem = _with_lens(problem, state, lens)
    best = _fit_with_halves(problem, state)
    tests: list[HeldOut] = []
    if sigma > 0:
        best, tests = _extend("free board", best, best.problem._replace(board_sigma=sigma), tests)
    best, tests = _extend("stretch of the array", best, _with(best.problem, P.STRETCH), tests)
    if lens is None:
        _, tests = _extend("radial distortion", best, _with(best.problem, P.DISTORTION), tests)
    layout = _layout(joint, nominal.f_number, lens, best)
    focal_lengths = nominal.focal_length, float(state.parameters[P.FOCAL_LENGTH])
    return _result(settings, layout, best, tuple(tests), float(prior[P.EXIT_PUPIL, 1]), focal_lengths)


def _nominal(start: NominalCamera | PlenopticCamera) -> tuple[NominalCamera, tuple[float, float] | None]:
    """Nominal data, and for a design its distances from lens to array and from there to the sensor."""
    if not isinstance(start, PlenopticCamera):
        check_kind(start, "start", NominalCamera, "pl.calibration.NominalCamera(focal_length=50.0, f_number=4.0)")
        return start, None
    if start.microlenses is None:
        raise InvalidValueError("start has no microlenses; a calibration needs a camera with an array of them")
    points = cardinal_points(start.lens, start.wavelength)
    distances = start.stop_to_microlenses - points.rear_principal, start.microlenses_to_sensor
    return NominalCamera(points.efl, points.f_number), distances


def _with_lens(problem: Problem, state: State, lens: LensStack) -> Problem:
    """The problem with a traced lens, whose field is that of the micro images."""
    parameters = state.parameters
    centre, arrays = lenslets(parameters, problem.centre_grid).centre, parameters[distance_columns(len(parameters))]
    slope = float((np.hypot(centre[:, 0], centre[:, 1]) / centre[:, 2]).max() * arrays[0] / arrays.min())
    main_lens = trace_lens(lens, float(parameters[P.LENS_TO_ARRAY] / parameters[P.FOCAL_LENGTH]), slope)
    points, _ = points_of(problem, state)
    array, f = lenslets(parameters, problem.grid), parameters[P.FOCAL_LENGTH]
    if problem.in_views:
        ray, _ = sensor_rays(parameters, array, problem.pixel, problem.pixel_pitch)
        passes = trace_rays(main_lens, f, array.centre, ray, points).passes
    else:
        passes = trace_sources(main_lens, f, array.centre, points).passes
    missed = float(np.mean(~passes))
    if missed > _MAX_MISSED:
        raise InvalidValueError(
            f"lens {lens.name!r} passes no ray to {100 * missed:.0f} % of the corners; give one of a larger field"
        )
    return problem._replace(main_lens=main_lens)


def _priors(priors: Mapping[Parameter, tuple[float, float]] | None, focal_length: float) -> Floats:
    """Mean and precision (COUNT, 2) of the parameters."""
    table = np.zeros((COUNT, 2))
    table[P.EXIT_PUPIL] = 0.0, (_PUPIL_SIGMA * focal_length) ** -2
    for parameter, pair in (priors or {}).items():
        k = choice(parameter, Parameter, "a key of priors")
        try:
            mean, sigma = (finite(each, f"the prior of {k.name}") for each in pair)
        except TypeError:
            mean, sigma = 0.0, 0.0
        if not sigma > 0:
            raise InvalidValueError(f"the prior of {k.name} is {pair!r}; give (mean, standard deviation above 0)")
        table[k] = mean, sigma**-2
    return table


def _with(problem: Problem, parameter: Parameter) -> Problem:
    return problem._replace(free=problem.free | (np.arange(len(problem.free)) == parameter))


def _fit_with_halves(problem: Problem, state: State) -> _ModelFit:
    fitted = fit(problem, state)
    enough = problem.frames >= _MIN_HELD_OUT
    return _ModelFit(*fitted, fit_halves(*fitted[:2]) if enough else None)


def _extend(name: str, best: _ModelFit, larger: Problem, tests: list[HeldOut]) -> tuple[_ModelFit, list[HeldOut]]:
    """The fit of a larger problem if frames that are left out ask for it, and the tests with this one.

    Without enough frames to leave out, points of the board are fitted, whose prior holds them, and nothing else.
    """
    if best.halves is None:
        return (_fit_with_halves(larger, best.state) if larger.board_sigma > best.problem.board_sigma else best), tests
    trial = _fit_with_halves(larger, best.state)
    assert trial.halves is not None
    # Logarithms, so that no frame outweighs the others.
    gain = np.concatenate([np.log(a.held_out / b.held_out) for a, b in zip(best.halves, trial.halves, strict=True)])
    significance = float(gain.mean() / (gain.std(ddof=1) / np.sqrt(len(gain))))
    accepted = significance > _SIGNIFICANT
    test = HeldOut(name, _rms(best.halves), _rms(trial.halves), significance, accepted)
    return trial if accepted else best, [*tests, test]


def _rms(halves: tuple[HalfFit, HalfFit]) -> tuple[float, float]:
    """Root mean square of a coordinate of the corners left out of either half, in pixels."""
    first, second = (float(np.sqrt(np.average(each.held_out, weights=each.corners))) for each in halves)
    return first, second


def _result(
    settings: tuple[Observations, ...], layout: FixedParts, best: _ModelFit, tests: tuple[HeldOut, ...],
    pupil_precision: float, focal_lengths: tuple[float, float],
) -> Calibration:  # fmt: skip
    problem, state, at = best.problem, best.state, best.at
    if problem.main_lens is not None:
        f = state.parameters[P.FOCAL_LENGTH]
        state.parameters[P.EXIT_PUPIL] = f * problem.main_lens.pupil(0.0)
    spread, n_free, count = clustered_covariance(problem, at), problem.n_free, len(problem.free)
    covariance = np.zeros((count, count))
    covariance[np.ix_(problem.free, problem.free)] = spread.covariance[:n_free, :n_free]
    change = np.zeros(count)
    if not problem.free[P.EXIT_PUPIL]:
        change[problem.free] = pupil_sensitivity(problem, state, at)[:n_free]
        change[P.EXIT_PUPIL] = 1.0
        change /= np.sqrt(pupil_precision)
    lens = "" if layout.lens is None else layout.lens.name
    check_focal_length(state.parameters, np.sqrt(np.diag(covariance)), *focal_lengths, lens)
    errors = np.zeros(problem.board.shape)
    if problem.board_sigma > 0:
        errors = np.sqrt(np.diag(spread.covariance))[-errors.size :].reshape(errors.shape)
    table, board = error_table(problem, state, covariance), settings[0].board
    shift = state.poses.shift - state.poses.turn @ board.mean(axis=0)
    setting_of_frame = np.repeat(np.arange(len(settings)), [len(each.frames) for each in settings])
    further: tuple[Calibration, ...] = ()
    for k in reversed(range(len(settings))):
        columns, frames = parameter_columns(k, count), setting_of_frame == k
        camera = twin_camera(state.parameters[columns], layout)
        calibration = Calibration(
            camera=camera,
            values=state.parameters[columns],
            covariance=covariance[np.ix_(columns, columns)],
            model_change=change[columns],
            error_cluster=spread.cluster,
            board=board + state.offset,
            board_error=errors,
            turn=state.poses.turn[frames],
            shift=np.add(shift[frames], (0.0, 0.0, object_origin(camera))),
            corner_residual=(at.corners * problem.error)[problem.setting == k] * problem.sigma[0],
            centre_residual=at.centres[problem.centre_setting == k] * problem.sigma[1],
            held_out=tests,
            layout=layout,
            error_table=tuple((name, tuple(np.array(row)[columns].tolist())) for name, row in table),
            joint_covariance=covariance,
            setting=k,
            further=further if k == 0 else (),
        )
        further = (calibration, *further)
    return calibration


def _layout(observations: Observations, f_number: float, lens: LensStack | None, best: _ModelFit) -> FixedParts:
    """Parts of the camera that are not fitted together."""
    problem, state = best.problem, best.state
    f, gap = state.parameters[[P.FOCAL_LENGTH, P.ARRAY_TO_SENSOR]]
    focus: tuple[float, ...] = (float(gap),)
    if not problem.in_views:
        array = state.parameters[distance_columns(len(state.parameters))][problem.setting]
        depth = -points_of(problem, state)[0][:, 2]
        vergence = 1.0 / (array - f * depth / (depth - f))
        focus = focal_lengths(observations, vergence, float(gap), float(state.parameters[P.PITCH]))
    index = observations.centre_index
    first, last, pivot = (tuple(each.tolist()) for each in (index.min(axis=0), index.max(axis=0), pivot_of(index)))
    if lens is None and observations.radius is not None:
        pitch = observations.sensor.pixel_pitch
        f_number = measured_f_number(state.parameters, observations.radius, pitch, f_number)
    return FixedParts(observations.sensor, observations.lattice, f_number, focus, pivot, first, last, lens)
