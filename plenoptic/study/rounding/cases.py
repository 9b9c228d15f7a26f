"""Cases of the stability study: lenses, and rays through them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.glass.media import ConstantMedium
from plenoptic.optics.lens.files.library import load_lens
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import traced_part
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.surface import Surface
from plenoptic.study.rounding.bounds import Law
from plenoptic.study.rounding.rays import cone, inclined, points_on, through_points, wild_rays
from plenoptic.study.rounding.reference import DIGITS

GLASS = 1.5
"""Index where a case does not ask for another."""

_INTO_GLASS = (1.0, GLASS)
"""Indices before and behind."""

WIDE = 1e9
"""Semi-diameter in mm of what shall not clip."""

WILD_DIGITS = 1000
"""The square of 1.7e308 and 5e-324 go into one number."""


class Setup(NamedTuple):
    """Rays through a lens, or a part of it."""

    lens: LensStack
    rays: RayBundle
    first: int
    last: int
    reverse: bool


class StabilityCase(NamedTuple):
    """One row of the table."""

    name: str
    setup: Callable[[np.random.Generator, int], Setup]
    """From random numbers and how many rays are wanted."""
    law: Law = Law.SURFACES
    digits: int = DIGITS


def stability_cases() -> tuple[StabilityCase, ...]:
    """All cases, in the order of the table."""
    return (*_lenses(), *_spheres(), *_grazing(), *_reflections(), *_beyond_the_equator(), *_conics(), *_aspheres())


def single(surface: Surface, before: float, behind: float, *, iris: float = 0.0) -> tuple[LensStack, int]:
    """A lens in which a surface stands between two indices, the iris `iris` mm behind it; and the surface's place."""
    thickness = iris if before == 1.0 else 0.0
    front = [Surface(math.inf, 1.0, ConstantMedium(before), semi_diameter=WIDE)] if before != 1.0 else []
    made = dataclasses.replace(surface, thickness=thickness if behind == 1.0 else iris, medium=ConstantMedium(behind))
    stop = CircularStop(WIDE, 1.0)
    rear = Surface(math.inf, semi_diameter=WIDE)
    return LensStack([*front, made, stop, rear]), len(front)


class _Aim(NamedTuple):
    """Aim of rays at points of a surface."""

    distance: float = 10.0
    """From where they start to the point, mm."""
    widest: float = 1.2
    """Half angle of their cone about the axis."""
    size: float | None = None
    """Radius over which the points are spread; None: the semi-diameter."""
    reverse: bool = False
    iris: float = 0.0
    """How far it is behind the surface, mm."""


def _aimed(surface: Surface, indices: tuple[float, float], aim: _Aim, rng: np.random.Generator, n: int) -> Setup:
    """Rays within a cone about the axis, through points of a surface."""
    points, _ = points_on(surface, rng, n, aim.size)
    return _through(surface, indices, points, cone(rng, n, aim.widest), aim)


def _through(surface: Surface, indices: tuple[float, float], points: Floats, along: Floats, aim: _Aim) -> Setup:
    """Rays through points of a surface, measured from its vertex."""
    lens, k = single(surface, *indices, iris=aim.iris)
    rays = through_points(lens, k, points, along, distance=aim.distance, reverse=aim.reverse)
    return Setup(lens, rays, k, k, aim.reverse)


def _one_way(name: str, surface: Surface, indices: tuple[float, float] = _INTO_GLASS, **aim: Any) -> StabilityCase:
    return StabilityCase(name, partial(_aimed, surface, indices, _Aim(**aim)))


def _there_and_back(name: str, setup: Callable[..., Setup], *held: Any) -> list[StabilityCase]:
    return [
        StabilityCase(name, partial(setup, reverse=False), *held),
        StabilityCase(f"{name}, in reverse", partial(setup, reverse=True), *held),
    ]


def _both_ways(name: str, surface: Surface, **aim: Any) -> list[StabilityCase]:
    back = _one_way(f"{name}, in reverse", surface, _INTO_GLASS[::-1], reverse=True, **aim)
    return [_one_way(name, surface, **aim), back]


# Whole lenses


