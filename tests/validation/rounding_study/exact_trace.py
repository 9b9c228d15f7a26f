"""Independent ray trace with 50 digits, against which rounding errors of the kernels are measured.

Nothing is shared with the kernels. Conics are intersected by their quadratic equation with both roots, and the root is
chosen by geometry; aspheres are scanned for their first crossing (`asphere.py`); Snell's law is the vector formula.
All float64 numbers of a lens and of a ray are exact, except for the length of a direction: it is normalised.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from mpmath import mp

import plenoptic as pl
from plenoptic.core.rays import RayStatus

from .asphere import exact_sag, first_crossing

DIGITS = 50
"""Decimal digits by default: float64 has 16, an origin 1e9 mm from a radius of 1e-3 mm takes 24 more."""

EQUATOR = 1e-12
"""Share of the half axis by which a point may lie beyond the rim on the equator: a rim belongs to its surface."""


class Hit(NamedTuple):
    """Intersection of an exact ray with a surface; lengths in mm."""

    point: Any  # from the vertex
    vertex: float  # z in the lens frame
    distance: Any  # from the point before
    incident: Any  # unit direction before the surface
    n: float  # index before the surface
    mu: Any  # n over the index behind the surface
    cos_i: Any  # cosine of the angle of incidence
    cos2_t: Any  # 1 - mu^2 sin^2 i: below 0 at total reflection
    curvature: float  # size of the larger principal curvature, 1/mm


class ExactRay(NamedTuple):
    """Traced ray, in the lens frame; lengths in mm."""

    status: RayStatus
    origin: Any  # last hit; without meaning for a lost ray
    direction: Any
    hits: tuple[Hit, ...]  # of surfaces, that of a total reflection included
    start: tuple[Any, Any]  # origin and unit direction before the first element
    path: Any  # optical path from the start to the last hit, negative where that lies behind


def vector(numbers):
    """Numbers of float64, exactly."""
    return np.array([mp.mpf(float(x)) for x in numbers])


def trace_exactly(lens, rays, first=0, last=None, *, reverse=False, digits=DIGITS):
    """Trace rays through elements first ... last: centred surfaces of revolution and circular stops."""
    last = len(lens.elements) - 1 if last is None else last
    order = range(last, first - 1, -1) if reverse else range(first, last + 1)
    n = lens.indices(rays.wavelength)
    sides = [(i + 1, i) if reverse else (i, i + 1) for i in order]
    stations = [
        (lens.elements[i], float(lens.vertices[i]), float(n[before]), float(n[behind]))
        for i, (before, behind) in zip(order, sides, strict=True)
    ]
    with mp.workdps(digits):
        sign = -1 if reverse else 1
        return [_trace_ray(stations, p, d, sign) for p, d in zip(rays.origin, rays.direction, strict=True)]


def _trace_ray(stations, origin, direction, sign):
    """Trace one ray; sign is 1 for light that travels towards the sensor, -1 in reverse."""
    p, d = vector(origin), vector(direction)
    d = d / mp.sqrt(d @ d)
    start, hits, path = (p, d), [], mp.mpf(0)
    for element, z, n, n_behind in stations:
        vertex = np.array([0, 0, z])
        local = p - vertex
        distance = _intersect(element, local, d, sign)
        if distance is None:
            aspheric = isinstance(element, pl.Surface) and element.aspheric
            return ExactRay(RayStatus.CLIPPED if aspheric else RayStatus.MISSED, p, d, tuple(hits), start, path)
        path += n * distance
        point = local + d * distance
        p = point + vertex
        # A surface beyond its equator ends at its depth, which chose the root.
        ends_at_its_rim = isinstance(element, pl.CircularStop) or element.depth is None
        if ends_at_its_rim and point[0] ** 2 + point[1] ** 2 > element.semi_diameter**2:
            return ExactRay(RayStatus.CLIPPED, p, d, tuple(hits), start, path)
        if isinstance(element, pl.CircularStop):
            continue
        normal, curvature = normal_at(element, point)
        mu = mp.mpf(n) / mp.mpf(n_behind)
        cos_i = sign * (normal @ d)
        hits.append(Hit(point, z, abs(distance), d, n, mu, cos_i, 1 - mu * mu * (1 - cos_i * cos_i), curvature))
        refracted = refract(d, normal, mu, sign)
        if refracted is None:
            return ExactRay(RayStatus.TOTAL_REFLECTION, p, d, tuple(hits), start, path)
        d = refracted
    return ExactRay(RayStatus.OK, p, d, tuple(hits), start, path)


def _intersect(element, p, d, sign):
    """Distance to the intersection, p measured from the vertex; None where there is none."""
    if isinstance(element, pl.CircularStop) or (math.isinf(element.radius) and not element.aspheric):
        return -p[2] / d[2] if sign * d[2] > 0 else None
    if element.aspheric:
        return first_crossing(element, p, d, sign)
    return _intersect_conic(element, p, d, sign)


def _intersect_conic(surface, p, d, sign):
    """x^2 + y^2 + (1 + k) z^2 = 2 R z; of the two points, the one on the vertex's sheet that is crossed forwards."""
    radius, squash = mp.mpf(surface.radius), 1 + mp.mpf(surface.conic)
    scaled = np.array([1, 1, squash])
    a, b, c = d @ (scaled * d), d @ (scaled * p) - radius * d[2], p @ (scaled * p) - 2 * radius * p[2]
    square = b * b - a * c
    if square < 0:
        return None
    roots = [-c / (2 * b)] if a == 0 else [(-b - mp.sqrt(square)) / a, (-b + mp.sqrt(square)) / a]
    deepest = 1 if surface.depth is None else squash * mp.mpf(surface.depth) / abs(radius)
    for t in roots:
        point = p + d * t
        if sign * (_gradient(surface, point) @ d) > 0 and squash * point[2] / radius <= deepest + EQUATOR:
            return t
    return None


def _gradient(surface, point):
    """Normal of a conic towards +z at the vertex, not normalised."""
    radius, squash = mp.mpf(surface.radius), 1 + mp.mpf(surface.conic)
    return np.array([-point[0] / radius, -point[1] / radius, 1 - squash * point[2] / radius])


def normal_at(surface, point):
    """Unit normal, towards +z at the vertex, and size of the larger principal curvature, 1/mm.

    `point` is measured from the vertex. Off the surface: of the surface of its kind through that point.
    """
    if not surface.aspheric:
        normal = _gradient(surface, point)
        w = mp.sqrt(normal @ normal)
        # 1 / (R w) along the parallel and 1 / (R w^3) along the meridian.
        bent = max(1 / w, 1 / w**3) if surface.conic else 1
        return normal / w, float(bent / abs(mp.mpf(surface.radius)))
    _, by_r2, by_r4 = exact_sag(surface, point)
    r2 = point[0] ** 2 + point[1] ** 2
    w = mp.sqrt(1 + 4 * by_r2**2 * r2)
    parallel, meridian = 2 * by_r2 / w, (2 * by_r2 + 4 * by_r4 * r2) / w**3
    normal = np.array([-2 * by_r2 * point[0], -2 * by_r2 * point[1], mp.mpf(1)]) / w
    return normal, float(max(abs(parallel), abs(meridian)))


def refract(direction, normal, mu, sign):
    """Snell's law for unit vectors, the normal towards +z at the vertex; None at total reflection."""
    cos_i = sign * (normal @ direction)
    cos2_t = 1 - mu * mu * (1 - cos_i * cos_i)
    if cos2_t < 0:
        return None
    return direction * mu + normal * (sign * (mp.sqrt(cos2_t) - mu * cos_i))
