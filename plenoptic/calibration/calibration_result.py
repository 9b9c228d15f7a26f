"""Result of a calibration: the camera, and what is known of it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from plenoptic.calibration.fitting.covariance import ErrorCluster
from plenoptic.calibration.fitting.geometry import COUNT, Parameter
from plenoptic.calibration.fitting.settings import parameter_columns
from plenoptic.calibration.twin import FixedParts, twin_camera
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, choice, number, result, seed_number, whole
from plenoptic.errors import InvalidValueError

P = Parameter
_VALLEY = 0.95
"""Correlation of parameters above which they are named together."""


@result
class HeldOut:
    """Comparison of two models by frames that were not used to fit them.

    Parameters
    ----------
    name : str
        Term that the larger model has.
    without, with_term : (float, float)
        Root mean square of a coordinate of the corners in pixels, of the odd frames with the camera and board of the
        even ones, and of the even frames with those of the odd ones.
    significance : float
        Mean decrease of the logarithm of the mean square over the frames, in its standard errors.
    accepted : bool
        True if the term is part of the calibration.

    Examples
    --------
    See `Calibration`, which holds them.
    """

    name: str
    without: tuple[float, float]
    with_term: tuple[float, float]
    significance: float
    accepted: bool

    def __repr__(self) -> str:
        pairs = ", ".join(f"{a:.3f} -> {b:.3f}" for a, b in zip(self.without, self.with_term, strict=True))
        verdict = "accepted" if self.accepted else "not needed"
        return (
            f"{self.name} {verdict}: corners of frames not fitted {pairs} px ({self.significance:.1f} standard errors)"
        )


@result
class Calibration:
    """A calibrated camera, its errors, and the board. See `calibrate`, which makes it.

    Parameters
    ----------
    camera : PlenopticCamera
        The twin: it renders, and `camera.project` gives what the fit gives. Its microlens (i, j) is that of the
        observations, of several focus settings those of the first.
    values : (14,) array
        Values of `Parameter`, in mm, rad and pixels.
    covariance : (14, 14) array
        Their covariance by the residuals; 0 for parameters that are not fitted.
    model_change : (14,) array
        Change of the values for a change of the exit pupil's position by its standard deviation, of which the
        observations do not tell.
    error_cluster : ErrorCluster
        Part of the observations within which residuals are correlated; the larger it is, the larger are the errors.
    board : (p, 3) array
        Points of the board in its own axes, as fitted, in mm.
    board_error : (p, 3) array
        Standard errors, with the camera free; 0 for a board as designed.
    turn, shift : (f, 3, 3) and (f, 3) array
        Rotation and shift in mm of the board of each frame to the camera's frame; see `points`.
    corner_residual, centre_residual : (n, 2) and (m, 2) array
        Projection minus observation, rows and columns, in pixels.
    held_out : tuple of HeldOut
        Which terms the observations ask for, by cross-validation over the frames.
    """

    camera: PlenopticCamera
    values: Floats
    covariance: Floats
    model_change: Floats
    error_cluster: ErrorCluster
    board: Floats
    board_error: Floats
    turn: Floats
    shift: Floats
    corner_residual: Floats
    centre_residual: Floats
    held_out: tuple[HeldOut, ...]
    layout: FixedParts = dataclasses.field(repr=False)
    error_table: tuple[tuple[str, tuple[float, ...]], ...] = dataclasses.field(repr=False)
    """Standard errors (14,) of all parameters by these observations, and if others were added or more were known."""
    joint_covariance: Floats = dataclasses.field(repr=False)
    """Covariance with LENS_TO_ARRAY of further focus settings behind the parameters of the first."""
    setting: int = dataclasses.field(default=0, repr=False)
    """Number of the focus setting."""
    further: tuple[Calibration, ...] = dataclasses.field(default=(), repr=False)
    """Those of the focus settings after the first."""

    def __getitem__(self, parameter: Parameter) -> float:
        """Value of a parameter."""
        return float(self.values[choice(parameter, Parameter, "parameter")])

    @property
    def settings(self) -> tuple[Calibration, ...]:
        """Calibrations at all focus settings, each with its own residuals and frames; the first is this one."""
        return (self, *self.further)

    @property
    def cameras(self) -> tuple[PlenopticCamera, ...]:
        """The twin at all focus settings."""
        return tuple(each.camera for each in self.settings)

    @property
    def fitted(self) -> tuple[Parameter, ...]:
        """Parameters that were fitted."""
        return tuple(p for p in P if self.standard_error(p) > 0)

    def standard_error(self, parameter: Parameter) -> float:
        """Standard error of a parameter by the residuals; 0 if it is not fitted."""
        k = choice(parameter, Parameter, "parameter")
        return math.sqrt(float(self.covariance[k, k]))

    def interval(self, parameter: Parameter, level: float = 0.95) -> tuple[float, float]:
        """Interval that holds a parameter with a probability, for thin and for thick lenses.

        It spans the intervals with the exit pupil in the rear principal plane and at its prior distances from there.
        """
        from statistics import NormalDist

        probability = number(level, "level")
        if not 0 < probability < 1:
            raise InvalidValueError(f"level is {level!r}; it must be between 0 and 1, such as 0.95")
        k = choice(parameter, Parameter, "parameter")
        quantile = NormalDist().inv_cdf(0.5 + 0.5 * probability)
        half = quantile * math.hypot(self.standard_error(k), float(self.model_change[k]))
        return self[k] - half, self[k] + half

    def points(self, frame: int) -> Floats:
        """Points (p, 3) of the fitted board in the camera's frame, in mm: in the f-th frame in ascending order."""
        if not len(self.turn):
            raise InvalidValueError(f"focus setting {self.setting} has a white image alone, and no board")
        k = whole(frame, "frame", at_least=0, at_most=len(self.turn) - 1)
        return np.asarray(self.board @ self.turn[k].T + self.shift[k])

    @property
    def corner_rms(self) -> float:
        """Root mean square of a coordinate of the corners' residuals in pixels; 0 without corners."""
        return float(np.sqrt(np.sum(self.corner_residual**2) / max(self.corner_residual.size, 1)))

    @property
    def centre_rms(self) -> float:
        """Root mean square of a coordinate of the centres' residuals in pixels."""
        return float(np.sqrt(np.mean(self.centre_residual**2)))

    @property
    def valleys(self) -> tuple[str, ...]:
        """Groups of parameters whose sum or difference alone is determined well, in words."""
        correlation, _ = _correlation(self.covariance)
        joined = np.linalg.matrix_power((np.abs(correlation) > _VALLEY).astype(np.int64), COUNT) > 0
        sentences = []
        for first in range(COUNT):
            group = np.flatnonzero(joined[first])
            if len(group) > 1 and group[0] == first:
                strongest = min(np.abs(correlation[first, group[1:]]).max(), 1.0)
                names = " and ".join(P(k).name for k in group.tolist())
                sentences.append(f"{names} move together: correlation {strongest:.4f}")
        return tuple(sentences)

    @property
    def advice(self) -> str:
        """Table of the errors that these observations have, and would have with others added or more known.

        Beside focal length and distances it names the parameter that would gain most, with its remaining error.
        """
        columns = (P.FOCAL_LENGTH, P.LENS_TO_ARRAY, P.ARRAY_TO_SENSOR)
        lines = [f"{'':<34}{'f, mm':>10}{'lens-array':>12}{'array-sensor':>14}  gains most"]
        now = np.array(self.error_table[0][1])
        for name, row in self.error_table:
            errors = np.array(row)
            ratio = np.divide(errors, now, out=np.ones(COUNT), where=(now > 0) & (errors > 0))
            best = P(int(ratio.argmin()))
            f, far, near = errors[list(columns)].tolist()
            gain = f"{best.name} to {100 * ratio[best]:.0f} %" if ratio[best] < 0.995 else ""
            lines.append(f"{name:<34}{f:>10.2g}{far:>12.2g}{near:>14.2g}  {gain}".rstrip())
        return "\n".join(lines)

    def sample(self, n: int, seed: int = 0) -> tuple[PlenopticCamera, ...]:
        """Cameras drawn from the errors of the calibration, also those of the exit pupil of a thin lens.

        Those of several focus settings draw the same cameras with the same seed.

        Parameters
        ----------
        n : int
            Number of cameras.
        seed : int, optional

        Examples
        --------
        See `calibrate`.
        """
        rng, count = np.random.default_rng(seed_number(seed)), whole(n, "n", at_least=1)
        ratio, scale = _correlation(self.joint_covariance)
        eigenvalues, axes = np.linalg.eigh(ratio)
        normal = rng.standard_normal((count, len(scale) + 1))
        draws = normal[:, :-1] * np.sqrt(np.maximum(eigenvalues, 0.0)) @ axes.T * scale
        draws = draws[:, parameter_columns(self.setting, len(scale))]
        if self.layout.lens is None:
            draws += normal[:, -1:] * self.model_change
        return tuple(twin_camera(self.values + draw, self.layout) for draw in draws)

    @property
    def _residuals(self) -> str:
        return f"corners {self.corner_rms:.3f} px, centres {self.centre_rms:.3f} px, {len(self.turn)} frames"

    _repr_html_ = picture_of

    def __repr__(self) -> str:
        lines = [self._residuals]
        for p in self.fitted:
            low, high = self.interval(p)
            name = f"{p.name.lower()}{', ' if p.unit else ''}{p.unit}"
            lines.append(f"{name:<22}{self[p]:>12.6g} +- {self.standard_error(p):<9.2g}95 %: {low:.6g} to {high:.6g}")
        for each in self.further:
            p = Parameter.LENS_TO_ARRAY
            name = f"{p.name.lower()}[{each.setting}], mm"
            lines.append(f"{name:<22}{each[p]:>12.6g} +- {each.standard_error(p):<9.2g}{each._residuals}")
        lines += [repr(each) for each in self.held_out]
        lines += self.valleys
        return "\n".join(lines)


def _correlation(matrix: Floats) -> tuple[Floats, Floats]:
    """Symmetric matrix with a diagonal of 1, where it is not 0, and the square roots of the diagonal."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    return matrix * inverse[:, None] * inverse, scale
