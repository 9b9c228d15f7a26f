"""From points of the iris outwards: the search for rays that meet a point before the lens or behind it.

Rays are traced outwards from points of the iris, and Newton's method in two dimensions finds the direction there with
which they meet the point. The ray through the centre, the chief ray, is bracketed by a fan of rays; all others are
continued from it towards the rim of the iris.

Directions are treated as *angle coordinates* (u, v) = theta (cos phi, sin phi), with theta the angle against the axis
and phi the azimuth. Nearly linear in the field, they know no limit at 90 degrees.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.lens_record import LensRecord, lens_record
from plenoptic.optics.lens.placement import to_lens_axes
from plenoptic.optics.lens.pupil.iris_points import hexapolar
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_record

if TYPE_CHECKING:
    from plenoptic.optics.lens.stack import LensStack

_DIFFERENCE = 1e-6
"""Step in rad of the difference quotients: their error of 1e-6 lets each of Newton's steps gain six digits."""

_STEPS, _HALVINGS = 30, 8
_LONGEST_STEP = 0.3
"""Limits of Newton's method: steps, halvings of one that does not help, and its length in rad."""

_FLOOR, SOLVED = 1e-15, 1e-11
"""Residuals in rad: below the first no step is tried any more, below the second one that does not help is noise."""

_SMALLEST_ADVANCE = 1.0 / 128
"""Part of the way from the chief ray to a point of the iris below which there is taken to be no ray."""

_MANY, _RINGS, _DEGREE, _CHUNK = 4096, 14, 9, 1 << 13
"""Of more points than the first, 14 rings are solved beforehand and a polynomial of degree 9 is laid through them; then
the others follow, as many at a time as the last says."""

_FAN = np.linspace(-1.0, 1.0, 513) * math.radians(89.5)
"""Directions at the centre of the iris among which the chief ray is looked for."""


class Half(NamedTuple):
    """Elements between the iris and the target point, and that point."""

    outwards: LensRecord | None
    """From the iris to the outermost element; None where nothing lies there."""
    inwards: LensRecord
    """From the outermost element to the iris."""
    sign: float
    """Direction of outward travel: -1 towards the scene, +1 towards the sensor."""
    wavelength: float
    aim: Floats
    """(2,) angle coordinates of a point that is infinitely far away, or (3,) a point in mm."""


def angles_of(direction: Floats, sign: float) -> Floats:
    """Angle coordinates (n, 2) of directions (n, 3)."""
    across = np.hypot(direction[:, 0], direction[:, 1])
    theta = np.arctan2(across, sign * direction[:, 2])
    with np.errstate(invalid="ignore", divide="ignore"):
        stretch = np.where(across > 0, theta / across, 1.0)
    return np.asarray(direction[:, :2] * stretch[:, None])


