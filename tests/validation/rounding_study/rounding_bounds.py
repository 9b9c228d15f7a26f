"""Bounds on the rounding errors of a traced ray, and the errors of a ray against the exact one."""

import enum
import math
from typing import NamedTuple

import numpy as np
from mpmath import mp

import plenoptic as pl
from plenoptic.core.rays import RayStatus

from .exact_trace import normal_at, refract, vector

EPS = float(np.finfo(np.float64).eps)

GRAZING, GRAZING_FACTOR = 1e-2, 10.0
"""cos i below which the position may be off by this factor more."""

NOTICED = 16.0
"""Turn of the normal in eps, over the bound on the position, from which the bound on the direction counts it."""

NOTHING = 1e-30
"""mm. Below that a length counts as none: wild numbers end where squares leave the range of float64."""

LENS_POSITION, LENS_DIRECTION = 1e-13, 3e-15
"""Bounds through a whole photographic lens, mm and 1."""

LEAST_PATH = 1e-6
"""Waves: smaller errors of an optical path are none."""


class Law(enum.IntEnum):
    """Bounds that the rays of a case are held to."""

    SURFACES = 0  # those of the single surfaces, carried from surface to surface
    LENS = 1  # LENS_POSITION and LENS_DIRECTION
    TANGENT = 2  # a hit lies within 4 R sqrt(eps) of the point of contact; the ray may as well be lost
    WILD = 3  # a hit is as exact as for SURFACES; the ray may be lost for any reason


class Bounds(NamedTuple):
    """Largest errors that a ray may have."""

    position: float  # mm
    direction: float  # length of the difference of unit vectors
    snell: float  # the same against Snell's law with the normal at the traced point
    path: float  # of the optical path, mm


def bounds_of(ray, surfaces):
    """Bounds on a ray that has hit these surfaces, and is not reflected by the last one.

    One surface: 4 eps max(|hit|, |z of the vertex|) / cos i in position, the hit measured from the vertex, ten times
    that at grazing incidence; 4 eps (1 + mu^2) / cos t in direction. An aspheric sag is a sum, good to eps of the sizes
    of its terms, which take the place of |hit| where they are larger. Its slope is a sum too: what its terms, those of
    the conic over 1 - (1 + k) c^2 r^2, leave of the normal is added.

    A point that is off by its bound has another normal. Where that turns by more than `NOTICED` eps, the bound on the
    direction grows by as much; `Bounds.snell` does not. Over several surfaces, errors of direction are errors of
    position at the next one, and the other way round, to first order.

    By Fermat's principle, points that are off along their surfaces do not change the optical path to first order. Its
    bound is 4 eps of the lengths, how far the last point is off along the ray, and rounding of the distances.
    """
    position = direction = snell = path = 0.0
    for hit, surface in zip(ray.hits, surfaces, strict=True):
        cos_i, cos_t = float(hit.cos_i), math.sqrt(float(hit.cos2_t))
        mu, distance = float(hit.mu), min(float(hit.distance), 1e300)
        size, slope_size = _sizes(hit, surface)
        path += 4 * EPS * hit.n * (size + distance)
        rounding = NOTHING + 4 * EPS * size / cos_i * (GRAZING_FACTOR if cos_i < GRAZING else 1.0)
        position = rounding + (position + distance * direction) / cos_i if direction else rounding
        bend = abs(cos_t - mu * cos_i)
        snell = 4 * EPS * (1 + mu * mu) / max(cos_t, 1e-300) + 4 * EPS * slope_size * bend
        turn = hit.curvature * position
        turn = turn if turn > NOTICED * EPS or direction else 0.0
        carried = mu * direction + bend * turn + bend * mu / max(cos_t, 1e-300) * (direction + turn)
        direction = snell + carried
    if ray.hits:
        path += ray.hits[-1].n / float(ray.hits[-1].mu) * position
    return Bounds(position, direction, snell, path)


def _sizes(hit, surface):
    """Length against which the position is rounded, mm, and the excess of the sizes of the slope's terms."""
    point = [float(x) for x in hit.point]
    size = max(math.hypot(*point), abs(hit.vertex))
    if not surface.aspheric:
        return size, 0.0
    r = min(math.hypot(point[0], point[1]), surface.semi_diameter)
    conic = pl.Surface(surface.radius, semi_diameter=surface.semi_diameter, conic=surface.conic)
    terms = [float(conic.sag(r)), *(a * r ** (2 * i + 2) for i, a in enumerate(surface.aspheric))]
    slopes = [float(conic.slope(r)), *((2 * i + 2) * a * r ** (2 * i + 1) for i, a in enumerate(surface.aspheric))]
    # The slope of the conic has the square root 1 - (1 + k) c^2 r^2 in it, which is good to eps of 1.
    sizes = [slopes[0] / max(1 - (r / surface.equator) ** 2, EPS), *slopes[1:]]
    # An angle changes by that of its tangent over 1 + tan^2.
    return max(size, sum(map(abs, terms))), sum(map(abs, sizes)) / (1 + sum(slopes) ** 2)


