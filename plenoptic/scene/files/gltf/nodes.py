"""The tree of a glTF scene: what stands where."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.errors import FileError
from plenoptic.scene.files.gltf.file import GltfFile


class PlacedNode(NamedTuple):
    """A node of the tree and its frame: `matrix` (4, 4) takes its own coordinates to the world, in the file's unit."""

    described: Mapping[str, Any]
    matrix: Floats


def placed_nodes(file: GltfFile) -> Iterator[PlacedNode]:
    """All nodes of the scene that a file shows first, parents before their children, in the order of the file.

    A `FileError` for a node that hangs on two others, or on itself.
    """
    waiting = [(number, np.eye(4)) for number in reversed(_roots(file))]
    met: set[int] = set()
    while waiting:
        number, above = waiting.pop()
        node = file.described("nodes", number)
        if number in met:
            raise FileError(f"its node {number} hangs on several others; export it again")
        met.add(number)
        matrix = above @ _local(node)
        yield PlacedNode(node, matrix)
        waiting.extend((child, matrix) for child in reversed(node.get("children", ())))


def _roots(file: GltfFile) -> list[int]:
    """The nodes that hang on no other, of the scene to show; of the whole file where it has no scenes."""
    if file.header.get("scenes"):
        return list(file.described("scenes", file.header.get("scene", 0)).get("nodes", ()))
    nodes = file.header.get("nodes", ())
    below = {child for node in nodes for child in node.get("children", ())}
    return [number for number in range(len(nodes)) if number not in below]


def _local(node: Mapping[str, Any]) -> Floats:
    """The frame of a node in that of its parent: a matrix by columns, or translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    moved = [node.get("translation", (0, 0, 0)), node.get("rotation", (0, 0, 0, 1)), node.get("scale", (1, 1, 1))]
    matrices = composed(*(np.array([part], dtype=np.float64) for part in moved))
    return np.asarray(matrices[0])


def composed(translations: Floats, rotations: Floats, scales: Floats) -> Floats:
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
    given = {name: file.array(number).astype(np.float64) for name, number in described["attributes"].items()}
    count = max(len(array) for array in given.values())
    translations = given.get("TRANSLATION", np.zeros((count, 3)))
    rotations = given.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
    scales = given.get("SCALE", np.ones((count, 3)))
    return np.asarray(node.matrix @ composed(translations, rotations, scales))