def directions_of(angles: Floats, sign: float) -> Floats:
    """Unit vectors (n, 3) of angle coordinates (n, 2)."""
    theta = np.sqrt(angles[:, 0] ** 2 + angles[:, 1] ** 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        shrink = np.where(theta > 0, np.sin(theta) / theta, 1.0)
    directions = np.empty((len(angles), 3))
    directions[:, :2] = angles * shrink[:, None]
    directions[:, 2] = sign * np.cos(theta)
    return directions


def half_of(lens: LensStack, wavelength: float, aim: Floats, *, scene: bool) -> Half:
    """Half of the lens in which rays from the iris to a point are searched: before the lens (`scene`) or behind it."""
    iris, last = lens.iris_index, len(lens.elements) - 1
    ends, outer = ((0, iris), (0, iris - 1)) if scene else ((iris, last), (iris + 1, last))
    inwards = lens_record(lens, wavelength, reverse=not scene, first=ends[0], last=ends[1], clipping=False)
    outwards = None
    if outer[0] <= outer[1]:
        outwards = lens_record(lens, wavelength, reverse=scene, first=outer[0], last=outer[1], clipping=False)
    return Half(outwards, inwards, -1.0 if scene else 1.0, wavelength, aim)


def traced_through(
    lens: LensRecord | None, origin: Floats, direction: Floats, wavelength: float
) -> tuple[Floats, Floats]:
    """Points and directions behind the elements of a record; NaN for rays that do not exist."""
    if lens is None:
        return origin, direction
    n, contiguous = len(origin), (np.ascontiguousarray(origin).view(), np.ascontiguousarray(direction).view())
    status, lost_at = np.zeros(n, dtype=np.uint8), np.full(n, -1, dtype=np.int16)
    rays = RayBundle._from_arrays(*contiguous, wavelength, np.ones(n), status, lost_at)
    out = trace_record(lens, rays, threads=1 if n <= _CHUNK else None)
    return out.origin, out.direction


def outermost(half: Half, points: Floats, angles: Floats) -> tuple[Floats, Floats]:
    """Points (n, 3) on the outermost element and directions (n, 3) there, of rays from points of the iris."""
    return traced_through(half.outwards, points, directions_of(angles, half.sign), half.wavelength)


def _residual(half: Half, points: Floats, angles: Floats) -> Floats:
    """Angle coordinates (n, 2) by which rays from points of the iris miss the point that is aimed at."""
    origin, direction = outermost(half, points, angles)
    arriving = angles_of(direction, half.sign)
    return arriving - (half.aim if half.aim.size == 2 else angles_of(half.aim - origin, half.sign))


def _length(vectors: Floats) -> Floats:
    """Lengths (n,) of vectors (n, 2), inf for those that are no numbers."""
    return np.nan_to_num(np.hypot(vectors[:, 0], vectors[:, 1]), nan=math.inf)


def _newton_step(half: Half, points: Floats, angles: Floats, residual: Floats) -> Floats:
    """Newton's step (n, 2) from difference quotients, taken towards the axis, where rays are surest to exist."""
    n = len(points)
    h = np.where(angles > 0, -_DIFFERENCE, _DIFFERENCE)
    displaced = np.concatenate([angles, angles])
    displaced[:n, 0] += h[:, 0]
    displaced[n:, 1] += h[:, 1]
    moved = _residual(half, np.concatenate([points, points]), displaced)
    with np.errstate(all="ignore"):
        (a, c), (b, d) = ((moved[:n] - residual) / h[:, :1]).T, ((moved[n:] - residual) / h[:, 1:]).T
        fx, fy = residual.T
        step = np.column_stack([b * fy - d * fx, c * fx - a * fy]) / (a * d - b * c)[:, None]
        return np.asarray(step * np.minimum(1.0, _LONGEST_STEP / np.hypot(step[:, 0], step[:, 1]))[:, None])


def _newton(half: Half, points: Floats, start: Floats) -> tuple[Floats, Floats]:
    """Angle coordinates (n, 2) at points of the iris (n, 3) that meet the aim, and their errors in rad."""
    angles = np.array(start)
    residual = _residual(half, points, angles)
    miss = _length(residual)
    active = np.isfinite(miss)
    for _ in range(_STEPS):
        active &= miss > _FLOOR
        at = np.flatnonzero(active)
        if at.size == 0:
            break
        step = _newton_step(half, points[at], angles[at], residual[at])
        active[at] = False
        for _ in range(_HALVINGS):
            trial = angles[at] + step
            trial_residual = _residual(half, points[at], trial)
            missed = _length(trial_residual)
            better = missed < miss[at]
            took = at[better]
            angles[took], residual[took], miss[took] = trial[better], trial_residual[better], missed[better]
            active[took] = True
            worse = ~better & (miss[at] > SOLVED)
            at, step = at[worse], step[worse] / 2
            if at.size == 0:
                break
    return angles, miss


def points_of(lens: LensStack, pupil: Floats) -> Floats:
    """Points (n, 3) in the lens frame of points (n, 2) of the iris in units of its semi-diameter."""
    points = np.column_stack([lens.stop.semi_diameter * pupil, np.zeros(len(pupil))])
    return to_lens_axes(lens.stop.placement, points)


def _chief_guess(half: Half, centre: Floats) -> Floats:
    """Angle coordinates (1, 2) at the centre of the iris close to those of the chief ray.

    In a fan of rays towards the azimuth of the aim, the one nearest to the axis at which the residual changes its sign.
    """
    middle = len(_FAN) // 2
    aim_angles = half.aim if half.aim.size == 2 else angles_of((half.aim - centre)[None], half.sign)[0]
    size = math.hypot(*aim_angles)
    azimuth = aim_angles / size if size > 0 else np.array([0.0, 1.0])
    angles = _FAN[:, None] * azimuth
    past = _residual(half, np.broadcast_to(centre, (len(_FAN), 3)), angles) @ azimuth
    lost = np.flatnonzero(~np.isfinite(past))
    low = int(lost[lost < middle].max(initial=-1)) + 1
    high = int(lost[lost > middle].min(initial=len(_FAN))) - 1
    if past[middle] == 0 or high <= low:
        return angles[middle : middle + 1]
    run = past[low : high + 1]
    turns = low + np.flatnonzero(np.signbit(run[:-1]) != np.signbit(run[1:]))
    if turns.size == 0:
        return angles[None, low + int(np.argmin(np.abs(run)))]
    i = int(turns[np.argmin(np.abs(turns + 0.5 - middle))])
    return np.asarray((angles[i] + (angles[i + 1] - angles[i]) * past[i] / (past[i] - past[i + 1]))[None])


def _continue_to(half: Half, lens: LensStack, pupil: Floats, chief: Floats) -> tuple[Floats, Floats]:
    """Angle coordinates (n, 2) at points of the iris and their errors, from those at its centre, (1, 2)."""
    n = len(pupil)
    angles, progress, advance, miss = np.repeat(chief, n, axis=0), np.zeros(n), np.ones(n), np.full(n, math.inf)
    going = np.ones(n, dtype=bool)
    while going.any():
        at = np.flatnonzero(going)
        to = np.minimum(progress[at] + advance[at], 1.0)
        trial, missed = _newton(half, points_of(lens, pupil[at] * to[:, None]), angles[at])
        good = missed <= SOLVED
        solved = at[good]
        progress[solved], angles[solved] = to[good], trial[good]
        advance[at[~good]] /= 4
        going[at[~good]] = advance[at[~good]] >= _SMALLEST_ADVANCE
        arrived = progress[solved] == 1.0
        miss[solved[arrived]], going[solved[arrived]] = missed[good][arrived], False
    return angles, miss


def _terms(pupil: Floats) -> Floats:
    """The monomials x^i y^j of points (n, 2) up to the degree `_DEGREE`, (n, k)."""
    x, y = (np.polynomial.polynomial.polyvander(column, _DEGREE) for column in pupil.T)
    return np.concatenate([x[:, : _DEGREE + 1 - j] * y[:, j : j + 1] for j in range(_DEGREE + 1)], axis=1)


@functools.cache
def _fit() -> Floats:
    """Matrix from values at `hexapolar(_RINGS)` to the coefficients of `_terms` that fit them best."""
    return np.asarray(np.linalg.pinv(_terms(hexapolar(_RINGS))))


def aimed_angles(half: Half, lens: LensStack, pupil: Floats) -> tuple[Floats, Floats]:
    """Angle coordinates (n, 2) at points of the iris, and their errors at the aim in rad, (n,): inf for no ray.

    Of many points, a few are solved first, and a polynomial through these is where the others start from.
    """
    centre = points_of(lens, np.zeros((1, 2)))
    chief, missed = _newton(half, centre, _chief_guess(half, centre[0]))
    if len(pupil) == 0 or not missed[0] <= SOLVED:
        return np.repeat(chief, len(pupil), axis=0), np.full(len(pupil), math.inf)
    if len(pupil) <= _MANY:
        return _continue_to(half, lens, pupil, chief)
    reach = float(np.hypot(pupil[:, 0], pupil[:, 1]).max()) or 1.0
    samples, misses = _continue_to(half, lens, reach * hexapolar(_RINGS), chief)
    if not np.all(misses <= SOLVED):
        return _continue_to(half, lens, pupil, chief)
    coefficients = _fit() @ samples
    angles, miss = np.empty_like(pupil), np.empty(len(pupil))
    for start in range(0, len(pupil), _CHUNK):
        at = slice(start, start + _CHUNK)
        angles[at], miss[at] = _newton(half, points_of(lens, pupil[at]), _terms(pupil[at] / reach) @ coefficients)
    lost = np.flatnonzero(~(miss <= SOLVED))
    angles[lost], miss[lost] = _continue_to(half, lens, pupil[lost], chief)
    return angles, miss
