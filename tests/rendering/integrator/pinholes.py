"""Shared helpers of light transport tests: a pinhole camera, and radiance seen through it."""

import functools
import math

import numpy as np

import plenoptic as pl


def pinhole(half=0.2, pixels=8, opening=1e-4):
    """A camera without a lens, with a tiny opening, that looks along -z and sees tangents up to `half` to each side."""
    sensor = pl.Sensor(shape=(pixels, pixels), pixel_pitch=20.0 * half / pixels)
    return pl.PlenopticCamera(pl.no_lens(opening), sensor, stop_to_microlenses=10.0)


@functools.lru_cache(maxsize=64)
def sky(camera, samples, seed):
    """(H, W, C): radiance 1 everywhere, seen by the paths of any scene."""
    settings = {"replicates": 1, "truth": pl.Truth.NONE, "progress": False}
    return pl.render(pl.Scene([], background=1.0), camera, samples=samples, seed=seed, **settings).image


def radiance_once(scene, camera, samples=64, seed=0, **options):
    """(H, W, C) radiance; the noise of the camera cancels, since a sky of radiance 1 has the same rays."""
    settings = {"replicates": 1, "truth": pl.Truth.NONE, "progress": False, **options}
    shot = pl.render(scene, camera, samples=samples, seed=seed, **settings)
    assert shot.stats.nonfinite == 0 and np.isfinite(shot.image).all()
    return shot.image.astype(np.float64) / sky(camera, samples, seed)


def radiance(scene, camera, samples=256, seeds=16, **options):
    """(H, W, C) mean radiance and its standard error, from independent renderings."""
    shots = [radiance_once(scene, camera, samples, seed, **options) for seed in range(seeds)]
    return np.mean(shots, axis=0), np.std(shots, axis=0, ddof=1) / math.sqrt(seeds)


def flat(mesh):
    """The mesh without smooth normals."""
    return pl.Mesh(mesh.vertices, mesh.faces, mesh.material, uv=mesh.uv)


def fresnel(cosine, index):
    """Reflectance of unpolarised light at a surface to a medium of the index (M. Born and E. Wolf, section 1.5.2)."""
    inner = np.sqrt(1 - (1 - cosine**2) / index**2)
    s = (cosine - index * inner) / (cosine + index * inner)
    p = (index * cosine - inner) / (index * cosine + inner)
    return 0.5 * (s * s + p * p)


def irradiance_of_polygon(places, normal, corners):
    """(n,) irradiance by a polygon of radiance 1 above the horizon: Lambert's formula.

    E = 1/2 sum over edges of (angle that the edge subtends) times (normal of its plane) . (normal of the receiver).
    """
    total = np.zeros(len(places))
    for first, second in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = (corner - places for corner in (first, second))
        a, b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (a, b))
        across = np.cross(a, b)
        sine = np.linalg.norm(across, axis=1)
        angle = np.arctan2(sine, np.sum(a * b, axis=1))
        total += angle * (across @ normal) / np.where(sine > 0, sine, 1)
    return np.abs(total) / 2
