"""Tree of a glTF scene: objects and their poses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import FileError
from plenoptic.scene.files.gltf.file import GltfFile, entry_of

PLACE = 700
"""Bytes that a place costs; see `Instances`."""
_IDENTITY = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}


class PlacedNode(NamedTuple):
    """A node of the tree and its frame: `matrix` (4, 4) takes its own coordinates to the world, in the file's unit."""

    described: Mapping[str, Any]
    matrix: Floats


def placed_nodes(file: GltfFile) -> list[PlacedNode]:
    """All nodes of the scene that a file shows first, parents before their children, in the order of the file.

    A `FileError` for a node that hangs on two others, or on itself.
    """
    nodes = [file.entry("nodes", number) for number in range(len(file.header.get("nodes", ())))]
    above = _parents(nodes)
    local, placed = _local(nodes), []
    waiting = [(number, np.eye(4)) for number in reversed(_roots(file, above))]
    while waiting:
        number, frame = waiting.pop()
        matrix = frame @ local[number]
        placed.append(PlacedNode(nodes[number], matrix))
        waiting.extend((child, matrix) for child in reversed(nodes[number].get("children", ())))
    return placed


def _parents(nodes: list[Mapping[str, Any]]) -> list[int | None]:
    """Parent of each node, in a forest."""
    above: list[int | None] = [None] * len(nodes)
    for number, node in enumerate(nodes):
        for child in node.get("children", ()):
            entry_of(nodes, child, "nodes")
            if above[child] is not None:
                raise FileError(f"its node {child} hangs on several others; export it again")
            above[child] = number
    reached = [number for number, parent in enumerate(above) if parent is None]
    for number in reached:  # grows meanwhile
        reached.extend(nodes[number].get("children", ()))
    if len(reached) < len(nodes):
        number = min(set(range(len(nodes))) - set(reached))
        raise FileError(f"its node {number} hangs on itself, or below a node that does; export it again")
    return above


def _roots(file: GltfFile, above: list[int | None]) -> list[int]:
    """The nodes that hang on no other, of the scene to show; of the whole file where it has no scenes."""
    if not file.header.get("scenes"):
        return [number for number, parent in enumerate(above) if parent is None]
    roots = file.entry("scenes", file.header.get("scene", 0)).get("nodes", ())
    for number in roots:
        file.entry("nodes", number)
        if above[number] is not None:
            raise FileError(f"its scene begins with node {number}, which hangs on another; export it again")
    if len(set(roots)) < len(roots):
        raise FileError("its scene lists a node twice; export it again")
    return list(roots)


def _local(nodes: list[Mapping[str, Any]]) -> Floats:
    """(n, 4, 4): the frame of each node in that of its parent: matrices by columns, or translation, rotation, scale."""
    parts = (
        np.array([_numbers(node, name, number, one) for number, node in enumerate(nodes)]).reshape(-1, len(one))
        for name, one in _IDENTITY.items()
    )
    matrices = compose_matrices(*parts)
    for number, node in enumerate(nodes):
        if "matrix" in node:
            matrices[number] = np.reshape(_numbers(node, "matrix", number, (0,) * 16), (4, 4)).T
    return matrices


def _numbers(node: Mapping[str, Any], name: str, number: int, default: tuple[float, ...]) -> tuple[float, ...]:
    if name not in node:
        return default
    values = node[name]
    if not isinstance(values, list) or len(values) != len(default) or not all(type(x) in (int, float) for x in values):
        raise FileError(f"its node {number} has a {name} that is not {len(default)} numbers; export it again")
    if name == "rotation" and not any(values):
        raise FileError(f"its node {number} has a rotation of 0, which is none; export it again")
    return tuple(map(float, values))


def compose_matrices(translations: Floats, rotations: Floats, scales: Floats) -> Floats:
    """(n, 4, 4) matrices of (n, 3) translations, (n, 4) quaternions (x, y, z, w) and (n, 3) scales."""
    x, y, z, w = (rotations / np.linalg.norm(rotations, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrices = np.zeros((len(translations), 4, 4))
    matrices[:, :3, :3] = np.moveaxis(np.array(rows), 2, 0) * scales[:, None, :]
    matrices[:, :3, 3] = translations
    matrices[:, 3, 3] = 1
    return matrices


def copies(node: PlacedNode, file: GltfFile) -> Floats:
    """(n, 4, 4): where the mesh of a node stands; n is 1 but for EXT_mesh_gpu_instancing."""
    described = node.described.get("extensions", {}).get("EXT_mesh_gpu_instancing")
    if described is None:
        return node.matrix[None]
    accessors = {name.lower(): number for name, number in described["attributes"].items()}
    columns = {name: file.array(accessors[name]).astype(np.float64) for name in _IDENTITY if name in accessors}
    count = max(map(len, columns.values()), default=1)
    for name, array in columns.items():
        if array.shape != (count, len(_IDENTITY[name])):
            raise FileError(f"its instances have {name} of the shape {array.shape} for {count} places; export it again")
    file.reader.take(PLACE * count, f"{count} instances")
    parts = (columns.get(name, np.tile(one, (count, 1))) for name, one in _IDENTITY.items())
    return np.asarray(node.matrix @ compose_matrices(*parts))
