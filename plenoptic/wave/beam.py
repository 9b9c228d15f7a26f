"""Wave field of a point behind the main lens, as functions of the position in the exit pupil.

On the plane of the array the field is

    U(x) = exp(i k |x|^2 / 2 L) integral A(s) exp(i k (W(s) + s.x)) ds

with the distance L of the exit pupil, whose point p has s = -p / L: the waves of its points, to the second order of x.
A and W follow from rays. A ray that crosses the plane at X in the direction l has s = l - X / L, so that X(s) and the
direction determine each other; then grad W = -X, and |A|^2 is the light of the rays per unit area of s. The field thus
has the energy flow and the vignetting of the rays, and the edge of the exit pupil diffracts at its true position. For a
pupil at infinity s is the direction itself, and W Hamilton's angle characteristic (M. Born, E. Wolf, Principles of
Optics, 7th ed., section 4.1.4).

Directions are cosines, except before ideal microlenses. These preserve slopes and heights, dx dy du dv: their waves are
those of Fresnel, whose directions are slopes; see `Plane.shears`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plenoptic.camera.assembly import Rigid
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import model_pupil
from plenoptic.camera.psf.sensor_hits import ForwardRecord, forward_record, in_lens_axes
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.pupil.entrance_pupil import entrance_polygon

_GRID_SIZE = 96
"""Rays across the entrance pupil to which the functions are fitted."""
_DEGREES = (4, 7, 10, 13)
"""Degrees of polynomials, tried until the phase is accurate enough."""
_MIN_PUPIL_DISTANCE = 1e-3
"""mm: an exit pupil nearer to the plane is treated as infinitely far away."""
_GOOD_PHASE_ERROR = 1e-4
"""Phase error in waves, root mean square, at which the fit stops."""
_MAX_PHASE_ERROR = 0.1
"""Largest accepted phase error in waves."""
_GOOD_PUPIL_ERROR, _MAX_PUPIL_ERROR = 1e-6, 1e-2
"""Error of the position in the entrance pupil over its width at which the fit stops, and the largest accepted."""


class Plane(NamedTuple):
    """Plane of the field in the sensor's axes: the array's front principal plane, or without an array the sensor."""

    from_lens: Rigid
    """Transform from the lens's axes; z = 0 on the plane."""
    shears: bool
    """True if directions are slopes, for ideal microlenses, instead of direction cosines."""
    curvature: float
    """1 / L in 1/mm, curvature of waves from a point of the exit pupil; 0 for a pupil at infinity."""

    def directions(self, lens_axes: Floats) -> Floats:
        """Slopes or cosines (n, 2) of unit vectors (n, 3) in the lens's axes."""
        vectors = self.from_lens.directions(lens_axes)
        return np.asarray(vectors[:, :2] / vectors[:, 2:] if self.shears else vectors[:, :2])

    def cosine(self, s: Floats) -> Floats:
        """Cosine (...) of the angle to the plane's normal of directions (..., 2)."""
        s2 = (s**2).sum(axis=-1)
        return np.asarray(1.0 / np.sqrt(1.0 + s2) if self.shears else np.sqrt(np.maximum(1.0 - s2, 0.0)))

    def slopes(self, s: Floats) -> Floats:
        """Slopes (..., 2) of directions."""
        return s if self.shears else np.asarray(s / self.cosine(s)[..., None])

    def along(self, s: Floats) -> Floats:
        """Optical path (...) of a unit of length along the normal, less a constant, for directions (..., 2)."""
        return np.asarray(-0.5 * (s**2).sum(axis=-1) if self.shears else self.cosine(s))


class Polynomials(NamedTuple):
    """Polynomials in s, over the bounding box of the light."""

    middle: Floats
    half: Floats
    values: Floats
    """(p, p, m) coefficients of x^i y^j of m functions."""

    def __call__(self, s: Floats) -> Floats:
        """Values (n, m) at points (n, 2)."""
        x, y = powers((s - self.middle) / self.half, len(self.values) - 1)
        n, m = len(s), self.values.shape[2]
        along_y = (x @ self.values.reshape(len(self.values), -1)).reshape(n, -1, m)
        return np.asarray(np.einsum("nj,njm->nm", y, along_y))

    def slopes(self, s: Floats) -> Floats:
        """Derivatives (n, m, 2) with respect to s."""
        degrees = np.arange(1, len(self.values))
        by_x = self._replace(values=np.pad(degrees[:, None, None] * self.values[1:], ((0, 1), (0, 0), (0, 0))))
        by_y = self._replace(values=np.pad(degrees[:, None] * self.values[:, 1:], ((0, 0), (0, 1), (0, 0))))
        return np.stack([by_x(s) / self.half[0], by_y(s) / self.half[1]], axis=-1)