class RayErrors(NamedTuple):
    """Errors of one ray against the exact one; None where there is nothing to compare."""

    right: bool  # the status is allowed, and the numbers fit: finite for OK, nan for a lost ray
    position: float | None = None  # mm
    ulps: float | None = None  # error of the position in spacings of float64 at the point (or at z of the vertex)
    position_ratio: float | None = None  # over the bound
    direction: float | None = None
    direction_ratio: float | None = None
    snell_ratio: float | None = None
    path: float | None = None  # waves
    path_ratio: float | None = None


def ray_errors(traced, i, exact, lens, surfaces, law, sign):
    """Errors of ray i of a traced bundle with its paths; `surfaces` are those traced through, in order of travel."""
    rays, path = traced[0], float(traced[1][i])
    status = RayStatus(int(rays.status[i]))
    numbers = np.concatenate([rays.origin[i], rays.direction[i]])
    if status != RayStatus.OK:
        void = bool(np.isnan(numbers).all() and np.isnan(path)) and rays.weight[i] == 0
        return RayErrors(void and _may_be_lost(exact, status, law))
    if not np.isfinite(numbers).all():
        return RayErrors(False)
    if law == Law.TANGENT:
        return _tangent_errors(numbers, exact, surfaces[0], lens)
    if exact.status != RayStatus.OK:
        return RayErrors(exact.status == RayStatus.TOTAL_REFLECTION and is_critical(exact.hits[-1]))
    wave = 1e-6 * rays.wavelength
    off = abs(float(path - exact.path))
    bounds = bounds_of(exact, surfaces)
    ratio = _ratio(off, max(bounds.path, LEAST_PATH * wave))
    return _hit_errors(numbers, exact, surfaces, bounds, law, sign)._replace(path=off / wave, path_ratio=ratio)


def is_critical(hit):
    """True if rounding decides about total reflection: |1 - mu^2 sin^2 i| <= 8 mu^2 eps."""
    return abs(hit.cos2_t) <= 8 * hit.mu**2 * EPS


def _may_be_lost(exact, status, law):
    if law in (Law.TANGENT, Law.WILD):
        return True
    if status == RayStatus.TOTAL_REFLECTION:
        # At the first surface where it is critical, whatever comes later.
        return exact.status == status or any(map(is_critical, exact.hits))
    return status == exact.status


def _hit_errors(numbers, exact, surfaces, bounds, law, sign):
    point, direction = vector(numbers[:3]), vector(numbers[3:])
    last = exact.hits[-1]
    if law == Law.LENS:
        bounds = bounds._replace(position=LENS_POSITION, direction=LENS_DIRECTION, snell=math.inf)
    off, turned = _distance(point, exact.origin), _distance(direction, exact.direction)
    snell = None
    if law == Law.SURFACES and len(surfaces) == 1 and last.vertex == 0:
        refracted = refract(last.incident, normal_at(surfaces[0], point)[0], last.mu, sign)
        # At the critical angle the traced point may be one that reflects.
        if refracted is not None and not is_critical(last):
            snell = _ratio(_distance(direction, refracted), bounds.snell)
    spacing = float(np.spacing(max(math.hypot(*map(float, last.point)), abs(last.vertex), NOTHING)))
    errors = RayErrors(True, off, off / spacing, _ratio(off, bounds.position), snell_ratio=snell)
    if any(map(is_critical, exact.hits)):
        return errors
    return errors._replace(direction=turned, direction_ratio=_ratio(turned, bounds.direction))


def _tangent_errors(numbers, exact, surface, lens):
    """Distance from the point of the ray that is nearest to the centre of the sphere."""
    centre = vector([0, 0, 0])
    centre[2] = mp.mpf(surface.radius) + float(lens.vertices[lens.elements.index(surface)])
    origin, d = exact.start
    nearest = origin + d * (d @ (centre - origin))
    off = _distance(vector(numbers[:3]), nearest)
    return RayErrors(True, off, position_ratio=_ratio(off, 4 * abs(surface.radius) * math.sqrt(EPS)))


def _distance(a, b):
    return float(((a - b) @ (a - b)) ** 0.5)


def _ratio(error, bound):
    return error / bound if bound > 0 else (0.0 if error == 0 else math.inf)
