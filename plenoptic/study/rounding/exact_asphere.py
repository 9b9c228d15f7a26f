"""First intersection of a ray with an even asphere, to any number of digits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.surfaces.surface import Surface

_SCAN = 2048
"""Parts of a ray's way through the clear cylinder of an asphere in which a change of sign is looked for."""

_BESIDE = 1e-6
"""How far, in mm and as a share of the distance, the roots of float64 may be off: at a tangent by the root of eps."""

_CLOSER, _ZOOMS = 32, 8
"""Parts into which the neighbourhood of a place is divided where the ray comes close without a change of sign, and how
often: 16^8 is 4e9."""

_POLISH = 40
"""Most Newton steps from float64 on. Each doubles the digits, but at a tangent, where it adds one bit."""

Number: TypeAlias = Any
"""An mpmath.mpf; mpmath has no types."""

Vector: TypeAlias = list[Number]


def dot(a: Vector, b: Vector) -> Number:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def along_ray(p: Vector, d: Vector, t: Number) -> Vector:
    """The point p + t d."""
    return [a + t * b for a, b in zip(p, d, strict=True)]


def exact_vector(mp: Any, numbers: Floats) -> Vector:
    """Numbers of float64, as they are."""
    return [mp.mpf(float(x)) for x in numbers]


def first_crossing(mp: Any, surface: Surface, p: Vector, d: Vector, s: int) -> Number | None:
    """Distance of the first crossing in the clear cylinder at which s (z - sag) rises from below 0; None without one.

    p, d: a point of the ray, from the vertex, in mm, and its direction of unit length; s is 1 for light that travels
    towards the sensor, -1 in reverse.
    """
    nearest = -dot(p, d)
    start = along_ray(p, d, nearest)
    way = _way_through(mp, surface, start, d)
    if way is None:
        return None
    for rough in _rises(surface, [float(x) for x in start], [float(x) for x in d], way, s):
        t = _polished(mp, surface, start, d, s, rough)
        if t is not None:
            return nearest + t
    return None


def _polished(mp: Any, surface: Surface, p: Vector, d: Vector, s: int, rough: float) -> Number | None:
    """The crossing next to one that float64 saw; None where float64 only took a hill's top for one."""
    t, close = mp.mpf(rough), mp.mpf(10) ** (8 - mp.dps)
    for _ in range(_POLISH):
        hit = along_ray(p, d, t)
        sag, by_r2, _ = exact_sag(mp, surface, hit)
        slope = d[2] - 2 * by_r2 * (hit[0] * d[0] + hit[1] * d[1])
        step = (hit[2] - sag) / slope if slope != 0 else mp.inf
        t -= step
        if abs(t - rough) > _BESIDE * (1 + abs(t)):
            return None
        if abs(step) <= close * (1 + abs(t)):
            return t if s * slope > 0 else None
    return None


def exact_sag(mp: Any, surface: Surface, hit: Vector) -> tuple[Number, Number, Number]:
    """The sag over the x and y of a point, and its first and second derivatives by r^2."""
    c, squash = 1 / mp.mpf(surface.radius), 1 + mp.mpf(surface.conic)
    r2 = hit[0] ** 2 + hit[1] ** 2
    w = mp.sqrt(1 - squash * c * c * r2)
    sag = [c * r2 / (1 + w), c / (2 * w), c**3 * squash / (4 * w**3)]
    for i, a in enumerate(surface.aspheric):
        n = i + 1
        sag[0] += mp.mpf(a) * r2**n
        sag[1] += n * mp.mpf(a) * r2 ** (n - 1)
        sag[2] += n * (n - 1) * mp.mpf(a) * r2 ** max(n - 2, 0)
    return sag[0], sag[1], sag[2]


def _way_through(mp: Any, surface: Surface, p: Vector, d: Vector) -> tuple[float, float] | None:
    """Entry and exit of a ray into the part of the clear cylinder that contains the surface."""
    tallest = 1.01 * float(np.abs(surface.sag(np.linspace(0, surface.semi_diameter, 1001))).max()) + 1e-300
    begin, end = -mp.inf, mp.inf
    if d[2] != 0:
        begin, end = sorted([(-tallest - p[2]) / d[2], (tallest - p[2]) / d[2]])
    sin2 = d[0] ** 2 + d[1] ** 2
    half, outside = p[0] * d[0] + p[1] * d[1], p[0] ** 2 + p[1] ** 2 - mp.mpf(surface.semi_diameter) ** 2
    if sin2 > 0:
        root2 = half * half - sin2 * outside
        if root2 < 0:
            return None
        begin, end = max(begin, (-half - mp.sqrt(root2)) / sin2), min(end, (-half + mp.sqrt(root2)) / sin2)
    elif outside > 0:
        return None
    return (float(begin), float(end)) if begin < end else None


def _rises(surface: Surface, p: list[float], d: list[float], way: tuple[float, float], s: int) -> Iterator[float]:
    """Distances from p at which the ray seems to come from below 0 to above, in float64."""
    t = np.linspace(*way, _SCAN + 1)
    above = _above(surface, p, d, s, t)
    # A hill below 0, or a valley above it, may cross 0 twice between three samples.
    size, side = np.abs(above), above > 0
    alike = (side[:-2] == side[1:-1]) & (side[1:-1] == side[2:])
    hills = 1 + np.flatnonzero(alike & (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]))
    # Near the vertex at all scales: a ray along the vertex plane crosses twice within any distance.
    close = np.geomspace(1e-300, 1.0, 301) * max(abs(way[0]), abs(way[1]))
    close = np.concatenate([-close, close])
    t = np.sort(
        np.concatenate([t, np.clip(close, *way), *(_summit(surface, p, d, s, t[i - 1], t[i + 1]) for i in hills)])
    )
    above = _above(surface, p, d, s, t)
    for i in np.flatnonzero((above[:-1] <= 0) & (above[1:] > 0)):
        low, high = float(t[i]), float(t[i + 1])
        while low < (middle := 0.5 * (low + high)) < high:
            if _above(surface, p, d, s, np.array([middle]))[0] > 0:
                high = middle
            else:
                low = middle
        yield low


def _summit(surface: Surface, p: list[float], d: list[float], s: int, low: float, high: float) -> Floats:
    """Places around the one where a ray comes closest to the surface, the closer the denser."""
    places = []
    for _ in range(_ZOOMS):
        t = np.linspace(low, high, _CLOSER + 1)
        places.append(t)
        nearest = int(np.abs(_above(surface, p, d, s, t)).argmin())
        low, high = float(t[max(nearest - 1, 0)]), float(t[min(nearest + 1, _CLOSER)])
    return np.concatenate(places)


def _above(surface: Surface, p: list[float], d: list[float], s: int, t: Floats) -> Floats:
    r = np.minimum(np.hypot(p[0] + t * d[0], p[1] + t * d[1]), surface.semi_diameter)
    return np.asarray(s * (p[2] + t * d[2] - surface.sag(r)))