def _lenses() -> list[StabilityCase]:
    return [
        *_there_and_back("double Gauss, full field", _double_gauss, Law.LENS),
        StabilityCase("radius 1e9, then 1e-3, scene 1 km away", partial(_chain, reverse=False)),
        StabilityCase("radius 1e-3, then 1e9, in reverse", partial(_chain, reverse=True)),
        StabilityCase("plate of index 1000", _plate),
        *_there_and_back("wild numbers, double Gauss", _wild, Law.WILD, WILD_DIGITS),
        StabilityCase("wild numbers, conic", partial(_wild_single, ()), Law.WILD, WILD_DIGITS),
        StabilityCase("wild numbers, asphere", partial(_wild_single, (0.0, 1e-5)), Law.WILD, WILD_DIGITS),
    ]


def _double_gauss(rng: np.random.Generator, n: int, *, reverse: bool) -> Setup:
    lens = load_lens("double-gauss-100mm-f2")
    pupils = cardinal_points(lens)
    z, reach, pupil = (123.3, 25.0, pupils.exit_pupil) if reverse else (-404.0, 90.0, pupils.entrance_pupil)
    start = np.column_stack([rng.uniform(-reach, reach, (n, 2)), np.full(n, z)])
    aim = np.column_stack([rng.uniform(-20.0, 20.0, (n, 2)), np.full(n, pupil)])
    return Setup(lens, RayBundle(start, aim - start), 0, len(lens.elements) - 1, reverse)


def _chain(rng: np.random.Generator, n: int, *, reverse: bool) -> Setup:
    """A lens that hardly bends anything, and a microlens of a micrometre 100 mm behind its iris."""
    glass = ConstantMedium(1.6)
    microlens = Surface(1e-3, 2e-3, glass, semi_diameter=1e-3)
    lens = LensStack(
        [
            Surface(1e9, 4.0, glass, semi_diameter=25.0),
            Surface(-1e9, 6.0, semi_diameter=25.0),
            CircularStop(25.0, 100.0),
            microlens,
            Surface(math.inf, semi_diameter=1.0),
        ]
    )
    points, _ = points_on(microlens, rng, n, 0.9e-3)
    if reverse:
        rays = through_points(lens, 3, points, cone(rng, n, 0.2), distance=50.0, reverse=True)
    else:
        # Found from behind: the lens shifts rays by many diameters of the microlens.
        back = through_points(lens, 3, points, cone(rng, n, 0.2), distance=0.0, reverse=True)
        ahead = traced_part(lens, back, 0, 2, reverse=True)
        rays = RayBundle(ahead.at_z(-1e6), -ahead.direction)
    return Setup(lens, rays, 0, 4, reverse)


def _plate(rng: np.random.Generator, n: int) -> Setup:
    glass = ConstantMedium(1000.0)
    plate = [Surface(math.inf, 3.0, glass, semi_diameter=WIDE), Surface(math.inf, semi_diameter=WIDE)]
    lens = LensStack([CircularStop(WIDE), *plate])
    points = np.column_stack([rng.uniform(-20, 20, (n, 2)), np.zeros(n)])
    return Setup(lens, through_points(lens, 1, points, cone(rng, n, 1.5), distance=10.0, reverse=False), 1, 2, False)


def _wild(rng: np.random.Generator, n: int, *, reverse: bool) -> Setup:
    lens = load_lens("double-gauss-100mm-f2")
    return Setup(lens, wild_rays(rng, n), 0, len(lens.elements) - 1, reverse)


def _wild_single(aspheric: Sequence[float], rng: np.random.Generator, n: int) -> Setup:
    lens, k = single(Surface(50.0, semi_diameter=30.0, conic=-1.0, aspheric=aspheric), 1.0, GLASS)
    return Setup(lens, wild_rays(rng, n), k, k, False)


# Spheres and planes


