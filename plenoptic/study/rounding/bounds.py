"""Bounds of the rounding errors of a traced ray, and the test that they hold."""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

import numpy as np

from plenoptic.core.rays import RayBundle, RayStatus
from plenoptic.core.values import Floats
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.surfaces.surface import Surface
from plenoptic.study.rounding.exact_asphere import Vector, along_ray, dot, exact_vector
from plenoptic.study.rounding.reference import Crossing, ExactRay, mpmath_context, normal_at, refracted

EPS = float(np.finfo(np.float64).eps)

GRAZING = 1e-2
"""cos i below which the position may be off by `GRAZING_FACTOR` times as much."""

GRAZING_FACTOR = 10.0

NOTICED = 16.0
"""Turn of the normal in eps, over the bound on the position, from which the bound on the direction counts it."""

NOTHING = 1e-30
"""mm. Below that a length counts as none: wild numbers end where squares leave the range of float64."""

LENS_POSITION, LENS_DIRECTION = 1e-13, 3e-15
"""Bounds through a whole photographic lens, mm and 1."""

LEAST_PATH = 1e-6
"""Waves: smaller errors of an optical path are none."""


class Law(enum.IntEnum):
    """Law that a ray must obey."""

    SURFACES = 0
    """The bounds of the single surfaces, carried from surface to surface."""
    LENS = 1
    """`LENS_POSITION` and `LENS_DIRECTION`."""
    TANGENT = 2
    """A hit lies within 4 R sqrt(eps) of where the ray touches the sphere; it may as well be lost."""
    WILD = 3
    """Hits are as exact as for SURFACES; where there is none, the ray is lost. It may be lost anyway."""


class Bounds(NamedTuple):
    """Largest errors that a ray may have."""

    position: float
    """mm."""
    direction: float
    """Length of the difference of unit vectors."""
    snell: float
    """The same against Snell's law with the normal of the very point that was found."""
    path: float
    """Of the optical path, mm."""


def bounds_of(ray: ExactRay, surfaces: list[Surface]) -> Bounds:
    r"""Bounds on the rounding errors of a ray through one surface or several.

    On one surface 4 eps max(\|hit\|, \|z of the vertex\|) / cos i in position (`GRAZING_FACTOR` times that at grazing
    incidence), the hit being measured from the vertex, and 4 eps (1 + mu^2) / cos t in direction. An aspheric sag is
    a sum, good to eps of its largest terms: their sizes added up take the place of \|hit\| where they are larger. Its
    slope is a sum too: the part of its terms, those of the conic over 1 - (1 + k) c^2 r^2, in the normal is added.

    A point that is off by its bound has another normal. Where that turns by more than `NOTICED` eps, the direction
    turns along, and its bound grows by as much; `Bounds.snell` does not know of it. Over several surfaces, an error of
    direction is an error of position at the next one, and the other way round, to first order.

    By Fermat's principle, points that are off along their surfaces do not change the optical path to first order. It
    changes with their distance from the surface, 4 eps of the reference size of the position, with the offset of
    the last one along the ray, and with the rounding of the distances themselves.

    The ray must not end in a total reflection; `surfaces` are those of its crossings.
    """
    position = direction = snell = path = 0.0
    for crossing, surface in zip(ray.crossings, surfaces, strict=True):
        cos_i, cos_t = float(crossing.cos_i), math.sqrt(float(crossing.cos2_t))
        mu, distance = float(crossing.mu), min(float(crossing.distance), 1e300)
        size, slope_size = _sizes(crossing, surface)
        path += 4 * EPS * crossing.ahead * (size + distance)
        own = NOTHING + 4 * EPS * size / cos_i * (GRAZING_FACTOR if cos_i < GRAZING else 1.0)
        position = own + (position + distance * direction) / cos_i if direction else own
        bend = abs(cos_t - mu * cos_i)
        snell = 4 * EPS * (1 + mu * mu) / max(cos_t, 1e-300) + 4 * EPS * slope_size * bend
        turn = crossing.curvature * position
        turn = turn if turn > NOTICED * EPS or direction else 0.0
        given = mu * direction + bend * turn + bend * mu / max(cos_t, 1e-300) * (direction + turn)
        direction = snell + given
    if ray.crossings:
        last = ray.crossings[-1]
        path += last.ahead / float(last.mu) * position
    return Bounds(position, direction, snell, path)


def _sizes(crossing: Crossing, surface: Surface) -> tuple[float, float]:
    """Size that the position is rounded against, in mm, and the factor by which the slope's terms exceed the slope."""
    hit = [float(x) for x in crossing.hit]
    size = max(math.hypot(*hit), abs(crossing.vertex))
    if not surface.aspheric:
        return size, 0.0
    r = min(math.hypot(hit[0], hit[1]), surface.semi_diameter)
    conic = Surface(surface.radius, semi_diameter=surface.semi_diameter, conic=surface.conic)
    terms = [float(conic.sag(r)), *(a * r ** (2 * i + 2) for i, a in enumerate(surface.aspheric))]
    slopes = [float(conic.slope(r)), *((2 * i + 2) * a * r ** (2 * i + 1) for i, a in enumerate(surface.aspheric))]
    # The slope of the conic has the square root 1 - (1 + k) c^2 r^2 in it, which is good to eps of 1.
    sizes = [slopes[0] / max(1 - (r / surface.equator) ** 2, EPS), *slopes[1:]]
    # An angle changes by that of its tangent over 1 + tan^2.
    excess = sum(abs(x) for x in sizes) / (1 + sum(slopes) ** 2)
    return max(size, sum(abs(x) for x in terms)), excess


