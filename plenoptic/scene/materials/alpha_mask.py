"""Following rays through surfaces that are not there for all paths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.compile import SceneTables
from plenoptic.scene.geometry.accel import Intersector

SALTS = 1 << 10
"""Surfaces that one path can meet without being stopped, until random numbers repeat."""

NESTED = 4
"""Bodies of glass, one in the other, that a path knows it is in."""


def pass_through(
    scene: SceneTables,
    intersector: Intersector,
    rays: NDArray[np.float64],
    travelled: NDArray[np.float64],
    hits: NDArray[np.int32],
    placed: NDArray[np.int32] | None,
    path_of: NDArray[np.int64] | None = None,
    path_key: NDArray[np.uint64] | None = None,
    path_index: NDArray[np.uint32] | None = None,
    salt: int = 0,
) -> None:
    """Move rays on until what they meet is there for their path, and say how far they have come by that.

    Without keys, surfaces are there that are opaque to half or more.
    """
    from plenoptic.scene.materials.kernels import opacity

    travelled[: len(rays)] = 0.0
    again, which = np.empty(len(rays), dtype=np.int64), np.arange(len(rays))
    while len(which):
        passed = opacity.fill_passed(
            again,
            rays,
            travelled,
            hits,
            placed,
            which,
            path_of,
            path_key,
            path_index,
            salt,
            *geometry(scene, intersector),
            *_opacities(scene),
        )
        which, salt = again[:passed].copy(), salt + 1
        _meet_again(intersector, hits, placed, rays, which)


def thin_out(
    scene: SceneTables,
    intersector: Intersector,
    rays: NDArray[np.float64],
    blocked: NDArray[np.uint8],
    shadow_radiance: NDArray[np.float64],
) -> None:
    """Follow shadow rays to their ends: mark those that are blocked and weaken those that are not."""
    from plenoptic.scene.materials.kernels import opacity

    blocked[:] = 0
    hits = np.full(len(rays), -1, dtype=np.int32)
    placed = None if scene.instances is None else np.full(len(rays), -1, dtype=np.int32)
    again, which = np.empty(len(rays), dtype=np.int64), np.arange(len(rays))
    intersector.fill_closest(hits, rays, coherent=False, placed=placed)
    while len(which):
        passed = opacity.fill_thinned(
            again,
            blocked,
            shadow_radiance,
            rays,
            hits,
            placed,
            which,
            *geometry(scene, intersector),
            *_opacities(scene),
        )
        which = again[:passed].copy()
        _meet_again(intersector, hits, placed, rays, which)


def media_at(scene: SceneTables, intersector: Intersector, point: NDArray[np.float64]) -> NDArray[np.int32]:
    """(NESTED,): materials of the bodies of glass that a point is in, the outermost first; -1 behind the last.

    Those are the bodies that a ray from there leaves without having entered them.
    """
    from plenoptic.scene.geometry.kernels import interaction

    media = np.full(NESTED, -1, dtype=np.int32)
    glass = scene.bsdf.glass_index
    if glass is None or scene.triangle_material is None:
        return media
    # A direction that no mesh has edges along.
    ray = np.array([[*point, 0.36, 0.48, 0.8]])
    hits, reached = np.empty(1, np.int32), np.empty(1)
    placed = None if scene.instances is None else np.empty(1, np.int32)
    corners = (scene.vertices, scene.triangles, intersector.placements)
    entered: list[int] = []
    left: list[int] = []
    for _ in range(SALTS):
        intersector.fill_closest(hits, ray, coherent=False, placed=placed)
        if hits[0] < 0:
            break
        material = int(scene.triangle_material[hits[0]])
        if glass[material, 0] > 0:
            if not interaction.behind(ray, hits[0], -1 if placed is None else placed[0], *corners):
                entered.append(material)
            elif material in entered:
                entered.remove(material)
            else:
                left.append(material)
        interaction.fill_distances(reached, hits, placed, ray, *corners)
        step = float(reached[0]) if np.isfinite(reached[0]) else 0.0
        ray[0, :3] += (step + 1e-5 * (step + np.abs(ray[0, :3]).max())) * ray[0, 3:]
    outermost_first = left[::-1][:NESTED]
    media[: len(outermost_first)] = outermost_first
    return media


def geometry(scene: SceneTables, intersector: Intersector):  # type: ignore[no-untyped-def]
    """What finding a point on a triangle, and how far off it rays must start, takes."""
    return (
        scene.vertices,
        scene.triangles,
        scene.triangle_material,
        scene.uv,
        intersector.placements,
        intersector.middle,
    )


def _opacities(scene: SceneTables):  # type: ignore[no-untyped-def]
    return scene.opacity, scene.cutoff, scene.opacity_texture, scene.texels, scene.texture_rows


def _meet_again(
    intersector: Intersector,
    hits: NDArray[np.int32],
    placed: NDArray[np.int32] | None,
    rays: NDArray[np.float64],
    which: NDArray[np.int64],
) -> None:
    """Find what some of the rays meet from where they are now."""
    if not len(which):
        return
    some = np.full(len(which), -1, dtype=np.int32)
    somewhere = None if placed is None else np.full(len(which), -1, dtype=np.int32)
    intersector.fill_closest(some, np.ascontiguousarray(rays[which]), coherent=False, placed=somewhere)
    hits[which] = some
    if placed is not None and somewhere is not None:
        placed[which] = somewhere
