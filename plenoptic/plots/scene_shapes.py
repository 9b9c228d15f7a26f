"""Meshes seen along an axis: of large ones the largest triangles and some of the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from plenoptic.core.color.srgb import linear_to_srgb
from plenoptic.core.values import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TRIANGLES, _FEWEST = 12_000, 40
"""Triangles of a scene that are drawn, and the least of a mesh."""
_PLACES = 400
"""Instances that are drawn, as boxes where their triangles are too many."""
_BOX = np.array([[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
                 [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5]])  # fmt: skip
_SHADE = 0.5
"""Brightness of faces seen from the edge over that of faces seen from the front."""
_LIGHT, _GLASS = (1.0, 0.83, 0.23), (0.72, 0.90, 0.95)


class Shape(NamedTuple):
    """A part of a scene as it is drawn."""

    triangles: Floats
    """(n, 3, 3) corners, mm."""
    colour: Floats
    """(3,) sRGB, 0 to 1."""
    bounds: Floats
    """(2, 3): of all that is drawn."""


def around(points: list[Floats]) -> Floats:
    """(2, 3): the box around points (n, 3)."""
    return np.stack([np.min([p.min(axis=0) for p in points], axis=0), np.max([p.max(axis=0) for p in points], axis=0)])


def shapes_of(scene: Any, window: Floats | None = None) -> list[Shape]:
    """Meshes, instances and lights with a surface of a scene, or their parts that reach into a box.

    `window` is (2, 3), or (2, 2) for x and y alone.
    """
    shining = [light.mesh() for light in scene.lights if hasattr(light, "mesh")]
    parts = [*scene.meshes, *shining]
    most, shapes = max(_FEWEST, _TRIANGLES // max(1, len(parts))), []
    for k, part in enumerate(parts):
        mesh = getattr(part, "mesh", part)
        triangles = np.asarray(mesh.vertices, dtype=np.float32)[np.asarray(mesh.faces)]
        if hasattr(part, "matrices"):
            triangles = _places(part, triangles, most)
        else:
            if window is not None and len(triangles) > most:
                low, high = triangles.min(axis=1)[:, : window.shape[1]], triangles.max(axis=1)[:, : window.shape[1]]
                triangles = triangles[((high >= window[0]) & (low <= window[1])).all(axis=1)]
            triangles = _fewer(triangles, most)
        colour = np.array(_LIGHT) if k >= len(scene.meshes) else _colour(mesh.material.row())
        if len(triangles):
            shapes.append(Shape(triangles, colour, around([triangles.reshape(-1, 3)])))
    return shapes


def _fewer(triangles: Floats, most: int) -> Floats:
    """The largest triangles, and of the others every k-th, sqrt(k) times as large about its middle."""
    if len(triangles) <= most:
        return triangles
    order = np.argsort(np.ptp(triangles, axis=1).sum(axis=1), kind="stable")[::-1]
    large, small = order[: most // 2], order[most // 2 :]
    step = -(-len(small) // (most - len(large)))
    some = triangles[small[::step]]
    middle = some.mean(axis=1, keepdims=True)
    return np.concatenate([triangles[large], middle + np.sqrt(step) * (some - middle)])


def _places(part: Any, corners: Floats, most: int) -> Floats:
    """Triangles of instances at as many places as are drawn: those of the mesh, or of the box around it."""
    matrices = np.asarray(part.matrices)[:: -(-len(part.matrices) // _PLACES)]
    if len(corners) * len(matrices) > most:
        low, high = part.mesh.bounds
        box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        corners = box[_BOX]
    moved = np.einsum("mij,nkj->mnki", matrices[:, :3, :3], corners) + matrices[:, None, None, :3, 3]
    return np.asarray(moved.reshape(-1, 3, 3))


def _colour(row: Any) -> Floats:
    """Colour of a material by its row, sRGB."""
    if np.any(np.asarray(row.glass_index)) or row.pane_index:
        return np.array(_GLASS)
    shines = hasattr(row.emission, "texels") or np.any(row.emission)
    colour = row.emission if shines else row.base_color
    if hasattr(colour, "texels"):
        colour = np.asarray(colour.texels).reshape(-1, np.shape(colour.texels)[-1]).mean(axis=0)
    full = np.broadcast_to(np.asarray(colour, dtype=np.float64).ravel(), (3,))
    return np.asarray(linear_to_srgb(np.clip(full, 0.0, 1.0)))


def draw_shapes(ax: Axes, shapes: list[Shape], right: Floats, up: Floats, unit: float) -> None:
    """Draw shapes seen with some directions to the right and up, the largest behind, lit from where they are seen.

    `unit` is that of the axes, mm.
    """
    from matplotlib.collections import PolyCollection

    across, towards = np.stack([right, up], axis=1), np.cross(right, up)
    spans = [np.prod(np.ptp(shape.bounds @ across, axis=0)) for shape in shapes]
    for k in np.argsort(spans, kind="stable")[::-1].tolist():
        shape = shapes[k]
        triangles = shape.triangles[np.argsort(shape.triangles.mean(axis=1) @ towards, kind="stable")]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        cosines = np.abs(normals @ towards) / np.where(lengths > 0, lengths, 1.0)
        colours, faces = shape.colour * (_SHADE + (1.0 - _SHADE) * cosines[:, None]), triangles @ across / unit
        style: dict[str, Any] = {"edgecolors": "face", "linewidths": 0.3, "antialiased": False, "rasterized": True}
        ax.add_collection(PolyCollection(faces, facecolors=colours, **style))