def powers(points: Floats, degree: int) -> tuple[Floats, Floats]:
    """(n, degree + 1) powers of x, and of y, of points (n, 2)."""
    x, y = points.T
    return np.vander(x, degree + 1, increasing=True), np.vander(y, degree + 1, increasing=True)


class Beam(NamedTuple):
    """Light of a point at one wavelength behind the main lens, as functions of s."""

    record: ForwardRecord
    point: Floats
    """Position of the point in the lens's axes, mm."""
    plane: Plane
    wavelength: float
    """In the medium behind the lens, mm."""
    low: Floats
    high: Floats
    """(2,) bounding box of s."""
    directions: Floats
    """(2, 2) least and greatest directions of rays."""
    spot: Floats
    """(2, 2) least and greatest x and y of the intersections of rays with the plane, mm."""
    entering: Polynomials
    """x and y of the intersections of rays with the entrance pupil."""
    focus: Floats
    """(3,) x, y and d of the linear fit X = (x, y) - d s."""
    aberration: Polynomials
    """Remainder of W beyond the linear fit, mm."""
    phase_error: float
    """Deviation of the phase from that of the rays, waves, root mean square."""

    def path(self, s: Floats) -> Floats:
        """Optical path W (n,) in mm."""
        x, y, distance = self.focus
        return np.asarray(-s @ [x, y] + 0.5 * distance * (s**2).sum(axis=1) + self.aberration(s)[:, 0])

    def direction(self, s: Floats) -> Floats:
        """Directions (n, 2) of rays on the plane."""
        hits = self.focus[:2] - self.focus[2] * s - self.aberration.slopes(s)[:, 0]
        return np.asarray(s + self.plane.curvature * hits)

    def light(self, s: Floats) -> tuple[Floats, Floats]:
        """Light (n,) per unit area of s of unvignetted rays, over the invariant of refraction, and that invariant (n,).

        Their product is projected solid angle. The invariant is 1, or cos^4 to the plane's normal if directions are
        slopes, whose areas ideal microlenses preserve.
        """
        slopes = self.entering.slopes(s)
        area = np.abs(slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0])
        light = area * entering_rays(self.record, self.point, self.entering(s))[1]
        direction = self.direction(s)
        if self.record.ideal:
            light = light * self._lens_cosine(direction) ** 4
        invariant = self.plane.cosine(direction) ** 4 if self.plane.shears else np.ones(len(s))
        return light / invariant, invariant

    def _lens_cosine(self, direction: Floats) -> Floats:
        cosine = self.plane.cosine(direction)
        across = direction * cosine[:, None] if self.plane.shears else direction
        return np.asarray(self.plane.from_lens.inverse().directions(np.column_stack([across, cosine]))[:, 2])

    def transmission(self, s: Floats) -> Floats:
        """Fraction (n,) of the light at s (n, 2) that passes the lens: 0 or 1, except with grey masks."""
        rays, _ = entering_rays(self.record, self.point, self.entering(s))
        return self.record.camera.lens.trace(rays).weight


def entering_rays(record: ForwardRecord, point: Floats, pupil_points: Floats) -> tuple[RayBundle, Floats]:
    """Rays from a point to points (n, 2) of the entrance pupil, and the light (n,) per unit area of the pupil.

    Projected solid angle, or before an ideal lens du dv, as in `kernels.source_rays`.
    """
    height = record.entrance.z - point[2]
    slopes = (pupil_points - point[:2]) / height
    cosine2 = 1.0 / (1.0 + (slopes**2).sum(axis=1))
    direction = np.column_stack([slopes, np.ones(len(slopes))]) * np.sqrt(cosine2)[:, None]
    light = (np.ones_like(cosine2) if record.ideal else cosine2**2) / height**2
    if record.facing is not None:
        light = light * np.maximum(slopes @ record.facing[:2] + record.facing[2], 0.0)
    origin = np.column_stack([pupil_points, np.full(len(pupil_points), record.entrance.z)])
    return RayBundle(origin, direction, record.camera.wavelength), light


def beam_of(camera: PlenopticCamera, point: Floats) -> Beam | None:
    """Light of a world point (3,) at the camera's wavelength; None if no light passes the lens."""
    record = forward_record(camera)
    lens_point = in_lens_axes(record, point[None])[0]
    corners = entrance_polygon(record.entrance, lens_point)
    if corners is None:
        return None
    plane = plane_of(record)
    low, high = corners.min(axis=0), corners.max(axis=0)
    for _ in range(2):  # the second time, over the bounding box of the light alone
        pupil_points = _grid(low, high)
        behind = camera.lens.trace(entering_rays(record, lens_point, pupil_points)[0])
        passes = behind.status == 0
        if not passes.any():
            return None
        step = (high - low) / _GRID_SIZE
        low, high = pupil_points[passes].min(axis=0) - step, pupil_points[passes].max(axis=0) + step
    pupil_points = pupil_points[passes]
    directions = plane.directions(behind.direction[passes])
    origins = plane.from_lens.points(behind.origin[passes])
    hits = origins[:, :2] - origins[:, 2:] * plane.slopes(directions)
    return _fit_beam(record, lens_point, plane, pupil_points, directions, hits)


