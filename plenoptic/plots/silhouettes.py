"""Outlines of meshes seen along an axis, as pixels: of large meshes the largest triangles and points of the others."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.color.srgb import linear_to_srgb
from plenoptic.core.values import Floats

_TRIANGLES, _FEWEST = 6000, 40
"""Triangles of a scene that are drawn as such, and the least of a mesh."""
_POINTS = 200_000
"""Points of a scene by which the other triangles are drawn."""
_PLACES = 400
"""Instances that are drawn, as boxes where their triangles are too many."""
_BOX = np.array([[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
                 [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5]])  # fmt: skip
_LIGHT, _GLASS = (1.0, 0.83, 0.23), (0.72, 0.90, 0.95)


class Shape(NamedTuple):
    """A part of a scene as it is drawn."""

    triangles: Floats
    """(n, 3, 3) corners, mm."""
    points: Floats
    """(m, 3)"""
    colour: Floats
    """(3,) sRGB, 0 to 1."""
    opacity: float
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
    lights = len(scene.meshes)
    parts = [*scene.meshes, *shining]
    triangles, points = max(_FEWEST, _TRIANGLES // max(1, len(parts))), _POINTS // max(1, len(parts))
    shapes = []
    for k, part in enumerate(parts):
        mesh = getattr(part, "mesh", part)
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces)
        dots = np.empty((0, 3))
        if hasattr(part, "matrices"):
            drawn = _places(part, vertices[faces] if len(faces) <= triangles else None, triangles)
        else:
            if window is not None and len(faces) > triangles:
                faces = _within(vertices, faces, window)
            drawn, dots = _largest(vertices, faces, triangles, points)
        colour, opacity = (np.array(_LIGHT), 0.9) if k >= lights else _look(mesh.material.row())
        if len(drawn):
            box = around([drawn.reshape(-1, 3), *([dots] if len(dots) else [])])
            shapes.append(Shape(drawn, dots, colour, opacity, box))
    return shapes


def _within(vertices: NDArray[Any], faces: NDArray[Any], window: Floats) -> NDArray[Any]:
    """Triangles that reach into a box."""
    k = window.shape[1]
    high = np.stack([vertices[faces[:, i], :k] for i in range(3)])
    return np.asarray(faces[((high.max(axis=0) >= window[0]) & (high.min(axis=0) <= window[1])).all(axis=1)])


def _largest(vertices: NDArray[Any], faces: NDArray[Any], triangles: int, points: int) -> tuple[Floats, Floats]:
    """The largest triangles of a mesh, and points evenly over the others, some of which are left out of very many."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    if len(faces) <= triangles:
        return np.stack([a, b, c], axis=1), np.empty((0, 3))
    size = np.abs(b - a).sum(axis=1) + np.abs(c - a).sum(axis=1)
    large = np.argpartition(size, len(size) - triangles)[-triangles:]
    each, step = max(1, points // len(faces)), max(1, len(faces) // points)
    u, v = (np.arange(each)[:, None, None] * np.array([0.7549, 0.5698])[:, None, None, None] + 0.3) % 1.0
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    a_, b_, c_ = (corner[::step] for corner in (a, b, c))
    some = a_ + u * (b_ - a_) + v * (c_ - a_)
    return np.stack([a[large], b[large], c[large]], axis=1), some.reshape(-1, 3)


def _places(part: Any, corners: Floats | None, triangles: int) -> Floats:
    """Triangles of instances at as many places as are drawn: those of the mesh, or of the box around it."""
    matrices = np.asarray(part.matrices)[:: -(-len(part.matrices) // _PLACES)]
    if corners is None or len(corners) * len(matrices) > triangles:
        low, high = part.mesh.bounds
        box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        corners = box[_BOX]
    moved = np.einsum("mij,nkj->mnki", matrices[:, :3, :3], corners) + matrices[:, None, None, :3, 3]
    return np.asarray(moved.reshape(-1, 3, 3))


def _look(row: Any) -> tuple[Floats, float]:
    """Colour and opacity of a material by its row."""
    if np.any(np.asarray(row.glass_index)) or row.pane_index:
        return np.array(_GLASS), 0.45
    shines = hasattr(row.emission, "texels") or np.any(row.emission)
    colour = row.emission if shines else row.base_color
    if hasattr(colour, "texels"):
        colour = np.asarray(colour.texels).reshape(-1, np.shape(colour.texels)[-1]).mean(axis=0)
    full = np.broadcast_to(np.asarray(colour, dtype=np.float64).ravel(), (3,))
    return np.asarray(linear_to_srgb(np.clip(full, 0.0, 1.0))), 0.75


def painted(shapes: list[Shape], right: Floats, up: Floats, box: Floats, size: tuple[int, int]) -> Floats:
    """(rows, columns, 4): the shapes seen with some directions to the right and up, the largest behind.

    `box` (2, 2) is the extent of the picture: least and greatest along right, then along up, mm.
    """
    canvas, across = np.zeros((*size, 4)), np.stack([right, up])
    low, scale = box[:, 0], np.array(size[::-1]) / np.ptp(box, axis=1)
    places = [((s.triangles @ across.T - low) * scale, (s.points @ across.T - low) * scale) for s in shapes]
    spans = [np.prod(np.ptp(shape.bounds @ across.T, axis=0)) for shape in shapes]
    for k in np.argsort(spans, kind="stable")[::-1].tolist():
        triangles, points = places[k]
        if (covered := _mask(triangles, points, size)) is not None:
            mask, rim, window = covered
            _paint(canvas[window], mask, rim, shapes[k])
    return canvas[::-1]


def _mask(
    triangles: Floats, points: Floats, size: tuple[int, int]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], tuple[slice, slice]] | None:
    """Pixels that a shape covers and those of its rim, within a window around it; None if it is not in the picture."""
    from PIL import Image, ImageChops, ImageDraw, ImageFilter

    rows, columns = size
    everything = np.concatenate([triangles.reshape(-1, 2), points])
    low = np.maximum(np.floor(everything.min(axis=0)).astype(int) - 2, 0)
    high = np.minimum(np.ceil(everything.max(axis=0)).astype(int) + 3, (columns, rows))
    if (low >= high).any():
        return None
    surface, dots = (Image.new("L", tuple((high - low).tolist())) for _ in range(2))
    # Far outside of the picture, coordinates would leave the whole numbers of the drawing library.
    corners, places = (np.clip(part - low, -1e6, 1e6) for part in (triangles, points))
    draw = ImageDraw.Draw(surface)
    for triangle in corners.reshape(-1, 6).tolist():
        draw.polygon(triangle, fill=1, outline=1)
    ImageDraw.Draw(dots).point(np.floor(places).ravel().tolist(), fill=1)
    full = ImageChops.lighter(surface, dots.filter(ImageFilter.MaxFilter(3)))
    mask, inside = (np.array(image, dtype=bool) for image in (full, full.filter(ImageFilter.MinFilter(3))))
    return mask, mask & ~inside, (slice(low[1], high[1]), slice(low[0], high[0]))


def _paint(part: Floats, mask: NDArray[np.bool_], rim: NDArray[np.bool_], shape: Shape) -> None:
    """Paint a shape over a part of the picture, its rim darker."""
    for where, colour, alpha in ((mask & ~rim, shape.colour, shape.opacity), (rim, 0.45 * shape.colour, 0.95)):
        below = part[where]
        over = alpha + below[:, 3:] * (1.0 - alpha)
        part[where] = np.hstack([(alpha * colour + below[:, 3:] * (1.0 - alpha) * below[:, :3]) / over, over])
