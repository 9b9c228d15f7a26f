"""The light of a point behind the main lens, as functions of where it comes from in the exit pupil.

On the plane of the array the field is

    U(x) = exp(i k |x|^2 / 2 L) integral A(s) exp(i k (W(s) + s.x)) ds

with the distance L of the exit pupil, whose point p has s = -p / L: the waves of its points, to the second order of x.
Rays say the rest. One that crosses the plane at X in the direction l has s = l - X / L, so that X(s) and the direction
follow from each other; then grad W = -X, and |A|^2 is the light of the rays in a unit of area of s. So light goes
exactly where rays go, is cut where they are, and the edge of the exit pupil sends its waves from where it is. For a
pupil infinitely far away s is the direction itself, and W Hamilton's angle characteristic (M. Born, E. Wolf, Principles
of Optics, 7th ed., section 4.1.4).

Directions are cosines, except before ideal microlenses. These keep slopes and heights, dx dy du dv: their waves are
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
from plenoptic.optics.lens.pupil.entrance_pupil import entering_polygon

_ACROSS = 96
"""Rays across the entrance from which the functions are found."""
_DEGREES = (4, 7, 10, 13)
"""Of polynomials, tried until the phase is known well enough."""
_NEAREST = 1e-3
"""mm: an exit pupil nearer to the plane is as good as infinitely far away."""
_WELL = 1e-4
"""Waves, root mean square."""
_WORST = 0.1
"""Waves by which the phase may be unknown."""
_ASTRAY, _FARTHEST_ASTRAY = 1e-6, 1e-2
"""How far from where rays enter the lens the functions say it, over the width of the light there: well, and at most."""


class Plane(NamedTuple):
    """The plane of the field in the sensor's axes: the array's front principal plane, or without one, the sensor."""

    from_lens: Rigid
    """From the lens's axes; z = 0 on the plane."""
    shears: bool
    """Whether directions are slopes, which ideal microlenses shear, instead of direction cosines."""
    curvature: float
    """1 / L, 1/mm: of waves from a point of the exit pupil; 0 for one infinitely far away."""

    def directions(self, lens_axes: Floats) -> Floats:
        """Of unit vectors (n, 3) in the lens's axes: slopes or cosines (n, 2)."""
        turned = self.from_lens.directions(lens_axes)
        return np.asarray(turned[:, :2] / turned[:, 2:] if self.shears else turned[:, :2])

    def cosine(self, s: Floats) -> Floats:
        """(...): of the angle to the plane's normal, for directions (..., 2)."""
        s2 = (s**2).sum(axis=-1)
        return np.asarray(1.0 / np.sqrt(1.0 + s2) if self.shears else np.sqrt(np.maximum(1.0 - s2, 0.0)))

    def slopes(self, s: Floats) -> Floats:
        """(..., 2) of directions."""
        return s if self.shears else np.asarray(s / self.cosine(s)[..., None])

    def along(self, s: Floats) -> Floats:
        """(...): optical path of a unit of length along the normal, but for a constant, of directions (..., 2)."""
        return np.asarray(-0.5 * (s**2).sum(axis=-1) if self.shears else self.cosine(s))


class Polynomials(NamedTuple):
    """Functions of s, over the box where light is."""

    middle: Floats
    half: Floats
    values: Floats
    """(p, p, m): coefficients of x^i y^j of m functions."""

    def __call__(self, s: Floats) -> Floats:
        """(n, m) at (n, 2)."""
        x, y = powers((s - self.middle) / self.half, len(self.values) - 1)
        n, m = len(s), self.values.shape[2]
        along_y = (x @ self.values.reshape(len(self.values), -1)).reshape(n, -1, m)
        return np.asarray(np.einsum("nj,njm->nm", y, along_y))

    def slopes(self, s: Floats) -> Floats:
        """(n, m, 2): derivatives with respect to s."""
        degrees = np.arange(1, len(self.values))
        by_x = self._replace(values=np.pad(degrees[:, None, None] * self.values[1:], ((0, 1), (0, 0), (0, 0))))
        by_y = self._replace(values=np.pad(degrees[:, None] * self.values[:, 1:], ((0, 0), (0, 1), (0, 0))))
        return np.stack([by_x(s) / self.half[0], by_y(s) / self.half[1]], axis=-1)


