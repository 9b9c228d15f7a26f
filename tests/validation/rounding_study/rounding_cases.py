"""Lenses, and rays through them, that are hard for floating-point numbers."""

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import plenoptic as pl
from plenoptic.optics.lens.trace import trace_part

from .exact_trace import DIGITS
from .rounding_bounds import Law

GLASS = 1.5
INTO_GLASS = (1.0, GLASS)
"""Indices before and behind."""

WIDE = 1e9
"""Semi-diameter in mm of elements that clip nothing."""

WILD_DIGITS = 1000
"""The square of 1.7e308 and 5e-324 go into one number."""


class Setup(NamedTuple):
    """Rays through elements first ... last of a lens."""

    lens: pl.LensStack
    rays: pl.RayBundle
    first: int
    last: int
    reverse: bool


class Case(NamedTuple):
    """One row of the table."""

    name: str
    setup: Callable[[np.random.Generator, int], Setup]
    law: Law = Law.SURFACES
    digits: int = DIGITS


def rounding_cases():
    """All cases, in the order of the table."""
    return (*_lenses(), *_spheres(), *_critical_angles(), *_beyond_the_equator(), *_conics_and_aspheres())


def single(surface, before, behind, *, iris=0.0):
    """Lens of a surface between two indices, the iris `iris` mm behind it; and the surface's index in the lens."""
    thickness = iris if before == 1.0 else 0.0
    front = [pl.Surface(math.inf, 1.0, pl.ConstantMedium(before), semi_diameter=WIDE)] if before != 1.0 else []
    middle = dataclasses.replace(
        surface, thickness=thickness if behind == 1.0 else iris, medium=pl.ConstantMedium(behind)
    )
    rear = pl.Surface(math.inf, semi_diameter=WIDE)
    return pl.LensStack([*front, middle, pl.CircularStop(WIDE, 1.0), rear]), len(front)


def points_on(surface, rng, n, size=None):
    """Points (n, 3) over a surface up to a distance from the axis, from its vertex, and unit normals there.

    On a surface that goes on beyond its equator, over its whole cap.
    """
    azimuth = rng.uniform(0, 2 * np.pi, n)
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    if surface.depth is not None:
        cos = 1 - rng.uniform(0, surface.depth / abs(surface.radius), n)
        sin = np.sqrt(1 - cos * cos)
        normals = np.column_stack([-np.sign(surface.radius) * sin[:, None] * around, cos])
        return -surface.radius * (normals - [0, 0, 1.0]), normals
    r = (surface.semi_diameter if size is None else size) * np.sqrt(rng.uniform(0, 1, n))
    slope = surface.slope(r)
    normals = np.column_stack([-slope[:, None] * around, np.ones(n)]) / np.hypot(1, slope)[:, None]
    return np.column_stack([r[:, None] * around, surface.sag(r)]), normals


def cone(rng, n, half_angle):
    """Directions (n, 3), uniform over the cone of a half angle about +z, radians."""
    cos = rng.uniform(math.cos(half_angle), 1.0, n)
    if half_angle < 1e-3:
        # The cosine has lost the digits of such an angle.
        cos = np.cos(half_angle * np.sqrt(rng.uniform(0, 1, n)))
        sin = half_angle * np.sqrt(rng.uniform(0, 1, n))
    else:
        sin = np.sqrt(1 - cos * cos)
    azimuth = rng.uniform(0, 2 * np.pi, n)
    return np.column_stack([sin * np.cos(azimuth), sin * np.sin(azimuth), cos])


