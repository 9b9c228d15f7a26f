"""Search for bodies with media that touch, cross or are open, by rays through them: they meet media in wrong order."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.cache import PreparedScene, prepared_scene
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.geometry.kernels.interaction import fill_distances
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.materials.alpha_mask import NESTED, no_hits
from plenoptic.scene.materials.dielectric import Dielectric
from plenoptic.scene.scene import Scene
from plenoptic.scene.scene_record import build_record

_RAYS, _FEWEST, _STEPS = 64, 3, 32
"""Rays through a group of bodies, and those that must go wrong, as single ones may by rounding; hits of a ray."""
_MOST_BODIES, _MOST_GROUPS, _MOST_NAMED = 1024, 256, 8
"""Bodies that are compared, bodies and pairs that rays are sent to, and those of them that may be named."""
_MOST_TRIANGLES = 1 << 16
"""Triangles of the copies of a mesh."""
_BEYOND = 2.0**-18
"""Step of a ray to behind a surface, as a fraction of its coordinates: a few times the rounding of float32."""


def wrong_bodies(scene: Scene, times: Iterable[float] = (0.0,)) -> Iterator[str]:
    """Sentences on bodies with media that lie neither apart nor one within the other at any of some times.

    Instances count as their copies, up to 65536 triangles of each; one sentence is about one time.
    """
    for time in (
        times if any(isinstance(part, Instances) and part.motion is not None for part in scene.meshes) else (0.0,)
    ):
        if sentences := list(_wrong_bodies(scene, time)):
            yield from sentences
            return


def _copies(scene: Scene, time: float) -> list[tuple[Mesh | Instances, str]]:
    """Meshes of a scene and their names; copies in place of instances that are bodies, or move."""
    parts: list[tuple[Mesh | Instances, str]] = []
    for part, name in zip(scene.meshes, scene.object_names, strict=False):
        if isinstance(part, Mesh) or (part.motion is None and not isinstance(part.mesh.material, Dielectric)):
            parts.append((part, name))
            continue
        pose = np.eye(4)
        if part.motion is not None:
            pose[:3] = part.motion.matrices([time])[0]
        placed = dataclasses.replace(part, matrices=pose @ part.matrices, motion=None)
        if len(part) * len(part.mesh.faces) > _MOST_TRIANGLES:
            parts.append((placed, name))  # rays end there
        else:
            names = [f"copy {k} of {name}" for k in range(len(part))] if len(part) > 1 else [name]
            parts += zip(placed.meshes(), names, strict=True)
    return parts


def _wrong_bodies(scene: Scene, time: float) -> Iterator[str]:
    parts = _copies(scene, time)
    plain = [(k, mesh) for k, (mesh, _) in enumerate(parts) if isinstance(mesh, Mesh)]
    bodies = [(k, mesh) for k, mesh in plain if isinstance(mesh.material, Dielectric)][:_MOST_BODIES]
    filled = np.array([scene.medium is not None or mesh.material.row().fills for _, mesh in bodies], dtype=bool)
    if not filled.any():
        return
    meshes = tuple(mesh for mesh, _ in parts)
    if meshes == scene.meshes:
        prepared = prepared_scene(scene)
    else:
        prepared = PreparedScene(build_record(meshes, scene.lights, scene.background, medium=scene.medium)[0])
    glass, boxes = [k for k, _ in bodies], np.array([mesh.bounds for _, mesh in bodies])
    low, high = boxes[:, 0], boxes[:, 1]
    near = _below(low, high + _BEYOND * np.abs(boxes).max())
    pairs = np.argwhere(np.triu(near & near.T & (filled | filled[:, None]), 1))
    within = _below(low, low) & _below(-high, -high)
    nested = (within | within.T)[tuple(pairs.T)]
    deepest = NESTED - (scene.medium is not None)
    deep = [np.flatnonzero(column).tolist() for column in within.T if column.sum() > deepest][:1]
    unlikely = [*pairs[nested].tolist(), *np.flatnonzero(filled)[:, None].tolist()]
    np.random.default_rng(0).shuffle(unlikely)
    groups = [*pairs[~nested].tolist(), *unlikely][:_MOST_GROUPS]
    probe = _BodyProbe(prepared, glass, boxes)
    each = max(1, _RAYS // len(groups))
    suspects = np.flatnonzero(
        (probe.depths([g for g in groups for _ in range(each)]) < 0).reshape(-1, each).any(axis=1)
    )
    wrong = [groups[k] for k in suspects[:_MOST_NAMED] if (probe.rays(groups[k]) < 0).sum() >= _FEWEST]
    in_pairs = {k for group in wrong if len(group) > 1 for k in group}
    if wrong := [group for group in wrong if len(group) > 1 or group[0] not in in_pairs]:
        names = [parts[k][1] for k in glass]
        listed = "; ".join(" and ".join(names[k] for k in group) for group in wrong)
        yield (
            f"media of bodies that are open, touch or cross weaken light wrongly: {listed}; close each surface, leave "
            "a gap between bodies, or put one within the other"
        )
    elif any((probe.rays(group) > deepest).sum() >= _FEWEST for group in deep):
        yield f"more than {deepest} bodies lie one within the other, and rays hold {NESTED} media; leave some out"


def _below(a: Floats, b: Floats) -> NDArray[np.bool_]:
    """(n, n): True if no coordinate of point i of a (n, 3) exceeds that of point j of b."""
    return np.asarray(np.all([np.less_equal.outer(a[:, k], b[:, k]) for k in range(3)], axis=0))


class _BodyProbe:
    """Rays from outside groups of bodies through the place where the boxes of all of them meet."""

    def __init__(self, prepared: PreparedScene, glass: list[int], boxes: Floats) -> None:
        self._record, self._intersector, self._boxes = prepared.record, prepared.intersector, boxes
        self._random, self._body = np.random.default_rng(1), {mesh: k for k, mesh in enumerate(glass)}

    def rays(self, group: list[int]) -> Floats:
        """Depths (rays,) of many rays through one group."""
        return self.depths([group] * _RAYS)

    def depths(self, groups: list[list[int]]) -> Floats:
        """Most bodies (n,) that lie one within the other on a ray through each group; -1 if their order is wrong."""
        record, intersector, n = self._record, self._intersector, len(groups)
        geometry, mesh_of = record.geometry, record.triangle_mesh
        assert geometry is not None and mesh_of is not None and intersector is not None
        low = np.array([self._boxes[group, 0].max(axis=0) for group in groups])
        high = np.array([self._boxes[group, 1].min(axis=0) for group in groups])
        radius = np.array([np.linalg.norm(np.ptp(self._boxes[g].reshape(-1, 3), axis=0)) for g in groups])
        direction = self._random.normal(size=(n, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        start = low + self._random.random((n, 3)) * (high - low) - radius[:, None] * direction
        rays, depths, which = np.concatenate([start, direction], axis=1), np.zeros(n), np.arange(n)
        stacks: list[list[int]] = [[] for _ in groups]
        covered = np.zeros(n)
        # Rays come from outside; a single body may be a bubble, whose faces wind inwards.
        outside = [None if len(group) == 1 else True for group in groups]
        for _ in range(_STEPS):
            hits, distance, lanes = no_hits(record, len(which)), np.empty(len(which)), rays[which]
            intersector.fill_closest(hits, lanes)
            fill_distances(distance, hits, lanes, geometry)
            a, b, c = np.moveaxis(geometry.vertices[geometry.triangles[hits.triangle]], 1, 0)
            is_front = (np.einsum("ij,ij->i", np.cross(b - a, c - a), lanes[:, 3:]) < 0.0).tolist()
            goes_on = np.zeros(len(which), dtype=bool)
            covered[which] += distance
            for j, (ray, triangle) in enumerate(zip(which.tolist(), hits.triangle.tolist(), strict=True)):
                stack, body = stacks[ray], self._body.get(int(mesh_of[triangle]))
                if triangle < 0 or 2.0 * radius[ray] < covered[ray] < np.inf:
                    depths[ray] = -1 if stack else depths[ray]
                    continue
                # Other surfaces may hide one of glass that coincides with them: the ray tells no more.
                goes_on[j] = body is not None and np.isfinite(distance[j])
                if body not in groups[ray] or not goes_on[j]:
                    continue
                outside[ray] = is_front[j] if outside[ray] is None else outside[ray]
                material = int(geometry.triangle_material[triangle])
                if is_front[j] == outside[ray]:
                    stack.append(material)
                    depths[ray] = max(depths[ray], len(stack))
                elif stack and stack[-1] == material:
                    stack.pop()
                else:
                    depths[ray], goes_on[j] = -1, False
            which, lanes, distance = which[goes_on], lanes[goes_on], distance[goes_on]
            if not len(which):
                break
            step = _BEYOND * (radius[which] + np.abs(lanes[:, :3] - geometry.middle).max(axis=1))
            rays[which, :3] += (distance + step)[:, None] * lanes[:, 3:]
        return depths
