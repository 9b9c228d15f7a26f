"""Rays for the stability study, chosen by where and how they meet a surface."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.surfaces.surface import Surface


def points_on(surface: Surface, rng: np.random.Generator, n: int, size: float | None = None) -> tuple[Floats, Floats]:
    """Points (n, 3) spread over a surface up to a distance from the axis, from its vertex, and unit normals there.

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


def cone(rng: np.random.Generator, n: int, widest: float) -> Floats:
    """Directions (n, 3), evenly over the cone of a half angle about +z, radians."""
    cos = rng.uniform(math.cos(widest), 1.0, n)
    if widest < 1e-3:
        # The cosine has lost what is left of such an angle.
        cos = np.cos(widest * np.sqrt(rng.uniform(0, 1, n)))
        sin = widest * np.sqrt(rng.uniform(0, 1, n))
    else:
        sin = np.sqrt(1 - cos * cos)
    azimuth = rng.uniform(0, 2 * np.pi, n)
    return np.column_stack([sin * np.cos(azimuth), sin * np.sin(azimuth), cos])


def inclined(rng: np.random.Generator, normals: Floats, cos_i: Floats) -> Floats:
    """Unit vectors at angles of given cosines against normals, in any plane of incidence."""
    aside = np.cross(normals, rng.normal(size=normals.shape))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    return np.asarray(cos_i[:, None] * normals + np.sqrt(1 - cos_i * cos_i)[:, None] * aside)


def through_points(
    lens: LensStack, which: int, points: Floats, along: Floats, *, distance: float, reverse: bool
) -> RayBundle:
    """Rays through points measured from the vertex of an element, from a distance in mm."""
    unit = along / np.linalg.norm(along, axis=1, keepdims=True) * (-1 if reverse else 1)
    return RayBundle(points + np.array([0, 0, lens.vertices[which]]) - distance * unit, unit)


def wild_rays(rng: np.random.Generator, n: int) -> RayBundle:
    """Rays of zeros, denormal, ordinary, huge, infinite and undefined numbers, in all positions."""
    tame = np.array([0.0, -0.0, 1.0, -3.0, -40.0, 1e-300, 5e-324, -5e-324, 1e-160])
    huge = np.array([1e9, -1e9, 1e150, -1e160, 1e300, -1e300, 1.7e308])
    numbers = np.concatenate([tame, huge, [math.inf, -math.inf, math.nan]])
    rows = rng.choice(numbers, (n, 6))
    # Most rays of all these numbers would be lost before anything is computed.
    rows[: n // 2] = rng.choice(np.concatenate([tame, huge]), (n // 2, 6))
    # Straight along the axis, from anywhere.
    rows[: n // 4, :2] = rng.choice(tame, (n // 4, 2))
    rows[: n // 4, 3:] = rng.choice([[0, 0, 1.0], [5e-324, 0, 1.0], [0, 1e-300, 1e300], [0, 0, -1.0]], n // 4)
    with np.errstate(all="ignore"):
        return RayBundle(rows[:, :3], rows[:, 3:])