def inclined(rng, normals, cos_i):
    """Unit vectors at angles of given cosines against normals, in any plane of incidence."""
    across = np.cross(normals, rng.normal(size=normals.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return cos_i[:, None] * normals + np.sqrt(1 - cos_i * cos_i)[:, None] * across


def through_points(lens, k, points, directions, *, distance, reverse=False):
    """Rays through points measured from the vertex of element k, from a distance in mm."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True) * (-1 if reverse else 1)
    return pl.RayBundle(points + np.array([0, 0, lens.vertices[k]]) - distance * unit, unit)


def _through(surface, indices, points, directions, *, distance=10.0, reverse=False, iris=0.0):
    """Rays through points of a single surface."""
    lens, k = single(surface, *indices, iris=iris)
    return Setup(lens, through_points(lens, k, points, directions, distance=distance, reverse=reverse), k, k, reverse)


def _aimed(surface, indices, rng, n, *, half_angle=1.2, size=None, **aim):
    """Rays within a cone about the axis, through points of a surface."""
    points, _ = points_on(surface, rng, n, size)
    return _through(surface, indices, points, cone(rng, n, half_angle), **aim)


def _one_way(name, surface, indices=INTO_GLASS, **aim):
    return Case(name, partial(_aimed, surface, indices, **aim))


def _both_ways(name, surface, **aim):
    back = _one_way(f"{name}, in reverse", surface, INTO_GLASS[::-1], reverse=True, **aim)
    return [_one_way(name, surface, **aim), back]


def _there_and_back(name, setup, *held: Any):
    back = Case(f"{name}, in reverse", partial(setup, reverse=True), *held)
    return [Case(name, partial(setup, reverse=False), *held), back]


def _lenses():
    return [
        *_there_and_back("double Gauss, full field", _double_gauss, Law.LENS),
        Case("radius 1e9, then 1e-3, scene 1 km away", partial(_chain, reverse=False)),
        Case("radius 1e-3, then 1e9, in reverse", partial(_chain, reverse=True)),
        Case("plate of index 1000", _plate),
        *_there_and_back("wild numbers, double Gauss", _wild_through_lens, Law.WILD, WILD_DIGITS),
        Case("wild numbers, conic", partial(_wild_on_surface, ()), Law.WILD, WILD_DIGITS),
        Case("wild numbers, asphere", partial(_wild_on_surface, (0.0, 1e-5)), Law.WILD, WILD_DIGITS),
    ]


def _double_gauss(rng, n, *, reverse):
    lens = pl.load_lens("double-gauss-100mm-f2")
    pupils = pl.paraxial.cardinal_points(lens)
    z, reach, pupil = (123.3, 25.0, pupils.exit_pupil) if reverse else (-404.0, 90.0, pupils.entrance_pupil)
    start = np.column_stack([rng.uniform(-reach, reach, (n, 2)), np.full(n, z)])
    aim = np.column_stack([rng.uniform(-20.0, 20.0, (n, 2)), np.full(n, pupil)])
    return Setup(lens, pl.RayBundle(start, aim - start), 0, len(lens.elements) - 1, reverse)


def _chain(rng, n, *, reverse):
    """A lens of almost no power, and a microlens of a micrometre 100 mm behind its iris."""
    glass = pl.ConstantMedium(1.6)
    microlens = pl.Surface(1e-3, 2e-3, glass, semi_diameter=1e-3)
    front = [pl.Surface(1e9, 4.0, glass, semi_diameter=25.0), pl.Surface(-1e9, 6.0, semi_diameter=25.0)]
    lens = pl.LensStack([*front, pl.CircularStop(25.0, 100.0), microlens, pl.Surface(math.inf, semi_diameter=1.0)])
    points, _ = points_on(microlens, rng, n, 0.9e-3)
    rays = through_points(lens, 3, points, cone(rng, n, 0.2), distance=50.0 if reverse else 0.0, reverse=True)
    if not reverse:
        # Traced from behind: the lens shifts rays by many diameters of the microlens.
        ahead = trace_part(lens, rays, 0, 2, reverse=True)
        rays = pl.RayBundle(ahead.at_z(-1e6), -ahead.direction)
    return Setup(lens, rays, 0, 4, reverse)


def _plate(rng, n):
    plate = [pl.Surface(math.inf, 3.0, pl.ConstantMedium(1000.0), semi_diameter=WIDE)]
    lens = pl.LensStack([pl.CircularStop(WIDE), *plate, pl.Surface(math.inf, semi_diameter=WIDE)])
    points = np.column_stack([rng.uniform(-20, 20, (n, 2)), np.zeros(n)])
    return Setup(lens, through_points(lens, 1, points, cone(rng, n, 1.5), distance=10.0), 1, 2, False)


def _wild_rays(rng, n):
    """Rays of zeros, denormal, ordinary, huge, infinite and undefined numbers, in all positions."""
    tame = np.array([0.0, -0.0, 1.0, -3.0, -40.0, 1e-300, 5e-324, -5e-324, 1e-160])
    huge = np.array([1e9, -1e9, 1e150, -1e160, 1e300, -1e300, 1.7e308])
    rows = rng.choice(np.concatenate([tame, huge, [math.inf, -math.inf, math.nan]]), (n, 6))
    # Most rays of all these numbers would be lost before anything is computed.
    rows[: n // 2] = rng.choice(np.concatenate([tame, huge]), (n // 2, 6))
    # Straight along the axis, from anywhere.
    rows[: n // 4, :2] = rng.choice(tame, (n // 4, 2))
    rows[: n // 4, 3:] = rng.choice([[0, 0, 1.0], [5e-324, 0, 1.0], [0, 1e-300, 1e300], [0, 0, -1.0]], n // 4)
    with np.errstate(all="ignore"):
        return pl.RayBundle(rows[:, :3], rows[:, 3:])


def _wild_through_lens(rng, n, *, reverse):
    lens = pl.load_lens("double-gauss-100mm-f2")
    return Setup(lens, _wild_rays(rng, n), 0, len(lens.elements) - 1, reverse)


def _wild_on_surface(aspheric, rng, n):
    lens, k = single(pl.Surface(50.0, semi_diameter=30.0, conic=-1.0, aspheric=aspheric), 1.0, GLASS)
    return Setup(lens, _wild_rays(rng, n), k, k, False)


def _spheres():
    sphere, flat = pl.Surface(50.0, semi_diameter=45.0), pl.Surface(1e9, semi_diameter=20.0)
    tiny, plane = pl.Surface(1e-3, semi_diameter=1e-3), pl.Surface(math.inf, semi_diameter=50.0)
    return [
        *_both_ways("radius 50", sphere),
        _one_way("radius -50", pl.Surface(-50.0, semi_diameter=45.0)),
        _one_way("radius 50, vertex 123 mm before the iris", sphere, iris=123.3),
        _one_way("radius 1e9", flat),
        _one_way("radius -1e9, in reverse", pl.Surface(-1e9, semi_diameter=20.0), reverse=True),
        *_both_ways("radius 1e-3", tiny, distance=0.1),
        _one_way("radius 1e-3, vertex 123 mm before the iris", tiny, iris=123.3),
        _one_way("origin 1e6 mm away", sphere, distance=1e6),
        _one_way("origin 1e9 mm away", sphere, distance=1e9),
        _one_way("origin 1e9 mm away, radius 1e9", flat, distance=1e9),
        _one_way("near the axis, 1e-4", sphere, half_angle=1e-4, size=1e-4),
        *_both_ways("plane", plane),
        _one_way("index ratio 1 + 1e-12", sphere, (1.0, 1.0 + 1e-12)),
        _one_way("index ratio 1 - 1e-12", sphere, (1.0 + 1e-12, 1.0)),
        _one_way("index 1000", sphere, (1.0, 1000.0)),
        Case("backward rays: the wrong way", partial(_wrong_way, sphere)),
        Case("backward rays: the wrong way, plane", partial(_wrong_way, plane)),
        Case("miss", _missing),
        Case("exact tangent", _tangent, Law.TANGENT),
        *(Case(f"grazing, cos i 1e-{k}", partial(_grazing, 10.0**-k)) for k in range(2, 8)),
    ]


def _wrong_way(surface, rng, n):
    return _aimed(surface, INTO_GLASS, rng, n, half_angle=0.5, size=20.0, reverse=True)._replace(reverse=False)


def _missing(rng, n):
    """Rays that pass a sphere at 1 + 1e-9 to 3 radii from its centre."""
    sphere = pl.Surface(10.0, semi_diameter=10.0)
    directions = cone(rng, n, 1.5)
    across = inclined(rng, directions, np.zeros(n)) * (1 + 10 ** rng.uniform(-9, 0.3, n))[:, None]
    points = sphere.radius * (across + np.array([0, 0, 1.0]))
    return _through(sphere, INTO_GLASS, points, directions, distance=20.0)


def _tangent(rng, n):
    """Half of the rays touch the sphere exactly; the others to rounding, in all directions."""
    sphere = pl.Surface(5.0, semi_diameter=5.0)
    points, normals = points_on(sphere, rng, n)
    directions = inclined(rng, normals, np.zeros(n))
    # 3, 4, 5: points of the sphere, and tangents there, that float64 has exactly.
    exact = np.array([[3.0, 0, 1], [0, 3, 1], [4, 0, 2], [0, -4, 2], [5, 0, 5], [3, 4, 5], [0, 0, 0], [0, 0, 0]])
    tangents = np.array([[0, 1.0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1], [0, 0, 1], [1, 0, 0], [0, -1, 0]])
    chosen = rng.integers(len(exact), size=n // 2)
    points[: n // 2], directions[: n // 2] = exact[chosen], tangents[chosen]
    return _through(sphere, INTO_GLASS, points, directions, distance=8.0)


def _grazing(cos_i, rng, n):
    sphere = pl.Surface(10.0, semi_diameter=10.0)
    points, normals = points_on(sphere, rng, n, 9.0)
    return _through(sphere, INTO_GLASS, points, inclined(rng, normals, np.full(n, cos_i)), distance=3.0)


def _critical_angles():
    plane, sphere = pl.Surface(math.inf, semi_diameter=50.0), pl.Surface(-50.0, semi_diameter=45.0)
    return [
        Case("total reflection, 1e-1 to 1e-16 beside it, plane", partial(_critical, plane, 1.5)),
        Case("total reflection, sphere", partial(_critical, sphere, 1.5)),
        Case("total reflection, sphere, index 3", partial(_critical, sphere, 3.0)),
    ]


def _critical(surface, index, rng, n):
    """Sines of incidence on both sides of the critical one, uniform in the logarithm of the difference."""
    excess = 10 ** rng.uniform(-16, -1, n) * rng.choice([-1.0, 1.0], n)
    sin_i = (1 + excess) / index
    points, normals = points_on(surface, rng, n, 30.0)
    return _through(surface, (index, 1.0), points, inclined(rng, normals, np.sqrt(1 - sin_i * sin_i)))


def _beyond_the_equator():
    front, rear = (pl.Surface(r, semi_diameter=10.0, depth=17.0) for r in (10.0, -10.0))
    return [
        *_there_and_back("hyper-hemisphere", partial(_from_all_sides, front, INTO_GLASS)),
        *_there_and_back("hyper-hemisphere behind glass", partial(_from_all_sides, rear, INTO_GLASS[::-1])),
        *_there_and_back("ball lens", _ball),
    ]


def _from_all_sides(surface, indices, rng, n, *, reverse):
    """Rays from all sides through the cap, some of them against the axis."""
    points, normals = points_on(surface, rng, n)
    directions = inclined(rng, normals, rng.uniform(0.05, 1.0, n))
    return _through(surface, indices, points, directions, distance=30.0, reverse=reverse)


def _ball(rng, n, *, reverse):
    ball = [pl.Surface(10.0, 20.0, pl.ConstantMedium(GLASS), semi_diameter=10.0), pl.Surface(-10.0, semi_diameter=10.0)]
    lens = pl.LensStack([pl.CircularStop(WIDE), *ball])
    k = 2 if reverse else 1
    points, normals = points_on(ball[k - 1], rng, n)
    directions = inclined(rng, normals, rng.uniform(0.05, 1.0, n))
    return Setup(lens, through_points(lens, k, points, directions, distance=40.0, reverse=reverse), 1, 2, reverse)


def _conics_and_aspheres():
    parabola, steep = (pl.Surface(50.0, semi_diameter=r, conic=k) for r, k in ((45.0, -1.0), (28.0, 2.0)))
    usual = pl.Surface(50.0, semi_diameter=25.0, conic=-1.0, aspheric=(0.0, 1e-6, -2e-9))
    strong = pl.Surface(20.0, semi_diameter=4.5, aspheric=(0.0, -4e-3, 4e-4, -1e-5))
    ring = pl.Surface(math.inf, semi_diameter=2.5, aspheric=(-0.2, 0.05))
    gull = pl.Surface(math.inf, semi_diameter=3.0, aspheric=(0.5, -0.1))
    ripples = pl.Surface(30.0, semi_diameter=3.4, aspheric=(0.3, -0.2, 0.035, -0.0018))
    return [
        *_both_ways("conic -1", parabola),
        *_both_ways("conic -3", pl.Surface(-50.0, semi_diameter=60.0, conic=-3.0)),
        *_both_ways("conic +2", steep),
        _one_way("conic -1, origin 1e9 mm away", parabola, distance=1e9),
        _one_way("conic +2, vertex 123 mm before the iris", steep, iris=123.3),
        *_both_ways("asphere", usual),
        _one_way("asphere, origin 1e9 mm away", usual, distance=1e9),
        *_both_ways("strong asphere", strong, half_angle=1.55),
        *_both_ways("asphere crossed several times: a ring", ring, half_angle=1.55),
        *_both_ways("asphere crossed several times: gull wings", gull, half_angle=1.55),
        *_both_ways("asphere crossed several times: ripples", ripples, half_angle=1.55),
        _one_way("asphere up to its equator", pl.Surface(10.0, semi_diameter=10.0, aspheric=(0.0, 1e-6))),
    ]