def powers(points: Floats, degree: int) -> tuple[Floats, Floats]:
    """(n, degree + 1) twice: powers of the coordinates of points (n, 2)."""
    x, y = points.T
    return np.vander(x, degree + 1, increasing=True), np.vander(y, degree + 1, increasing=True)


class Beam(NamedTuple):
    """Light of a point of one wavelength behind the main lens, as functions of s."""

    record: ForwardRecord
    point: Floats
    """In the lens's axes, mm."""
    plane: Plane
    wavelength: float
    """In the medium behind the lens, mm."""
    low: Floats
    high: Floats
    """(2,): the box of s."""
    directions: Floats
    """(2, 2): least and greatest directions of rays."""
    spot: Floats
    """(2, 2): least and greatest x and y where rays cross the plane, mm."""
    entering: Polynomials
    """Where rays enter, x and y."""
    focus: Floats
    """(3,): x, y and d in X = (x, y) - d s, in the mean."""
    rest: Polynomials
    """What the focus leaves of W, mm."""
    phase_error: float
    """By how much the phase is not that of the rays, waves, root mean square."""

    def path(self, s: Floats) -> Floats:
        """(n,), mm: W."""
        x, y, distance = self.focus
        return np.asarray(-s @ [x, y] + 0.5 * distance * (s**2).sum(axis=1) + self.rest(s)[:, 0])

    def direction(self, s: Floats) -> Floats:
        """(n, 2) of rays on the plane."""
        crossed = self.focus[:2] - self.focus[2] * s - self.rest.slopes(s)[:, 0]
        return np.asarray(s + self.plane.curvature * crossed)

    def light(self, s: Floats) -> tuple[Floats, Floats]:
        """(n,) twice: light of rays in a unit of area of s, if all pass the lens, and what keeps it.

        The first is projected solid angle over the second: 1, or cos^4 to the plane's normal where directions are
        slopes, whose areas ideal microlenses keep.
        """
        slopes = self.entering.slopes(s)
        area = np.abs(slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0])
        light = area * entering_rays(self.record, self.point, self.entering(s))[1]
        direction = self.direction(s)
        if self.record.ideal:
            light = light * self._lens_cosine(direction) ** 4
        kept = self.plane.cosine(direction) ** 4 if self.plane.shears else np.ones(len(s))
        return light / kept, kept

    def _lens_cosine(self, direction: Floats) -> Floats:
        cosine = self.plane.cosine(direction)
        across = direction * cosine[:, None] if self.plane.shears else direction
        return np.asarray(self.plane.from_lens.inverse().directions(np.column_stack([across, cosine]))[:, 2])

    def passing(self, s: Floats) -> Floats:
        """(n,): the part of the light at (n, 2) that passes the lens: 0 or 1, but for grey masks."""
        rays, _ = entering_rays(self.record, self.point, self.entering(s))
        return self.record.camera.lens.trace(rays).weight


def entering_rays(record: ForwardRecord, point: Floats, places: Floats) -> tuple[RayBundle, Floats]:
    """Rays from a point to places (n, 2) of the entrance, and what light a unit of area of it stands for, (n,).

    Projected solid angle, or before an ideal lens du dv, as in `kernels.source_rays`.
    """
    height = record.entrance.z - point[2]
    slopes = (places - point[:2]) / height
    cosine2 = 1.0 / (1.0 + (slopes**2).sum(axis=1))
    direction = np.column_stack([slopes, np.ones(len(slopes))]) * np.sqrt(cosine2)[:, None]
    light = (np.ones_like(cosine2) if record.ideal else cosine2**2) / height**2
    if record.facing is not None:
        light = light * np.maximum(slopes @ record.facing[:2] + record.facing[2], 0.0)
    origin = np.column_stack([places, np.full(len(places), record.entrance.z)])
    return RayBundle(origin, direction, record.camera.wavelength), light