def _spheres() -> list[StabilityCase]:
    ball, flat = Surface(50.0, semi_diameter=45.0), Surface(1e9, semi_diameter=20.0)
    tiny = Surface(1e-3, semi_diameter=1e-3)
    return [
        *_both_ways("radius 50", ball),
        _one_way("radius -50", Surface(-50.0, semi_diameter=45.0)),
        _one_way("radius 50, vertex 123 mm before the iris", ball, iris=123.3),
        _one_way("radius 1e9", flat),
        _one_way("radius -1e9, in reverse", Surface(-1e9, semi_diameter=20.0), reverse=True),
        *_both_ways("radius 1e-3", tiny, distance=0.1),
        _one_way("radius 1e-3, vertex 123 mm before the iris", tiny, iris=123.3),
        _one_way("origin 1e6 mm away", ball, distance=1e6),
        _one_way("origin 1e9 mm away", ball, distance=1e9),
        _one_way("origin 1e9 mm away, radius 1e9", flat, distance=1e9),
        _one_way("near the axis, 1e-4", ball, widest=1e-4, size=1e-4),
        *_both_ways("plane", Surface(math.inf, semi_diameter=50.0)),
        _one_way("index ratio 1 + 1e-12", ball, (1.0, 1.0 + 1e-12)),
        _one_way("index ratio 1 - 1e-12", ball, (1.0 + 1e-12, 1.0)),
        _one_way("index 1000", ball, (1.0, 1000.0)),
        StabilityCase("backward rays: the wrong way", partial(_wrong_way, ball)),
        StabilityCase(
            "backward rays: the wrong way, plane", partial(_wrong_way, Surface(math.inf, semi_diameter=50.0))
        ),
        StabilityCase("miss", _missing),
        StabilityCase("exact tangent", _tangent, Law.TANGENT),
    ]


def _wrong_way(surface: Surface, rng: np.random.Generator, n: int) -> Setup:
    made = _aimed(surface, _INTO_GLASS, _Aim(widest=0.5, size=20.0, reverse=True), rng, n)
    return made._replace(reverse=False)


def _missing(rng: np.random.Generator, n: int) -> Setup:
    """Rays that pass a sphere at 1 + 1e-9 to 3 radii from its centre."""
    sphere = Surface(10.0, semi_diameter=10.0)
    along = cone(rng, n, 1.5)
    aside = inclined(rng, along, np.zeros(n)) * (1 + 10 ** rng.uniform(-9, 0.3, n))[:, None]
    points = sphere.radius * (aside + np.array([0, 0, 1.0]))
    return _through(sphere, _INTO_GLASS, points, along, _Aim(20.0))