def _grid(low: Floats, high: Floats) -> Floats:
    side = (np.arange(_GRID_SIZE) + 0.5) / _GRID_SIZE
    unit = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return np.asarray(low + unit * (high - low))


def plane_of(record: ForwardRecord) -> Plane:
    """Plane of a camera's field."""
    parts, array = record.parts, record.camera.microlenses
    sensor = parts.sensor_to_local
    if array is not None:
        sensor = sensor._replace(shift=sensor.shift * [1.0, 1.0, 0.0])
    shears = array is not None and not array.is_plate
    from_lens = sensor.inverse().of(parts.local_to_lens.inverse())
    pupil_distance = float(from_lens.inverse().shift[2]) - model_pupil(record.camera)[0]
    return Plane(from_lens, shears, 1.0 / pupil_distance if abs(pupil_distance) > _MIN_PUPIL_DISTANCE else 0.0)


def _fit_beam(
    record: ForwardRecord, point: Floats, plane: Plane, pupil_points: Floats, directions: Floats, hits: Floats
) -> Beam:
    """Fit functions of s to rays."""
    s = directions - plane.curvature * hits
    index = float(record.camera.lens.indices(record.camera.wavelength)[-1])
    wavelength = 1e-6 * record.camera.wavelength / index
    low, high = s.min(axis=0), s.max(axis=0)
    edge = 2.0 * (high - low) / _GRID_SIZE
    low, high = low - edge, high + edge
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    focus, error, pupil_error = _fit_focus(s, hits), math.inf, math.inf
    residual = hits - (focus[:2] - focus[2] * s)
    spot = np.array([hits.min(axis=0), hits.max(axis=0)])
    entering = aberration = None
    for degree in _DEGREES:
        i, j = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]).T
        if 3 * len(i) > len(s):
            break
        x, y = powers((s - middle) / half, degree)
        values = np.zeros((degree + 1, degree + 1, 3))
        values[i, j, :2] = np.linalg.lstsq(x[:, i] * y[:, j], pupil_points, rcond=None)[0]
        slopes = np.concatenate(
            [i * x[:, np.maximum(i - 1, 0)] * y[:, j] / half[0], j * x[:, i] * y[:, np.maximum(j - 1, 0)] / half[1]]
        )
        values[i, j, 2] = np.linalg.lstsq(slopes, -residual.T.ravel(), rcond=None)[0]
        entering = Polynomials(middle, half, values[:, :, :2])
        aberration = Polynomials(middle, half, values[:, :, 2:])
        misfit = (slopes @ values[i, j, 2] + residual.T.ravel()).reshape(2, -1).T * half / wavelength
        error = float(np.sqrt((misfit**2).sum(axis=1).mean()))
        pupil_error = float(np.abs(entering(s) - pupil_points).max() / np.ptp(pupil_points, axis=0).max())
        if error < _GOOD_PHASE_ERROR and pupil_error < _GOOD_PUPIL_ERROR:
            break
    if entering is None or aberration is None:
        raise InvalidValueError(f"hardly a ray from the point passes the lens; {len(s)} of {_GRID_SIZE**2} did")
    if error > _MAX_PHASE_ERROR or pupil_error > _MAX_PUPIL_ERROR:
        raise InvalidValueError(
            f"smooth functions do not say where light crosses the exit pupil (its phase is known to {error:.2g} waves, "
            f"its place in the entrance to {pupil_error:.2g}): the lens has too strong aberrations there, or surfaces "
            "that are not smooth; stop it down"
        )
    return Beam(
        record=record,
        point=point,
        plane=plane,
        wavelength=wavelength,
        low=low,
        high=high,
        directions=np.array([directions.min(axis=0), directions.max(axis=0)]),
        spot=spot,
        entering=entering,
        focus=focus,
        aberration=aberration,
        phase_error=error,
    )


def _fit_focus(s: Floats, hits: Floats) -> Floats:
    """Linear fit to X(s), as in `Beam`."""
    n = len(s)
    matrix = np.zeros((2 * n, 3))
    matrix[:n, 0] = matrix[n:, 1] = 1.0
    matrix[:, 2] = -s.T.ravel()
    return np.asarray(np.linalg.lstsq(matrix, hits.T.ravel(), rcond=None)[0])