def beam_of(camera: PlenopticCamera, point: Floats) -> Beam | None:
    """The light of a world point (3,) at the camera's wavelength; None where none passes the lens."""
    record = forward_record(camera)
    seen = in_lens_axes(record, point[None])[0]
    corners = entering_polygon(record.entrance, seen)
    if corners is None:
        return None
    plane = plane_of(record)
    low, high = corners.min(axis=0), corners.max(axis=0)
    for _ in range(2):  # the second time, over the light alone
        places = _grid(low, high)
        behind = camera.lens.trace(entering_rays(record, seen, places)[0])
        passes = behind.status == 0
        if not passes.any():
            return None
        step = (high - low) / _ACROSS
        low, high = places[passes].min(axis=0) - step, places[passes].max(axis=0) + step
    places = places[passes]
    directions = plane.directions(behind.direction[passes])
    moved = plane.from_lens.points(behind.origin[passes])
    crossed = moved[:, :2] - moved[:, 2:] * plane.slopes(directions)
    return _fitted(record, seen, plane, places, directions, crossed)


def _grid(low: Floats, high: Floats) -> Floats:
    side = (np.arange(_ACROSS) + 0.5) / _ACROSS
    unit = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return np.asarray(low + unit * (high - low))


def plane_of(record: ForwardRecord) -> Plane:
    """The plane of a camera's field."""
    parts, array = record.array.parts, record.camera.microlenses
    sensor = parts.sensor_to_local
    if array is not None:
        sensor = sensor._replace(shift=sensor.shift * [1.0, 1.0, 0.0])
    shears = array is not None and not array.is_plate
    from_lens = sensor.inverse().of(parts.local_to_lens.inverse())
    away = float(from_lens.inverse().shift[2]) - model_pupil(record.camera)[0]
    return Plane(from_lens, shears, 1.0 / away if abs(away) > _NEAREST else 0.0)


def _fitted(
    record: ForwardRecord, point: Floats, plane: Plane, places: Floats, directions: Floats, crossed: Floats
) -> Beam:
    """Functions of s through what is known of rays."""
    s = directions - plane.curvature * crossed
    index = float(record.camera.lens.indices(record.camera.wavelength)[-1])
    wavelength = 1e-6 * record.camera.wavelength / index
    low, high = s.min(axis=0), s.max(axis=0)
    edge = 2.0 * (high - low) / _ACROSS
    low, high = low - edge, high + edge
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    focus, error, astray = _focus(s, crossed), math.inf, math.inf
    left = crossed - (focus[:2] - focus[2] * s)
    spot = np.array([crossed.min(axis=0), crossed.max(axis=0)])
    entering = rest = None
    for degree in _DEGREES:
        i, j = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]).T
        if 3 * len(i) > len(s):
            break
        x, y = powers((s - middle) / half, degree)
        values = np.zeros((degree + 1, degree + 1, 3))
        values[i, j, :2] = np.linalg.lstsq(x[:, i] * y[:, j], places, rcond=None)[0]
        slopes = np.concatenate(
            [i * x[:, np.maximum(i - 1, 0)] * y[:, j] / half[0], j * x[:, i] * y[:, np.maximum(j - 1, 0)] / half[1]]
        )
        values[i, j, 2] = np.linalg.lstsq(slopes, -left.T.ravel(), rcond=None)[0]
        entering = Polynomials(middle, half, values[:, :, :2])
        rest = Polynomials(middle, half, values[:, :, 2:])
        missed = (slopes @ values[i, j, 2] + left.T.ravel()).reshape(2, -1).T * half / wavelength
        error = float(np.sqrt((missed**2).sum(axis=1).mean()))
        astray = float(np.abs(entering(s) - places).max() / np.ptp(places, axis=0).max())
        if error < _WELL and astray < _ASTRAY:
            break
    if entering is None or rest is None:
        raise InvalidValueError(f"hardly a ray from the point passes the lens; {len(s)} of {_ACROSS**2} did")
    if error > _WORST or astray > _FARTHEST_ASTRAY:
        raise InvalidValueError(
            f"smooth functions do not say where light crosses the exit pupil (its phase is known to {error:.2g} waves, "
            f"its place in the entrance to {astray:.2g}): the lens has too strong aberrations there, or surfaces that "
            "are not smooth; stop it down"
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
        rest=rest,
        phase_error=error,
    )


def _focus(s: Floats, crossed: Floats) -> Floats:
    """The straight line nearest to X(s), as in `Beam`."""
    n = len(s)
    matrix = np.zeros((2 * n, 3))
    matrix[:n, 0] = matrix[n:, 1] = 1.0
    matrix[:, 2] = -s.T.ravel()
    return np.asarray(np.linalg.lstsq(matrix, crossed.T.ravel(), rcond=None)[0])
