"""Independent trace with any number of digits, the reference of rounding errors.

Nothing here is shared with the kernels. Spheres and conics are intersected by their quadratic equations with both
roots, and the root is chosen by geometry; aspheres are scanned for their first crossing; Snell's law is the vector
formula with the normal of the point. All float64 numbers of a lens and of a ray are taken as exact, but for the
length of a direction: the ray is its line, and directions behind it have exactly unit length.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from plenoptic.core.rays import RayBundle, RayStatus
from plenoptic.core.values import Floats
from plenoptic.errors import PlenopticError, PrescriptionError
from plenoptic.optics.lens.elements import Element, is_centred
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.mirror import Mirror
from plenoptic.optics.surfaces.surface import Surface
from plenoptic.study.rounding.exact_asphere import (
    Number,
    Vector,
    along_ray,
    dot,
    exact_sag,
    exact_vector,
    first_crossing,
)

DIGITS = 50
"""Decimal digits, unless told otherwise: float64 has 16, an origin 1e9 mm from a radius of 1e-3 mm takes 24 more."""

_EQUATOR = 1e-12
"""Share of the half axis by which a point may lie beyond the rim on the equator: a rim belongs to its surface."""


class _MissingMpmathError(PlenopticError, ImportError):
    pass


def mpmath_context() -> Any:
    """The numbers of `mpmath`, or an error that says how to get them."""
    try:
        import mpmath
    except ImportError as error:
        raise _MissingMpmathError(
            f"the trace with {DIGITS} digits needs mpmath, which cannot be imported ({error}); pip install mpmath"
        ) from error
    return mpmath.mp


class Crossing(NamedTuple):
    """Intersection of an exact ray with a surface."""

    hit: Vector
    """In mm, from the vertex of the surface."""
    vertex: float
    """z of the vertex in the lens frame."""
    distance: Number
    """From where the ray was before, in mm."""
    incident: Vector
    """Direction of travel before the surface."""
    ahead: float
    """Index before the surface."""
    mu: Number
    """Index before over index behind."""
    cos_i: Number
    """Of the angle of incidence."""
    cos2_t: Number
    """1 - mu^2 sin^2 i: the squared cosine of the angle of refraction, below 0 at total reflection."""
    curvature: float
    """The larger one of the two principal curvatures of the surface there, in size, 1/mm."""


class ExactRay(NamedTuple):
    """Exact ray with its fate."""

    status: RayStatus
    """OK, MISSED, CLIPPED or TOTAL_REFLECTION."""
    origin: Vector
    """The last point met, in the lens frame, mm; without meaning for a lost ray."""
    direction: Vector
    crossings: tuple[Crossing, ...]
    """One for each surface met, including that of a total reflection."""
    given: tuple[Vector, Vector]
    """Its origin and its direction, of unit length, before the first element."""
    path: Number
    """Optical path from there to the last point met, mm; negative where that lies behind the origin."""


_Station = tuple[Surface | CircularStop, float, float, Number]
"""An element, its vertex, the index before it, and that over the one behind."""


def exact_rays(
    lens: LensStack,
    rays: RayBundle,
    first: int = 0,
    last: int | None = None,
    *,
    reverse: bool = False,
    digits: int = DIGITS,
) -> list[ExactRay]:
    """Trace rays through a lens of centred surfaces and circular stops, exactly but for the last of many digits.

    `first` and `last` are the elements at both ends, included, as indices in `lens.elements` whatever the direction of
    travel; `reverse` is towards the scene. Other elements are a PrescriptionError.
    """
    mp = mpmath_context()
    end = len(lens.elements) - 1 if last is None else last
    order = range(end, first - 1, -1) if reverse else range(first, end + 1)
    index = lens.indices(rays.wavelength)
    parts = [_checked(lens.elements[i], i) for i in order]
    ratios = [(i + 1, i) if reverse else (i, i + 1) for i in order]
    s = -1 if reverse else 1
    with mp.workdps(digits):
        stations = [
            (part, float(lens.vertices[i]), float(index[a]), mp.mpf(float(index[a])) / mp.mpf(float(index[b])))
            for part, i, (a, b) in zip(parts, order, ratios, strict=True)
        ]
        return [_exact_ray(mp, stations, p, d, s) for p, d in zip(rays.origin, rays.direction, strict=True)]


def _checked(element: Element, number: int) -> Surface | CircularStop:
    reflects = isinstance(element, Surface) and isinstance(element.medium, Mirror)
    if not isinstance(element, Surface | CircularStop) or not is_centred(element) or reflects:
        raise PrescriptionError(
            f"element {number} is {element!r}; the exact trace knows centred surfaces of revolution and circular stops "
            "only, and no mirrors"
        )
    return element


def _exact_ray(mp: Any, stations: list[_Station], origin: Floats, direction: Floats, s: int) -> ExactRay:
    p, d = exact_vector(mp, origin), exact_vector(mp, direction)
    length = mp.sqrt(dot(d, d))
    d = [x / length for x in d]
    given = (p, d)
    crossings: list[Crossing] = []
    path = mp.mpf(0)
    for element, vertex, index, mu in stations:
        local = [p[0], p[1], p[2] - vertex]
        distance = _intersect(mp, element, local, d, s)
        if distance is None:
            lost = RayStatus.CLIPPED if isinstance(element, Surface) and element.aspheric else RayStatus.MISSED
            return ExactRay(lost, p, d, tuple(crossings), given, path)
        path += index * distance
        hit = along_ray(local, d, distance)
        p = [hit[0], hit[1], hit[2] + vertex]
        if not _is_clear(element, hit):
            return ExactRay(RayStatus.CLIPPED, p, d, tuple(crossings), given, path)
        if isinstance(element, CircularStop):
            continue
        normal, curvature = normal_at(mp, element, hit)
        cos_i = s * dot(normal, d)
        cos2_t = 1 - mu * mu * (1 - cos_i * cos_i)
        crossings.append(Crossing(hit, vertex, abs(distance), d, index, mu, cos_i, cos2_t, curvature))
        onwards = refracted(mp, d, normal, mu, s)
        if onwards is None:
            return ExactRay(RayStatus.TOTAL_REFLECTION, p, d, tuple(crossings), given, path)
        d = onwards
    return ExactRay(RayStatus.OK, p, d, tuple(crossings), given, path)


def _is_clear(element: Surface | CircularStop, hit: Vector) -> bool:
    # What goes beyond its equator ends at its depth, which decided about the root.
    if isinstance(element, Surface) and element.depth is not None:
        return True
    return bool(hit[0] ** 2 + hit[1] ** 2 <= element.semi_diameter**2)


def _intersect(mp: Any, element: Surface | CircularStop, p: Vector, d: Vector, s: int) -> Number | None:
    """Distance to the crossing, p measured from the vertex; None where there is none."""
    if isinstance(element, CircularStop) or (math.isinf(element.radius) and not element.aspheric):
        return -p[2] / d[2] if s * d[2] > 0 else None
    if element.aspheric:
        return first_crossing(mp, element, p, d, s)
    return _intersect_sphere(mp, element, p, d, s) if element.conic == 0 else _intersect_conic(mp, element, p, d, s)


def _intersect_sphere(mp: Any, surface: Surface, p: Vector, d: Vector, s: int) -> Number | None:
    """|p + t d - centre|^2 = R^2; of the two points, the one where the ray crosses the cap the way the stack goes."""
    radius = mp.mpf(surface.radius)
    from_centre = [p[0], p[1], p[2] - radius]
    half = dot(from_centre, d)
    square = half * half - dot(from_centre, from_centre) + radius * radius
    if square < 0:
        return None
    deepest = abs(radius) if surface.depth is None else mp.mpf(surface.depth)
    for t in (-half - mp.sqrt(square), -half + mp.sqrt(square)):
        normal = [-a / radius for a in along_ray(from_centre, d, t)]
        on_cap = abs(radius) * (1 - normal[2]) <= deepest + abs(radius) * _EQUATOR
        if s * dot(normal, d) > 0 and on_cap:
            return t
    return None


def _intersect_conic(mp: Any, surface: Surface, p: Vector, d: Vector, s: int) -> Number | None:
    """x^2 + y^2 + (1 + k) z^2 = 2 R z; of the two points, the one on the vertex's sheet, going the right way."""
    radius, squash = mp.mpf(surface.radius), 1 + mp.mpf(surface.conic)
    a = d[0] ** 2 + d[1] ** 2 + squash * d[2] ** 2
    b = d[0] * p[0] + d[1] * p[1] + squash * d[2] * p[2] - radius * d[2]
    c = p[0] ** 2 + p[1] ** 2 + squash * p[2] ** 2 - 2 * radius * p[2]
    square = b * b - a * c
    if square < 0:
        return None
    roots = [-c / (2 * b)] if a == 0 else [(-b - mp.sqrt(square)) / a, (-b + mp.sqrt(square)) / a]
    deepest = 1 if surface.depth is None else squash * mp.mpf(surface.depth) / abs(radius)
    for t in roots:
        hit = along_ray(p, d, t)
        gradient = [-hit[0] / radius, -hit[1] / radius, 1 - squash * hit[2] / radius]
        if s * dot(gradient, d) > 0 and squash * hit[2] / radius <= deepest + _EQUATOR:
            return t
    return None


