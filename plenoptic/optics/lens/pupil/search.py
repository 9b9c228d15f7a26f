"""Solver for rays from points of the iris to a target point in front of the lens or behind it.

Rays are traced outwards from points of the iris. Newton's method in two dimensions solves for the direction at the iris
with which they pass through the target. The chief ray is bracketed by a fan of rays; all others are continued from it
towards the rim of the iris.

Directions are *angle coordinates* (u, v) = theta (cos phi, sin phi), with theta the angle against the axis and phi the
azimuth. They are nearly linear in the field and not limited to 90 degrees.
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.lens_record import LensRecord, lens_record
from plenoptic.optics.lens.placement import to_lens_axes
from plenoptic.optics.lens.pupil.iris_points import hexapolar
from plenoptic.optics.lens.pupil.object_point import angles_of, directions_of
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_record

_DIFFERENCE = 1e-6
"""Step in rad of the difference quotients; their error of 1e-6 gains six digits in each of Newton's steps."""

_STEPS, _HALVINGS = 30, 8
_LONGEST_STEP = 0.3
"""Limits of Newton's method: number of steps, number of halvings of a step that fails, and step length in rad."""

_FLOOR, SOLVED = 1e-15, 1e-11
"""Residuals in rad: iteration stops below the first one; below the second one, a failed step counts as converged."""

_SMALLEST_ADVANCE = 1.0 / 128
"""Smallest continuation step from the chief ray to a point of the iris, as a fraction; below it, no ray exists."""

_MANY, _RINGS, _DEGREE, _CHUNK = 4096, 14, 9, 1 << 13
"""For more points than the first number, a polynomial of degree 9 is fitted to 14 rings that are solved first. The
other points follow, in chunks of the last number."""

_FAN = np.linspace(-1.0, 1.0, 513) * math.radians(89.5)
"""Angles in rad of the fan of rays at the centre of the iris that brackets the chief ray."""


class Half(NamedTuple):
    """Half of a lens: the elements between the iris and the target point, and that point."""

    outwards: LensRecord | None
    """Record from the iris to the outermost element; None if there is no element."""
    inwards: LensRecord
    """Record from the outermost element to the iris."""
    sign: float
    """Direction of outward travel: -1 towards the scene, +1 towards the sensor."""
    wavelength: float
    aim: Floats
    """Target point: (2,) angle coordinates at infinity, or (3,) a point in mm."""


def half_of(lens: LensStack, wavelength: float, aim: Floats, *, scene: bool) -> Half:
    """Half of the lens between the iris and a target point, in front of the lens (`scene`) or behind it."""
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
    """Points and directions behind the elements of a record; NaN for lost rays."""
    if lens is None:
        return origin, direction
    n, contiguous = len(origin), (np.ascontiguousarray(origin).view(), np.ascontiguousarray(direction).view())
    status, lost_at = np.zeros(n, dtype=np.uint8), np.full(n, -1, dtype=np.int16)
    rays = RayBundle._from_arrays(*contiguous, wavelength, np.ones(n), status, lost_at)
    out = trace_record(lens, rays, threads=1 if n <= _CHUNK else None)
    return out.origin, out.direction


def outermost(half: Half, points: Floats, angles: Floats) -> tuple[Floats, Floats]:
    """Points (n, 3) on the outermost element and directions (n, 3) behind it, of rays from points of the iris."""
    return traced_through(half.outwards, points, directions_of(angles, half.sign), half.wavelength)


def _residual(half: Half, points: Floats, angles: Floats) -> Floats:
    """Residual angle coordinates (n, 2) of rays from points of the iris at the target point."""
    origin, direction = outermost(half, points, angles)
    arriving = angles_of(direction, half.sign)
    return arriving - (half.aim if half.aim.size == 2 else angles_of(half.aim - origin, half.sign))


def _length(vectors: Floats) -> Floats:
    """Lengths (n,) of vectors (n, 2), inf for those with nan."""
    return np.nan_to_num(np.hypot(vectors[:, 0], vectors[:, 1]), nan=math.inf)


def _newton_step(half: Half, points: Floats, angles: Floats, residual: Floats) -> Floats:
    """Newton's step (n, 2) from difference quotients; these step towards the axis, where rays are least likely lost."""
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
    """Angle coordinates (n, 2) at points of the iris (n, 3) of rays through the target, and their residuals in rad."""
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
    """Points (n, 3) in mm in the lens frame, from points (n, 2) of the iris in units of its semi-diameter."""
    points = np.column_stack([lens.stop.semi_diameter * pupil, np.zeros(len(pupil))])
    return to_lens_axes(lens.stop.placement, points)


def _chief_guess(half: Half, centre: Floats) -> Floats:
    """Approximate angle coordinates (1, 2) of the chief ray at the centre of the iris.

    In a fan of rays towards the azimuth of the target, it is the sign change of the residual nearest to the axis.
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
    """Continue angle coordinates from the centre of the iris, (1, 2), to points of it, (n, 2); and residuals."""
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
    """Monomials x^i y^j of points (n, 2) up to the degree `_DEGREE`, (n, k)."""
    x, y = (np.polynomial.polynomial.polyvander(column, _DEGREE) for column in pupil.T)
    return np.concatenate([x[:, : _DEGREE + 1 - j] * y[:, j : j + 1] for j in range(_DEGREE + 1)], axis=1)


@functools.cache
def _fit() -> Floats:
    """Matrix from values at `hexapolar(_RINGS)` to the least-squares coefficients of `_terms`."""
    return np.asarray(np.linalg.pinv(_terms(hexapolar(_RINGS))))


def aimed_angles(half: Half, lens: LensStack, pupil: Floats) -> tuple[Floats, Floats]:
    """Angle coordinates (n, 2) at points of the iris, and their residuals at the target in rad, (n,): inf for no ray.

    For many points, a few are solved first, and a polynomial fit to these gives the initial values of the others.
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