def _tangent(rng: np.random.Generator, n: int) -> Setup:
    """Half of the rays touch the sphere exactly; the others to rounding, in all directions."""
    sphere = Surface(5.0, semi_diameter=5.0)
    points, normals = points_on(sphere, rng, n)
    along = inclined(rng, normals, np.zeros(n))
    # 3, 4, 5: points of the sphere, and tangents there, that float64 has exactly.
    exact = np.array([[3.0, 0, 1], [0, 3, 1], [4, 0, 2], [0, -4, 2], [5, 0, 5], [3, 4, 5], [0, 0, 0], [0, 0, 0]])
    across = np.array([[0, 1.0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1], [0, 0, 1], [1, 0, 0], [0, -1, 0]])
    which = rng.integers(len(exact), size=n // 2)
    points[: n // 2], along[: n // 2] = exact[which], across[which]
    return _through(sphere, _INTO_GLASS, points, along, _Aim(8.0))


def _grazing() -> list[StabilityCase]:
    return [StabilityCase(f"grazing, cos i 1e-{k}", partial(_grazed, 10.0**-k)) for k in range(2, 8)]


def _grazed(cos_i: float, rng: np.random.Generator, n: int) -> Setup:
    sphere = Surface(10.0, semi_diameter=10.0)
    points, normals = points_on(sphere, rng, n, 9.0)
    return _through(sphere, _INTO_GLASS, points, inclined(rng, normals, np.full(n, cos_i)), _Aim(3.0))


# Total reflection


def _reflections() -> list[StabilityCase]:
    plane, sphere = Surface(math.inf, semi_diameter=50.0), Surface(-50.0, semi_diameter=45.0)
    return [
        StabilityCase("total reflection, 1e-1 to 1e-16 beside it, plane", partial(_critical, plane, 1.5)),
        StabilityCase("total reflection, sphere", partial(_critical, sphere, 1.5)),
        StabilityCase("total reflection, sphere, index 3", partial(_critical, sphere, 3.0)),
    ]


def _critical(surface: Surface, index: float, rng: np.random.Generator, n: int) -> Setup:
    """Sines of incidence on both sides of the critical one, as close as they are spread by their logarithm."""
    beside = 10 ** rng.uniform(-16, -1, n) * rng.choice([-1.0, 1.0], n)
    sin_i = (1 + beside) / index
    points, normals = points_on(surface, rng, n, 30.0)
    return _through(surface, (index, 1.0), points, inclined(rng, normals, np.sqrt(1 - sin_i * sin_i)), _Aim())


# Hyper-hemispheres and balls


def _beyond_the_equator() -> list[StabilityCase]:
    front, rear = (Surface(r, semi_diameter=10.0, depth=17.0) for r in (10.0, -10.0))
    return [
        *_there_and_back("hyper-hemisphere", partial(_all_around, front, _INTO_GLASS)),
        *_there_and_back("hyper-hemisphere behind glass", partial(_all_around, rear, _INTO_GLASS[::-1])),
        *_there_and_back("ball lens", _ball),
    ]


def _all_around(
    surface: Surface, indices: tuple[float, float], rng: np.random.Generator, n: int, *, reverse: bool
) -> Setup:
    """Rays from all sides through the cap the way the stack goes, some of them against the axis."""
    points, normals = points_on(surface, rng, n)
    along = inclined(rng, normals, rng.uniform(0.05, 1.0, n))
    return _through(surface, indices, points, along, _Aim(30.0, reverse=reverse))


def _ball(rng: np.random.Generator, n: int, *, reverse: bool) -> Setup:
    ball = [Surface(10.0, 20.0, ConstantMedium(GLASS), semi_diameter=10.0), Surface(-10.0, semi_diameter=10.0)]
    lens = LensStack([CircularStop(WIDE), *ball])
    k = 2 if reverse else 1
    points, normals = points_on(ball[k - 1], rng, n)
    along = inclined(rng, normals, rng.uniform(0.05, 1.0, n))
    return Setup(lens, through_points(lens, k, points, along, distance=40.0, reverse=reverse), 1, 2, reverse)


# Conics and aspheres


def _conics() -> list[StabilityCase]:
    steep = Surface(50.0, semi_diameter=28.0, conic=2.0)
    return [
        *_both_ways("conic -1", Surface(50.0, semi_diameter=45.0, conic=-1.0)),
        *_both_ways("conic -3", Surface(-50.0, semi_diameter=60.0, conic=-3.0)),
        *_both_ways("conic +2", steep),
        _one_way("conic -1, origin 1e9 mm away", Surface(50.0, semi_diameter=45.0, conic=-1.0), distance=1e9),
        _one_way("conic +2, vertex 123 mm before the iris", steep, iris=123.3),
    ]


def _aspheres() -> list[StabilityCase]:
    usual = Surface(50.0, semi_diameter=25.0, conic=-1.0, aspheric=(0.0, 1e-6, -2e-9))
    strong = Surface(20.0, semi_diameter=4.5, aspheric=(0.0, -4e-3, 4e-4, -1e-5))
    ring = Surface(math.inf, semi_diameter=2.5, aspheric=(-0.2, 0.05))
    gull = Surface(math.inf, semi_diameter=3.0, aspheric=(0.5, -0.1))
    ripples = Surface(30.0, semi_diameter=3.4, aspheric=(0.3, -0.2, 0.035, -0.0018))
    equator = Surface(10.0, semi_diameter=10.0, aspheric=(0.0, 1e-6))
    return [
        *_both_ways("asphere", usual),
        _one_way("asphere, origin 1e9 mm away", usual, distance=1e9),
        *_both_ways("strong asphere", strong, widest=1.55),
        *_both_ways("asphere crossed several times: a ring", ring, widest=1.55),
        *_both_ways("asphere crossed several times: gull wings", gull, widest=1.55),
        *_both_ways("asphere crossed several times: ripples", ripples, widest=1.55),
        _one_way("asphere up to its equator", equator),
    ]
