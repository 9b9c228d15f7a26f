"""Following rays through surfaces that are not there for all paths."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.geometry.accel import Intersector
from plenoptic.scene.geometry.geometry_records import Hits, PathKeys, Shadows
from plenoptic.scene.geometry.kernels.interaction import fill_distances, meets_back
from plenoptic.scene.materials.kernels.alpha import advance_rays
from plenoptic.scene.scene_record import SceneRecord

SALTS = 1 << 10
"""Most transparent surfaces on one path before its random numbers repeat."""

NESTED = 4
"""Bodies of glass, one in the other, that a path knows it is in."""


def skip_transparent(
    scene: SceneRecord, intersector: Intersector, rays: Floats, hits: Hits, keys: PathKeys | None = None, salt: int = 0
) -> None:
    """Move rays on through transparent surfaces to the first opaque one, and return the distances.

    Without keys, surfaces of opacity 0.5 or more are opaque.
    """
    assert hits.travelled is not None
    hits.travelled[:] = 0.0
    again, which = np.empty(len(rays), dtype=np.int64), np.arange(len(rays))
    while len(which):
        keys = None if keys is None else keys._replace(salt=salt)
        passed = advance_rays(again, rays, hits, which, keys, None, scene.geometry, scene.alpha)
        which, salt = again[:passed].copy(), salt + 1
        _meet_again(scene, intersector, hits, rays, which)


def attenuate_shadows(
    scene: SceneRecord, intersector: Intersector, rays: Floats, blocked: NDArray[np.uint8], shadow_radiance: Floats
) -> None:
    """Trace shadow rays to their ends: mark the occluded ones and attenuate the others."""
    blocked[:] = 0
    hits, shadows = no_hits(scene, len(rays)), Shadows(blocked, shadow_radiance)
    again, which = np.empty(len(rays), dtype=np.int64), np.arange(len(rays))
    intersector.fill_closest(hits, rays)
    while len(which):
        passed = advance_rays(again, rays, hits, which, None, shadows, scene.geometry, scene.alpha)
        which = again[:passed].copy()
        _meet_again(scene, intersector, hits, rays, which)


def follow_layers(
    scene: SceneRecord, intersector: Intersector, rays: Floats, hits: Hits
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int32], Floats]]:
    """Indices of rays, the triangles that they hit, and the fractions of their light from there, layer by layer.

    Moves the rays (n, 6), whose closest hits are given.
    """
    assert scene.geometry is not None
    rays[:, 3:] *= scene.lights.far + np.abs(rays[:, :3] - scene.geometry.middle).sum(axis=1, keepdims=True)
    shadows = Shadows(np.zeros(len(rays), dtype=np.uint8), np.ones((len(rays), 1)))
    again, which = np.empty(len(rays), dtype=np.int64), np.flatnonzero(hits.triangle >= 0)
    while len(which):
        before = shadows.radiance[which, 0]
        passed = advance_rays(again, rays, hits, which, None, shadows, scene.geometry, scene.alpha)
        after = np.where(shadows.blocked[which] > 0, 0.0, shadows.radiance[which, 0])
        yield which, hits.triangle[which], before - after
        _meet_again(scene, intersector, hits, rays, again[:passed].copy())
        which = again[:passed][hits.triangle[again[:passed]] >= 0]


def media_at(scene: SceneRecord, intersector: Intersector | None, point: Floats) -> NDArray[np.int32]:
    """(NESTED,): materials of the bodies of glass that a point is in, the outermost first; -1 behind the last.

    Those are the bodies that a ray from there leaves without having entered them, and around all the scene's medium.
    """
    media = np.full(NESTED, -1, dtype=np.int32)
    outer = [] if scene.surrounding is None else [scene.surrounding]
    media[: len(outer)] = outer
    glass, geometry = None if scene.bsdf is None else scene.bsdf.glass_index, scene.geometry
    if glass is None or geometry is None or intersector is None:
        return media
    # A direction that no mesh has edges along.
    ray = np.array([[*point, 0.36, 0.48, 0.8]])
    hits, reached = no_hits(scene, 1), np.empty(1)
    entered: list[int] = []
    left: list[int] = []
    for _ in range(SALTS):
        intersector.fill_closest(hits, ray)
        if hits.triangle[0] < 0:
            break
        material = int(geometry.triangle_material[hits.triangle[0]])
        if glass[material, 0] > 0:
            if not meets_back(ray, hits, geometry):
                entered.append(material)
            elif material in entered:
                entered.remove(material)
            else:
                left.append(material)
        fill_distances(reached, hits, ray, geometry)
        step = float(reached[0]) if np.isfinite(reached[0]) else 0.0
        ray[0, :3] += (step + 1e-5 * (step + np.abs(ray[0, :3]).max())) * ray[0, 3:]
    outermost_first = [*outer, *left[::-1]][:NESTED]
    media[: len(outermost_first)] = outermost_first
    return media


def no_hits(scene: SceneRecord, n: int) -> Hits:
    """Arrays for n hits."""
    instance = None if scene.instances is None else np.full(n, -1, dtype=np.int32)
    travelled = None if scene.alpha is None else np.zeros(n)
    return Hits(np.full(n, -1, dtype=np.int32), instance, travelled)


def _meet_again(
    scene: SceneRecord, intersector: Intersector, hits: Hits, rays: Floats, which: NDArray[np.int64]
) -> None:
    """Closest hits of some of the rays from their present origins."""
    if not len(which):
        return
    next_hits = no_hits(scene, len(which))
    intersector.fill_closest(next_hits, np.ascontiguousarray(rays[which]))
    hits.triangle[which] = next_hits.triangle
    if hits.instance is not None and next_hits.instance is not None:
        hits.instance[which] = next_hits.instance