class Found(NamedTuple):
    """One traced ray beside the exact one, as a `StabilityRow` has it; None where there is nothing to compare."""

    right: bool
    """The status is one that it may have, and its numbers fit: finite for OK, nan for a lost ray."""
    position: float | None = None
    ulps: float | None = None
    """Error of the position, in spacings of float64 at the size of the point (or z of the vertex)."""
    position_ratio: float | None = None
    direction: float | None = None
    direction_ratio: float | None = None
    snell_ratio: float | None = None
    path: float | None = None
    """Waves."""
    path_ratio: float | None = None


def compared(
    traced: tuple[RayBundle, Floats],
    i: int,
    exact: ExactRay,
    lens: LensStack,
    surfaces: list[Surface],
    law: Law,
    s: int,
) -> Found:
    """Compare ray i of a traced bundle, with its paths, to the exact one, and both to the bounds of rounding.

    `surfaces` are those traced through, in the order of travel; s is 1 towards the sensor, -1 towards the scene.
    """
    rays, path = traced[0], float(traced[1][i])
    status = RayStatus(int(rays.status[i]))
    numbers = np.concatenate([rays.origin[i], rays.direction[i]])
    if status != RayStatus.OK:
        void = bool(np.isnan(numbers).all() and np.isnan(path)) and rays.weight[i] == 0
        return Found(void and _may_be_lost(exact, status, law))
    if not np.isfinite(numbers).all():
        return Found(False)
    if law == Law.TANGENT:
        return _touching(numbers, exact, surfaces[0], lens)
    if exact.status != RayStatus.OK:
        return Found(exact.status == RayStatus.TOTAL_REFLECTION and _is_critical(exact.crossings[-1]))
    found = _measured(numbers, exact, surfaces, law, s)
    wave = 1e-6 * rays.wavelength
    off = abs(float(path - exact.path))
    return found._replace(
        path=off / wave, path_ratio=_ratio(off, max(bounds_of(exact, surfaces).path, LEAST_PATH * wave))
    )


def _is_critical(crossing: Crossing) -> bool:
    """True if a ray is so close to the critical angle that rounding decides: |1 - mu^2 sin^2 i| <= 8 mu^2 eps."""
    return bool(abs(crossing.cos2_t) <= 8 * crossing.mu**2 * EPS)


def _may_be_lost(exact: ExactRay, status: RayStatus, law: Law) -> bool:
    if law in (Law.TANGENT, Law.WILD):
        return True
    if status == RayStatus.TOTAL_REFLECTION:
        # At the first surface where it is critical, whatever comes later.
        return exact.status == status or any(_is_critical(crossing) for crossing in exact.crossings)
    return status == exact.status


def _measured(numbers: Floats, exact: ExactRay, surfaces: list[Surface], law: Law, s: int) -> Found:
    mp = mpmath_context()
    point, direction = exact_vector(mp, numbers[:3]), exact_vector(mp, numbers[3:])
    last, bounds = exact.crossings[-1], bounds_of(exact, surfaces)
    if law == Law.LENS:
        bounds = bounds._replace(position=LENS_POSITION, direction=LENS_DIRECTION, snell=math.inf)
    off, turned = _distance(point, exact.origin), _distance(direction, exact.direction)
    snell = None
    if law == Law.SURFACES and len(surfaces) == 1 and last.vertex == 0:
        normal, _ = normal_at(mp, surfaces[0], point)
        wanted = refracted(mp, last.incident, normal, last.mu, s)
        # At the critical angle the point found may be one that reflects.
        snell = None if wanted is None or _is_critical(last) else _ratio(_distance(direction, wanted), bounds.snell)
    spacing = float(np.spacing(max(math.hypot(*(float(x) for x in last.hit)), abs(last.vertex), NOTHING)))
    critical = any(_is_critical(crossing) for crossing in exact.crossings)
    return Found(
        True,
        off,
        off / spacing,
        _ratio(off, bounds.position),
        None if critical else turned,
        None if critical else _ratio(turned, bounds.direction),
        snell,
    )


def _touching(numbers: Floats, exact: ExactRay, surface: Surface, lens: LensStack) -> Found:
    mp = mpmath_context()
    vertex = float(lens.vertices[lens.elements.index(surface)])
    centre = [mp.mpf(0), mp.mpf(0), mp.mpf(surface.radius) + vertex]
    start, along = exact.given
    aside = along_ray(start, centre, -1)
    foot = along_ray(start, along, -dot(aside, along))
    off = _distance(exact_vector(mp, numbers[:3]), foot)
    return Found(True, off, position_ratio=_ratio(off, 4 * abs(surface.radius) * math.sqrt(EPS)))


def _distance(a: Vector, b: Vector) -> float:
    return float(sum((x - y) ** 2 for x, y in zip(a, b, strict=True)) ** 0.5)


def _ratio(error: float, bound: float) -> float:
    return error / bound if bound > 0 else (0.0 if error == 0 else math.inf)