def normal_at(mp: Any, surface: Surface, hit: Vector) -> tuple[Vector, float]:
    """Unit normal, towards +z at the vertex, and the larger principal curvature in size, 1/mm, at a point of a surface.

    `hit` is measured from the vertex, mm. Off the surface: of the surface of its kind through that point.
    """
    radius, squash = mp.mpf(surface.radius), 1 + mp.mpf(surface.conic)
    if not surface.aspheric:
        normal = [-hit[0] / radius, -hit[1] / radius, 1 - squash * hit[2] / radius]
        length = mp.sqrt(dot(normal, normal))
        # A conic's curvatures are 1 / (R w) along the parallel and 1 / (R w^3) along the meridian.
        curvature = abs(1 / radius) * (max(1 / length, 1 / length**3) if surface.conic else 1)
        return [x / length for x in normal], float(curvature)
    _, by_r2, by_r4 = exact_sag(mp, surface, hit)
    r2 = hit[0] ** 2 + hit[1] ** 2
    length = mp.sqrt(1 + 4 * by_r2**2 * r2)
    parallel, meridian = 2 * by_r2 / length, (2 * by_r2 + 4 * by_r4 * r2) / length**3
    normal = [-2 * by_r2 * hit[0] / length, -2 * by_r2 * hit[1] / length, 1 / length]
    return normal, float(max(abs(parallel), abs(meridian)))


def refracted(mp: Any, direction: Vector, normal: Vector, mu: Number, s: int) -> Vector | None:
    """Snell's law for unit vectors, the normal towards +z at the vertex; None at total reflection.

    mu: index before over index behind; s is 1 for light that travels towards the sensor, -1 in reverse.
    """
    cos_i = s * dot(normal, direction)
    cos2_t = 1 - mu * mu * (1 - cos_i * cos_i)
    if cos2_t < 0:
        return None
    bend = s * (mp.sqrt(cos2_t) - mu * cos_i)
    return [mu * a + bend * b for a, b in zip(direction, normal, strict=True)]
